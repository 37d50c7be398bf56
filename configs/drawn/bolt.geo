// A bolt M16: shank of 16 mm, of which 20 mm are in the thread, head of 24 mm
SetFactory("OpenCASCADE");
c = 62.5 / Sqrt(2);
Cylinder(1) = {c, c, -20, 0, 0, 20, 8, 2*Pi};
Cylinder(2) = {c, c, 0, 0, 0, 18, 8, 2*Pi};
Cylinder(3) = {c, c, 18, 0, 0, 10, 12, 2*Pi};
BooleanFragments{ Volume{1, 2, 3}; Delete; }{ }
Physical Volume("bolt") = {1, 2, 3};
Physical Surface("thread") = {1};
Physical Surface("head") = {8};
