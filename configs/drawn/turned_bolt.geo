// Half of the section of an M10 bolt with its nut, in mm: x is the radius, y the axis. The shank has the radius r, the
// head and the nut 8.5, with fillets of 0.5 beneath them. The plates between them are 10 mm each; they meet at y = 0.
r = 5; fillet = 0.5; head = 8.5; grip = 10; high = 6.4; fine = 0.15;
Point(1) = {0, -grip - high, 0};
Point(2) = {head, -grip - high, 0};
Point(3) = {head, -grip, 0};
Point(4) = {r + fillet, -grip, 0, fine};
Point(5) = {r + fillet, -grip + fillet, 0};
Point(6) = {r, -grip + fillet, 0, fine};
Point(7) = {r, grip - fillet, 0, fine};
Point(8) = {r + fillet, grip - fillet, 0};
Point(9) = {r + fillet, grip, 0, fine};
Point(10) = {head, grip, 0};
Point(11) = {head, grip + high, 0};
Point(12) = {0, grip + high, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Circle(4) = {4, 5, 6}; Line(5) = {6, 7};
Circle(6) = {7, 8, 9}; Line(7) = {9, 10}; Line(8) = {10, 11}; Line(9) = {11, 12}; Line(10) = {12, 1};
Curve Loop(1) = {1:10};
Plane Surface(1) = {1};
Physical Curve("under_nut") = {3};
Physical Curve("under_head") = {7};
Physical Surface("bolt") = {1};
