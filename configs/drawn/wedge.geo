// A wedge of 15 degrees on each side
h = 40;
t = Tan(15 * Pi / 180);
Point(1) = {-5, 0, 0};
Point(2) = {5, 0, 0};
Point(3) = {5 + h * t, h, 0};
Point(4) = {-5 - h * t, h, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 1};
Curve Loop(1) = {1 : 4};
Plane Surface(1) = {1};
Physical Curve("right") = {2};
Physical Curve("head") = {3};
Physical Curve("left") = {4};
