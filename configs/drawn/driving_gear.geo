// Three teeth of the driving gear, whose shaft is at the origin
x = 0; first = -18; teeth = 3;
Include "spur_gear.geo";
