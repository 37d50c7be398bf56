// A bevel wheel: a ring of a cone of 45 degrees about z with its apex at the origin; its face lies along x = z.
SetFactory("OpenCASCADE");
Cone(1) = {0, 0, 14, 0, 0, 6, 14, 20};
Cylinder(2) = {0, 0, 14, 0, 0, 6, 7};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Physical Volume("wheel") = {3};
