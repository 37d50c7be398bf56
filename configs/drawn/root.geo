// Half of a blade's dovetail root: shank, flank at 45 degrees with rounded ends, foot
Point(1) = {0, 0, 0};
Point(2) = {12, 0, 0};
Point(3) = {12, 4, 0};
Point(4) = {6, 10, 0};
Point(5) = {6, 25, 0};
Point(6) = {0, 25, 0};
Line(1) = {1, 2};
Line(2) = {2, 3};
Line(3) = {3, 4};
Line(4) = {4, 5};
Line(5) = {5, 6};
Line(6) = {6, 1};
Curve Loop(1) = {1 : 6};
Plane Surface(1) = {1};
Physical Curve("flank") = {3};
Physical Curve("pull") = {5};
Physical Curve("axis") = {6};
