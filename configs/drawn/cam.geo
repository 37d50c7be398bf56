// An eccentric cam: a disc of radius 20 mm about (0, 0), with the bore of its shaft about (0, -2.5)
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 20};
Disk(2) = {0, -2.5, 0, 6};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
rim() = Curve In BoundingBox{-21, -21, -1, 21, 21, 1};
bore() = Curve In BoundingBox{-6.1, -8.6, -1, 6.1, 3.6, 1};
rim() -= bore();
Physical Curve("rim") = {rim()};
Physical Curve("bore") = {bore()};
