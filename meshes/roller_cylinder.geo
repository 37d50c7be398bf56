// Lower right quarter of a cylinder of diameter 100 mm, which touches the block at the origin.
R = 50;
Point(1) = {0, 0, 0};
Point(2) = {R, R, 0};
Point(3) = {0, R, 0};
Circle(1) = {1, 3, 2};
Line(2) = {2, 3};
Line(3) = {3, 1};
Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1};
Physical Curve("rim") = {1};
Physical Curve("cut") = {2};
Physical Curve("axis") = {3};
Physical Surface("cylinder") = {1};
