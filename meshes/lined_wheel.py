"""Make lined_wheel.msh: a wheel with a bore, whose core and tyre are physical surfaces, finer where it will touch.

    python meshes/lined_wheel.py [FILE ORDER HALVINGS]

writes it, or another FILE of elements of this order, halved so many times, whose nodes stay on the circles. Lengths in
millimetres. Groups: bore, tread; surfaces: core, tyre; points on the axis of symmetry: crown, hub.
"""

import sys
from pathlib import Path

import gmsh

RADII = {"bore": 8.0, "seam": 30.0, "tread": 40.0}
SIZES = {"bore": 3.0, "seam": 5.0, "tread": 5.0}  # of elements; 0.7 at the bottom

gmsh.initialize([], readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
geometry = gmsh.model.geo
centre = geometry.addPoint(0.0, 0.0, 0.0)
arcs, tops = {}, {}
for name, r in RADII.items():
    corners = [
        geometry.addPoint(r * x, r * y, 0.0, 0.7 if (name, y) == ("tread", -1) else SIZES[name])
        for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1))
    ]
    arcs[name] = [geometry.addCircleArc(corners[i], centre, corners[(i + 1) % 4]) for i in range(4)]
    tops[name] = corners[1]
loops = {name: geometry.addCurveLoop(members) for name, members in arcs.items()}
parts = {
    "core": geometry.addPlaneSurface([loops["seam"], loops["bore"]]),
    "tyre": geometry.addPlaneSurface([loops["tread"], loops["seam"]]),
}
geometry.synchronize()
for name, surface in parts.items():
    gmsh.model.addPhysicalGroup(2, [surface], name=name)
for name in ("bore", "tread"):
    gmsh.model.addPhysicalGroup(1, arcs[name], name=name)
for name, point in (("crown", tops["tread"]), ("hub", tops["bore"])):
    gmsh.model.addPhysicalGroup(0, [point], name=name)
gmsh.model.mesh.generate(2)
file, order, halvings = sys.argv[1:] or (Path(__file__).parent / "lined_wheel.msh", 1, 0)
for _ in range(int(halvings)):
    gmsh.model.mesh.refine()
gmsh.model.mesh.setOrder(int(order))
gmsh.write(str(file))
gmsh.finalize()
