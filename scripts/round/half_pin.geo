// the right half of the pin
Point(1) = {0, -0.05, 0};
Point(2) = {0, -10.05, 0};
Point(3) = {10, -0.05, 0};
Point(4) = {0, 9.95, 0};
Circle(1) = {2, 1, 3};
Circle(2) = {3, 1, 4};
Line(3) = {4, 2};
Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1};
Physical Surface("pin") = {1};
Physical Curve("rim") = {1, 2};
Physical Curve("middle") = {3};
