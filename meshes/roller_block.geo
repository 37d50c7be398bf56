// Right half of a block of 200 mm x 200 mm.
Point(1) = {0, -200, 0};
Point(2) = {100, -200, 0};
Point(3) = {100, 0, 0};
Point(4) = {0, 0, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
Physical Curve("bottom") = {1};
Physical Curve("top") = {3};
Physical Curve("axis") = {4};
Physical Surface("block") = {1};
