// A shaft of radius 20 mm, which reaches 20 mm out of its hub (z from 0 to 40 mm)
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 20};
seat[] = Extrude {0, 0, 40} { Surface{1}; Layers{8}; };
free[] = Extrude {0, 0, 20} { Surface{seat[0]}; Layers{3}; };
Physical Volume("shaft") = {seat[1], free[1]};
Physical Surface("seat") = {seat[2]};
Physical Surface("end") = {free[0]};
