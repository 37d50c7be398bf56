// A lug with a round end and a hole of radius 10.1 mm about the origin
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 25};
Rectangle(2) = {-80, -25, 0, 80, 50};
BooleanUnion(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Disk(4) = {0, 0, 0, 10.1};
BooleanDifference(5) = { Surface{3}; Delete; }{ Surface{4}; Delete; };
Physical Curve("hole") = {Curve In BoundingBox{-11, -11, -1, 11, 11, 1}};
Physical Curve("end") = {Curve In BoundingBox{-81, -26, -1, -79, 26, 1}};
