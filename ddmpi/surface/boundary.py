"""From the boundary of a mesh to a side of a contact."""

from __future__ import annotations

import numpy as np

from ddmpi.body.loads import Supports
from ddmpi.mesh.elements import facet_shares
from ddmpi.mesh.mesh import Facets, Mesh
from ddmpi.surface.curve import Curve, in_chains
from ddmpi.surface.patch import Patch, in_places
from ddmpi.surface.side import Side, across, nodal, unit
from ddmpi.system.numbers import SAME

KINDS = {2: (Curve, in_chains), 3: (Patch, in_places)}
"""The class of a side and the function that sorts its nodes, by dimension."""


def contact_side(
    mesh: Mesh,
    boundary: Facets,
    supports: Supports,
    body: str,
    modulus: float,
    tied: np.ndarray | None = None,
    parted: bool = False,
) -> Side:
    """The side of a contact made of a `boundary` of the mesh, in the plane sorted from its first end. Not collective.

    `tied` (nv,) and `parted` as of a `Side`, for all nodes of the body; left out, none is tied.
    """
    # rounded, so that rounding does not sort nodes
    places = np.round(
        (mesh.points - mesh.points.min(axis=0)) / (SAME * np.ptp(mesh.points, axis=0).max())
    )
    kind, ordered = KINDS[mesh.dimension]
    nodes, arc = ordered(boundary.nodes, mesh.points, places, boundary.starts)
    place, xy = np.empty(len(mesh.points), int), mesh.points[nodes]
    place[nodes] = np.arange(len(nodes))
    facets = place[boundary.nodes]
    facets = facets[np.argsort(facets[:, -1])]
    normal = unit(nodal(across(xy[facets]), facets, len(nodes)))
    area = nodal(facet_shares(xy[facets], mesh.axisymmetric), facets, len(nodes))
    return kind(
        body,
        modulus,
        nodes,
        xy,
        normal,
        area,
        supports.clamps[nodes],
        supports.free[nodes],
        {name: u[nodes] for name, u in supports.moved.items()},
        np.zeros(len(nodes), bool) if tied is None else tied[nodes],
        np.ptp(mesh.points, axis=0),
        arc[nodes],
        facets,
        parted,
        mesh.axisymmetric,
    )
