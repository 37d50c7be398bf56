// a bore around the lobed pin, with a clearance of 0.05
For k In {0:179}
  Point(k + 1) = {(10.05 + 0.01 * Cos(k * Pi / 30)) * Cos(k * Pi / 90), (10.05 + 0.01 * Cos(k * Pi / 30)) * Sin(k * Pi / 90), 0};
EndFor
Spline(1) = {1:180, 1};
Point(201) = {-25, -30, 0};
Point(202) = {25, -30, 0};
Point(203) = {25, 30, 0};
Point(204) = {-25, 30, 0};
Line(2) = {201, 202};
Line(3) = {202, 203};
Line(4) = {203, 204};
Line(5) = {204, 201};
Curve Loop(1) = {1};
Curve Loop(2) = {2, 3, 4, 5};
Plane Surface(1) = {2, 1};
Physical Surface("lug") = {1};
Physical Curve("bore") = {1};
Physical Curve("top") = {4};
