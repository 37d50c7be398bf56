// A quarter of the lower half of a ball of radius 20 mm, which touches the floor z = 0 at its pole
SetFactory("OpenCASCADE");
R = 20;
Sphere(1) = {0, 0, R, R, -Pi/2, 0, Pi/2};
MeshSize{ 1, 2, 4 } = 4;
MeshSize{ 3 } = 0.25;                                   // the pole
Physical Volume("ball") = {1};
Physical Surface("sphere") = {1};
Physical Surface("cut") = {2};
Physical Surface("side_x") = {4};
Physical Surface("side_y") = {3};
