// A hub of 40 mm bore, 80 mm diameter and 40 mm length
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 40};
Disk(2) = {0, 0, 0, 20};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
out[] = Extrude {0, 0, 40} { Surface{3}; Layers{8}; };
Physical Volume("hub") = {out[1]};
Physical Surface("rim") = {out[2]};
Physical Surface("bore") = {out[3]};
