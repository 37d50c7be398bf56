// Four teeth of the driven gear, whose shaft is at x = 60 mm
x = 60; first = 153; teeth = 4;
Include "spur_gear.geo";
