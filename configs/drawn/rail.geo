// A rail: head with a crown of radius 300 mm and rounded gauge corners, web, foot
SetFactory("OpenCASCADE");
Disk(1) = {0, -300, 0, 300};
Rectangle(2) = {-36, -50, 0, 72, 100};
BooleanIntersection(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Rectangle(4) = {-8, -140, 0, 16, 95};
Rectangle(5) = {-75, -160, 0, 150, 22};
BooleanUnion(6) = { Surface{3}; Delete; }{ Surface{4, 5}; Delete; };
Physical Curve("crown") = {Curve In BoundingBox{-36.1, -2.3, -1, 36.1, 0.1, 1}};
Physical Curve("foot") = {Curve In BoundingBox{-75.1, -160.1, -1, 75.1, -159.9, 1}};
