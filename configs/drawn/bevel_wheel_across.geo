// The same wheel about x: both touch along x = z.
Include "bevel_wheel.geo";
Rotate { {0, 1, 0}, {0, 0, 0}, Pi/2 } { Volume{3}; }
