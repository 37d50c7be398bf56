// three lobes of a thousandth of the radius, 0.05 below the middle of the bore
For k In {0:179}
  Point(k + 1) = {(10 + 0.01 * Cos(k * Pi / 30)) * Cos(k * Pi / 90), (10 + 0.01 * Cos(k * Pi / 30)) * Sin(k * Pi / 90) - 0.05, 0};
EndFor
Spline(1) = {1:180, 1};
Curve Loop(1) = {1};
Plane Surface(1) = {1};
Physical Surface("pin") = {1};
Physical Curve("rim") = {1};
