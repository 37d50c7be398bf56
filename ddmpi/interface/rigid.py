"""Where a body touches a rigid surface, which has neither nodes nor compliance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface, Places
from ddmpi.interface.matching import FACING, NO_GAP, Opposite, carry
from ddmpi.interface.side import Side
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca
from ddmpi.scene.rigid import Circle, Plane
from ddmpi.scene.values import Profile


def touch(side: Side, rigid: Plane | Circle, friction: Coulomb | Tresca | NoFriction, name: str,
          gap: float | Profile | None = None, kind: str = "unilateral") -> Interface:
    """The interface of a body, which is the first, and a rigid partner.

    Normals and gaps are those of the rigid surface at the body's nodes, exactly. Nodes that do not face it, such as
    the far side of a roller, carry no row. The second side has no nodes: the partner's displacement U gives
    `Interface.prescribed`, and at nodes that clamps hold the gap, from which it is taken at once.

    Parameters
    ----------
    side : of the body
    friction, name, gap, kind : as for `pair`

    Raises
    ------
    InputError
        when the body's boundary does not face the surface. Not collective.
    """
    outward, measured = _surface(rigid, side)
    measured = measured - _bulge(side, outward)
    measured[np.abs(measured) <= NO_GAP * side.spacing] = 0.0
    towards = (np.einsum("icj,ij->ic", outward[side.links], side.outward) < FACING).all(axis=1)  # links that face it
    here = np.unique(side.links[towards])
    if len(here) == 0:
        x, y = side.xy[np.argmin(np.einsum("ij,ij->i", outward, side.normal))]
        raise InputError(f"contact.{name}: near ({x:.6g}, {y:.6g}) the boundary of {side.body!r} does not face "
                         f"{rigid.name!r}")
    partner = replace(side, body=rigid.name, modulus=np.inf, xy=side.xy - measured[:, None] * outward, normal=outward,
                      free=np.zeros_like(side.free))
    joined = np.zeros(len(here) - 1, bool)
    on = np.diff(here) == 1
    joined[on] = side.joined_over(towards)[here[:-1][on]]
    opposite = Opposite((side, partner), (here, here), -outward[here], side.lengths_over(towards)[here],
                        measured[here], joined)
    found = carry(opposite, friction, name, gap, kind)
    U, none = np.array(rigid.displacement), np.empty(0, int)
    fixed = Places((found.fixed.nodes[0], none), found.fixed.normal, found.fixed.gap + found.fixed.normal @ U)
    return replace(found, nodes=(found.nodes[0], none), modulus=side.modulus, prescribed=-(found.directions @ U),
                   transfer=(found.transfer[0], sparse.csr_matrix((found.m, 0))), fixed=fixed, displacement=U,
                   history=rigid.history)


def _surface(rigid: Plane | Circle, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """The surface's unit normal (k, 2), which points to the bodies, and the distance along it (k,), at a side's nodes.

    In the centre of a circle, which has no normal, it is the body's.
    """
    if isinstance(rigid, Plane):
        normal = np.array(rigid.normal) / np.linalg.norm(rigid.normal)
        return np.tile(normal, (len(side.xy), 1)), (side.xy - rigid.point) @ normal
    away = side.xy - np.array(rigid.center)
    distance = np.linalg.norm(away, axis=1)
    sign = -1.0 if rigid.inside else 1.0
    outward = np.where(distance[:, None] > 0.0, sign * away / np.where(distance > 0.0, distance, 1.0)[:, None],
                       -side.normal)
    return outward, sign * (distance - rigid.radius)


def _bulge(side: Side, outward: np.ndarray) -> np.ndarray:
    """How far (k,) a curved boundary stands closer to the surface than the middles of its straight sides do.

    Corners lie on the boundary that is meant, middles on the chord. The slopes at the ends of a chord give its arc,
    exactly where the boundary is a circle. At an end of the boundary, or a sharp corner, the other end's slope counts.
    """
    found = np.zeros(len(side.nodes))
    if not len(side.edges):
        return found
    middle, outer = side.links[:, 2], side.outward
    arrow = 0.5 * np.linalg.norm(side.along, axis=1) * np.tan(side.slopes.sum(axis=1) / 4)
    found[middle] = -arrow * np.einsum("ij,ij->i", outer, outward[middle])
    return found
