// A quarter of a flange for DN 50 with its neck: bolt circle of 125 mm, hole of 18 mm at 45 degrees
SetFactory("OpenCASCADE");
c = 62.5 / Sqrt(2);
Cylinder(1) = {0, 0, 0, 0, 0, 18, 82.5, Pi/2};
Cylinder(2) = {0, 0, 18, 0, 0, 32, 32, Pi/2};
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {0, 0, -1, 0, 0, 60, 25, 2*Pi};
Cylinder(5) = {c, c, -1, 0, 0, 30, 9, 2*Pi};
BooleanDifference(6) = { Volume{3}; Delete; }{ Volume{4, 5}; Delete; };
Physical Volume("flange") = {6};
Physical Surface("face") = Surface In BoundingBox{-1, -1, -0.1, 83, 83, 0.1};
Physical Surface("top") = Surface In BoundingBox{-1, -1, 17.9, 83, 83, 18.1};
Physical Surface("pipe") = Surface In BoundingBox{-1, -1, 49.9, 83, 83, 50.1};
Physical Surface("side_x") = Surface In BoundingBox{-0.1, -1, -1, 0.1, 83, 51};
Physical Surface("side_y") = Surface In BoundingBox{-1, -0.1, -1, 83, 0.1, 51};
