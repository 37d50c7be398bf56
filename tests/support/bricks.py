"""Meshes of quadrilaterals and hexahedra for tests."""

import numpy as np

from ddmpi.mesh.elements import BRICKS
from ddmpi.mesh.mesh import Mesh, boundary_facets
from ddmpi.mesh.refine import raise_order

NAMES = ("left", "right", "front", "back", "bottom", "top")


def grid(divisions, order=1, shake=0.0, sizes=None, seed=1, **more) -> Mesh:
    """A box of this many bricks along each axis, its inner corners moved by up to `shake` of their distance, and of order
    2 its inner middles by as much again. In the plane its sides are left, right, bottom and top."""
    d, n = len(divisions), np.array(divisions)
    sizes = np.ones(d) if sizes is None else sizes
    number = np.arange((n + 1).prod()).reshape(n + 1)
    starts = np.stack(np.indices(divisions).reshape(d, -1), axis=1)
    cells = number[
        tuple(np.moveaxis(starts[:, None] + np.array(BRICKS[d, 1].shape.corners), -1, 0))
    ]
    places = np.stack(np.unravel_index(np.arange(number.size), n + 1), axis=1) / n
    facets = boundary_facets(cells, d)[0]
    names = NAMES if d == 3 else (*NAMES[:2], *NAMES[4:])
    groups = {
        name: facets[(places[facets][:, :, k // 2] == k % 2).all(axis=1)]
        for k, name in enumerate(names)
    }
    random = np.random.default_rng(seed)
    moved = ((places > 0.0) & (places < 1.0)).all(axis=1)
    points = places + moved[:, None] * shake * random.uniform(-1, 1, places.shape) / n
    mesh = raise_order(Mesh(points * sizes, cells, groups, **more), "", order)
    inner = np.setdiff1d(np.arange(len(points), len(mesh.points)), mesh.boundary[0])
    mesh.points[inner] += 0.3 * shake * random.uniform(-1, 1, (len(inner), d)) / n * sizes
    return mesh
