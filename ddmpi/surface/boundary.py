"""From the boundary of a mesh to a side of a contact."""

from __future__ import annotations

import numpy as np

from ddmpi.body.loads import Supports
from ddmpi.mesh.elements import facet_shares
from ddmpi.mesh.mesh import Facets, Mesh
from ddmpi.surface.curve import Curve, in_chains
from ddmpi.surface.patch import Patch, in_places
from ddmpi.surface.side import Side, across, nodal, unit

COARSE = 1e-6
"""Nodes are put in order by their places in multiples of this part of the mesh's extent: rounding decides nothing."""

KINDS = {2: (Curve, in_chains), 3: (Patch, in_places)}
"""What a side is, and how its nodes are put in order, by dimension."""


def contact_side(mesh: Mesh, boundary: Facets, held: Supports, body: str, modulus: float,
                 tied: np.ndarray | None = None, parted: bool = False) -> Side:
    """The side of a contact made of a `boundary` of the mesh, in the plane ordered from its first end. Not collective.

    `tied` (nv,) and `parted` as those of a `Side`, of all nodes of the body; without it none is tied.
    """
    places = np.round((mesh.points - mesh.points.min(axis=0)) / (COARSE * np.ptp(mesh.points, axis=0).max()))
    kind, ordered = KINDS[mesh.dimension]
    nodes, arc = ordered(boundary.nodes, mesh.points, places, boundary.starts)
    place, xy = np.empty(len(mesh.points), int), mesh.points[nodes]
    place[nodes] = np.arange(len(nodes))
    facets = place[boundary.nodes]
    facets = facets[np.argsort(facets[:, -1])]
    normal = unit(nodal(across(xy[facets]), facets, len(nodes)))
    area = nodal(facet_shares(xy[facets], mesh.axisymmetric), facets, len(nodes))
    return kind(body, modulus, nodes, xy, normal, area, held.clamps[nodes],
                held.free[nodes], {name: u[nodes] for name, u in held.moved.items()},
                np.zeros(len(nodes), bool) if tied is None else tied[nodes], np.ptp(mesh.points, axis=0),
                arc[nodes], facets, parted, mesh.axisymmetric)
