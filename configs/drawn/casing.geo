// A quarter of a casing below the flange, with a blind hole of 16 mm, whose thread is 20 mm deep
SetFactory("OpenCASCADE");
c = 62.5 / Sqrt(2);
Cylinder(1) = {0, 0, -30, 0, 0, 30, 82.5, Pi/2};
Cylinder(2) = {0, 0, -31, 0, 0, 40, 25, 2*Pi};
Cylinder(3) = {c, c, -20, 0, 0, 30, 8, 2*Pi};
BooleanDifference(4) = { Volume{1}; Delete; }{ Volume{2, 3}; Delete; };
Physical Volume("casing") = {4};
Physical Surface("face") = Surface In BoundingBox{-1, -1, -0.1, 83, 83, 0.1};
Physical Surface("foot") = Surface In BoundingBox{-1, -1, -30.1, 83, 83, -29.9};
Physical Surface("thread") = {7};
Physical Surface("side_x") = Surface In BoundingBox{-0.1, -1, -31, 0.1, 83, 1};
Physical Surface("side_y") = Surface In BoundingBox{-1, -0.1, -31, 83, 0.1, 1};
