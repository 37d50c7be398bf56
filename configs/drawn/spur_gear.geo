// Teeth of an involute spur gear with rounded tips, and the sector of its body below them. A drawing that includes this
// sets the centre x and the angles of the teeth: x, first, teeth (degrees). Millimetres: 20 teeth, module 3 mm, pressure
// angle 20°, addendum 1, dedendum 1.25 modules; each tooth is 0.1 mm thinner than half a pitch, as backlash.
z = 20; m = 3; alpha = 20 * Pi / 180; thin = 0.05; round = 0.3; points = 12;
fine = 0.12; tip = 0.06; idle = 0.5;                             // elements of the flanks that work, tips, other flanks
r = m * z / 2; rb = r * Cos(alpha); ra = r + m; rf = r - 1.25 * m; core = 18;
half = Pi / (2 * z) - thin / r + Tan(alpha) - alpha;          // half the angle of a tooth at the base circle
top = Pi / (2 * z) - thin / r + Tan(alpha) - alpha - Tan(Acos(rb / ra)) + Acos(rb / ra);
rho = 0.38 * m; aside = Asin(rho / (rf + rho)); up = (rf + rho) * Cos(aside);     // fillets of the roots
start = first * Pi / 180 - Pi / z; stop = (first + 360 / z * (teeth - 1)) * Pi / 180 + Pi / z;
o = newp; Point(o) = {x, 0, 0};
from = newp; Point(from) = {x + rf * Cos(start), rf * Sin(start), 0, 1};
last = from;
outline() = {};
For k In {0 : teeth - 1}
  a = (first + 360 / z * k) * Pi / 180;
  right() = {}; left() = {};
  For i In {0 : points}
    at = rb + 0.003 + (ra - round - rb - 0.003) * i / points;
    angle = half - Tan(Acos(rb / at)) + Acos(rb / at);
    p = newp; Point(p) = {x + at * Cos(a - angle), at * Sin(a - angle), 0, idle};
    right() += p;
    p = newp; Point(p) = {x + at * Cos(a + angle), at * Sin(a + angle), 0, (i == points) ? tip : fine};
    left() = {p, left()};
  EndFor
  b = newp;
  Point(b) = {x + rf * Cos(a - half - aside), rf * Sin(a - half - aside), 0, idle};
  Point(b + 1) = {x + (rf + rho) * Cos(a - half - aside), (rf + rho) * Sin(a - half - aside), 0, idle};
  Point(b + 2) = {x + up * Cos(a - half), up * Sin(a - half), 0, idle};
  Point(b + 3) = {x + ra * Cos(a - top), ra * Sin(a - top), 0, idle};
  Point(b + 4) = {x + ra * Cos(a - top + round / ra), ra * Sin(a - top + round / ra), 0, idle};
  Point(b + 5) = {x + ra * Cos(a + top - round / ra), ra * Sin(a + top - round / ra), 0, tip};
  Point(b + 6) = {x + ra * Cos(a + top), ra * Sin(a + top), 0, tip};
  Point(b + 7) = {x + up * Cos(a + half), up * Sin(a + half), 0, 3 * fine};
  Point(b + 8) = {x + (rf + rho) * Cos(a + half + aside), (rf + rho) * Sin(a + half + aside), 0, idle};
  Point(b + 9) = {x + rf * Cos(a + half + aside), rf * Sin(a + half + aside), 0, idle};
  c = newl;
  Circle(c) = {last, o, b};
  Circle(c + 1) = {b, b + 1, b + 2};
  Line(c + 2) = {b + 2, right(0)};
  Spline(c + 3) = right();
  Bezier(c + 4) = {right(points), b + 3, b + 4};
  Circle(c + 5) = {b + 4, o, b + 5};
  Bezier(c + 6) = {b + 5, b + 6, left(0)};
  Spline(c + 7) = left();
  Line(c + 8) = {left(points), b + 7};
  Circle(c + 9) = {b + 7, b + 8, b + 9};
  outline() += {c : c + 9};
  last = b + 9;
EndFor
b = newp;
Point(b) = {x + rf * Cos(stop), rf * Sin(stop), 0, 1};
Point(b + 1) = {x + core * Cos(stop), core * Sin(stop), 0, 2.5};
Point(b + 2) = {x + core * Cos(start), core * Sin(start), 0, 2.5};
c = newl;
Circle(c) = {last, o, b};
Line(c + 1) = {b, b + 1};
Circle(c + 2) = {b + 1, o, b + 2};
Line(c + 3) = {b + 2, from};
Curve Loop(1) = {outline(), c : c + 3};
Plane Surface(1) = {1};
Physical Curve("flanks") = {outline(), c};
Physical Curve("body") = {c + 1 : c + 3};
Physical Surface("steel") = {1};
