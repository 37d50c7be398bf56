// A pin of radius 10 mm that touches the hole's right side
SetFactory("OpenCASCADE");
Disk(1) = {0.1, 0, 0, 10};
Physical Curve("shank") = {1};
