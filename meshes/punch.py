"""Make punch_block.msh and punch_base.msh: a tapered block on a base, with matching nodes at the contact.

    python meshes/punch.py

Lengths in millimetres. Groups of the block: contact, right, top, left; of the base: bottom, right, free, contact, left.
"""

from pathlib import Path

import gmsh

HERE = Path(__file__).parent
HALF, DIVISIONS = 10.0, 40  # half width of the contact in mm, elements along it


def _write(
    name: str,
    corners: list[tuple[float, float]],
    lines: dict[str, list[int]],
    contact: int,
    size: float,
) -> None:
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geometry = gmsh.model.geo
    points = [geometry.addPoint(x, y, 0.0, size) for x, y in corners]
    edges = [geometry.addLine(points[i], points[(i + 1) % len(points)]) for i in range(len(points))]
    surface = geometry.addPlaneSurface([geometry.addCurveLoop(edges)])
    geometry.mesh.setTransfiniteCurve(edges[contact], DIVISIONS + 1)
    geometry.synchronize()
    for group, members in lines.items():
        gmsh.model.addPhysicalGroup(1, [edges[i] for i in members], name=group)
    gmsh.model.addPhysicalGroup(2, [surface], name=name)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(HERE / f"punch_{name}.msh"))
    gmsh.finalize()


_write(
    "block",
    [
        (-HALF, 0),
        (HALF, 0),
        (1.5 * HALF, 15),
        (1.5 * HALF, 25),
        (-1.5 * HALF, 25),
        (-1.5 * HALF, 15),
    ],
    {"contact": [0], "right": [1, 2], "top": [3], "left": [4, 5]},
    contact=0,
    size=2.0,
)
_write(
    "base",
    [(-30, -30), (30, -30), (30, 0), (HALF, 0), (-HALF, 0), (-30, 0)],
    {"bottom": [0], "right": [1], "free": [2, 4], "contact": [3], "left": [5]},
    contact=3,
    size=3.0,
)
