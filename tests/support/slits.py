"""Bodies with a slit: in one mesh whose sides are two groups of one body, and as two bodies with a bond beside it.

Lengths are those of a block [0, 2] × [−0.75, 0.75], in space by [0, 0.5] across, whose slit is at height 0 from x = 0 to
its tip at x = 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import meshio
import numpy as np
from boundaries import rectangle
from bricks import grid
from made_up_solids import box

from ddmpi.mesh.mesh import Mesh

TIP, LENGTH, HEIGHT, DEPTH = 1.0, 2.0, 0.75, 0.5


class Slit(NamedTuple):
    """How a slit is drawn.

    Attributes
    ----------
    dimension : 2 or 3
    cells : along, across in space, and up
    gap : how far its sides are apart at x = 0; they close quadratically to the tip
    aside : how far nodes of the upper side are moved along it, so that they do not match
    inside : the radius of the left end, around an axis
    bricks : of quadrilaterals or hexahedra
    """

    dimension: int = 2
    cells: tuple[int, ...] = (8, 3)
    gap: float = 0.0
    aside: float = 0.0
    inside: float = 0.0
    bricks: bool = False

    def halves(self) -> tuple[Mesh, Mesh]:
        """The block below and the one above, with groups low and up beside the slit, and bond where they go on."""
        whole = []
        for below in (True, False):
            start = -HEIGHT if below else 0.0
            size = (LENGTH, DEPTH, HEIGHT) if self.dimension == 3 else (LENGTH, HEIGHT)
            if self.bricks:
                mesh = grid(self.cells, sizes=size).shifted((*[0.0] * (self.dimension - 1), start))
                mesh = Mesh(mesh.points, mesh.triangles, dict(mesh.groups))
            elif self.dimension == 2:
                mesh = rectangle(self.cells, size, (0.0, start))
            else:
                mesh = box((0.0, 0.0, start), size, self.cells)
            face = "top" if below else "bottom"
            facets = mesh.groups.pop(face)
            open_side = mesh.points[facets][:, :, 0].max(axis=1) <= TIP + 1e-9
            mesh.groups["low" if below else "up"] = facets[open_side]
            mesh.groups["bond"] = facets[~open_side]
            points = mesh.points.copy()
            if not below:
                x = points[:, 0]
                lip = (np.abs(points[:, -1]) < 1e-9) & (x < TIP - 1e-9)
                points[lip, -1] += self.gap * (1.0 - x[lip]) ** 2
                points[lip, 0] += self.aside * np.sin(np.pi * x[lip])
            points[:, 0] += self.inside
            whole.append(Mesh(points, mesh.triangles, mesh.groups))
        return whole[0], whole[1]

    def welded(self, closed: bool = False) -> Mesh:
        """One mesh; without a slit if it is `closed`."""
        lower, upper = self.halves()
        count = len(lower.points)
        number = count + np.arange(len(upper.points))
        far = 0.0 if closed else TIP - 1e-9
        ours = np.flatnonzero(
            (np.abs(upper.points[:, -1]) < 1e-9) & (upper.points[:, 0] - self.inside >= far)
        )
        there = np.flatnonzero(np.abs(lower.points[:, -1]) < 1e-9)
        apart = upper.points[ours][:, None] - lower.points[there][None]
        number[ours] = there[np.linalg.norm(apart, axis=2).argmin(axis=1)]
        groups = {name: group for name, group in lower.groups.items() if name != "bond"}
        for name, group in upper.groups.items():
            if name != "bond":
                both = [groups[name]] if name in groups else []
                groups[name] = np.concatenate([*both, number[group]])
        cells = np.concatenate([lower.triangles, number[upper.triangles]])
        points = np.concatenate([lower.points, upper.points])
        used, place = np.unique(cells, return_inverse=True)
        renumbered = np.full(len(points), -1)
        renumbered[used] = np.arange(len(used))
        return Mesh(
            points[used],
            place.reshape(cells.shape),
            {name: renumbered[group] for name, group in groups.items()},
        )


def write(path: Path, mesh: Mesh) -> str:
    """The file of a linear mesh, and its path."""
    d = mesh.dimension
    names = {name: np.array([k, d - 1]) for k, name in enumerate(mesh.groups, start=1)}
    groups = [*mesh.groups.values()]
    tags = [np.full(len(group), k) for k, group in enumerate(groups, start=1)]
    tags.append(np.full(len(mesh.triangles), 99))
    facet, cell = {
        (2, 3): ("line", "triangle"),
        (2, 4): ("line", "quad"),
        (3, 4): ("triangle", "tetra"),
        (3, 8): ("quad", "hexahedron"),
    }[d, mesh.triangles.shape[1]]
    cells = [*((facet, group) for group in groups), (cell, mesh.triangles)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    points = np.pad(mesh.points, ((0, 0), (0, 3 - d)))
    file = meshio.Mesh(points, cells, field_data=names, cell_data=data)
    file.write(path, file_format="gmsh22", binary=False)
    return str(path)


def scene(
    folder: Path, slit: Slit, order: int, load: Any, parted: bool = False, **contact: Any
) -> dict:
    """A block held below and pressed on its top by a `load`, in one piece, or in two, bonded beside the slit."""
    meshes = {"low": slit.halves()[0], "up": slit.halves()[1]}
    meshes = meshes if parted else {"block": slit.welded()}
    bodies = []
    for name, mesh in meshes.items():
        file = write(folder / f"{name}-{'parted' if parted else 'whole'}.msh", mesh)
        body: dict[str, Any] = {"name": name, "mesh": {"file": file, "order": order}}
        body["material"] = {"young": 1e9, "poisson": 0.3}
        if name != "up":
            body["clamp"] = ["bottom"]
        if name != "low":
            body["traction"] = [{"on": "top", "value": load} if isinstance(load, list) else load]
        bodies.append(body)
    both = ["low", "up"] if parted else ["block", "block"]
    lips = {"name": "lips", "bodies": both, "on": ["low", "up"]} | contact
    bond = {"name": "bond", "bodies": both, "on": ["bond", "bond"], "kind": "bonded"}
    return {"body": bodies, "contact": [lips, bond] if parted else [lips]}
