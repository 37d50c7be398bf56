// A wheel of radius 460 mm with a bore of 90 mm; it touches the rail at the origin
SetFactory("OpenCASCADE");
Disk(1) = {0, 460, 0, 460};
Disk(2) = {0, 460, 0, 90};
BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }
tread() = Curve In BoundingBox{-461, -1, -1, 461, 921, 1};
bore() = Curve In BoundingBox{-91, 369, -1, 91, 551, 1};
tread() -= bore();
Physical Curve("tread") = {tread()};
Physical Curve("bore") = {bore()};
