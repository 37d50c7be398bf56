"""The warning of round bodies that roll to where a few nodes of a mesh bear them.

A roll by θ closes a node at t along the other side, from the foot of the load, by θ t, and the gap of two sides that curve
apart is κ t²/2. Where all nodes that bear are within a facet, their resultant passes through the foot: nodes t₁ < 0 < t₂
both close, by θ = κ (t₁ + t₂)/2, up to half of what a facet turns, wherever the mesh happens to have its nodes. Of smooth
sides, whose zone is as narrow, the resultant is at the foot with θ = 0.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState, ContactTotals
from ddmpi.mesh.boundary import creases
from ddmpi.mesh.elements import cell_with
from ddmpi.scene.contacts import both_sides
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import in_words

ROLL = 1.0
"""Least distance by which a roll moves a side, over the displacement by contact forces, of which a warning tells."""

UNSURE = 0.25
"""Least part of a roll that nodes decide, of which a warning tells."""

NEAR = 1.01
"""Facets are equal whose lengths differ by less than this factor."""

KIND = "roll"


def doubt_rolls(state: ContactState, moved: np.ndarray) -> list[str]:
    """A warning where the first side of a contact, which its body has `moved` (m, d) past the second as a whole (m), rolls
    on it, and where it stops is decided by a few nodes within a facet. Not collective."""
    interface, closed = state.interface, state.status != "open"
    pairs = np.column_stack(sparse.triu(interface.geometry.laplacian, 1).nonzero())
    pairs = pairs[closed[pairs].any(axis=1)]
    none = interface.axisymmetric or interface.law.two_sided or interface.itself
    if none or not len(pairs):
        return []
    around = np.unique(pairs)
    place, frame = interface.xy[closed].mean(axis=0), interface.frame[closed][0]
    x = interface.xy - place
    motions = rigid_motions(x, 0.0 * place)
    rigid = np.linalg.lstsq(motions.reshape(moved.size, -1), moved.ravel(), rcond=None)[0]
    # how far the motion goes along the normal, at unit distances along the tangents
    turning = rigid_motions(frame[1:], 0.0 * place)[:, :, len(place) :] @ rigid[len(place) :]
    slope = turning @ frame[0]
    turn = float(np.linalg.norm(slope))
    t = x @ frame[1:].T @ slope / (turn or 1.0)
    places = t[around] / (np.ptp(t[around]) or 1.0)
    if len(np.unique(np.round(places, 3))) < 3:  # they show no curve
        return []
    curvature = 2.0 * np.polyfit(t[around], interface.opening[around], 2)[0]
    spacing = float(np.abs(np.diff(t[pairs], axis=1)).max())
    most = curvature * spacing / 2.0
    order = cell_with(interface.geometry.facets.shape[1], len(place) - 1).order
    rolls = turn * np.linalg.norm(x, axis=1).max() > ROLL * state.yielding and turn * UNSURE < most
    narrow = np.ptp(t[closed]) <= NEAR * order * spacing
    if not (rolls and narrow) or _has_corner(interface, around):
        return []
    return [
        Doubt(
            f"contact.{interface.name}: {both_sides(interface.bodies)} roll on each other by {np.degrees(turn):.2g} "
            f"degrees, of which the few nodes at {in_words(place, 4)} decide up to {np.degrees(most):.2g} either way, by "
            "where they are; refine the mesh there, or clamp the turn",
            KIND,
            turn,
        )
    ]


def _has_corner(interface: Interface, some: np.ndarray) -> bool:
    """Whether one of `some` rows is at a corner of the first side. Not collective."""
    facets = interface.geometry.facets[:, : interface.dimension]
    bent = creases(interface.xy, facets, interface.normal[facets].sum(axis=1))
    return bool(np.isin(some, bent.nodes[bent.corner]).any())


def free_to_roll(
    doubts: Iterable[str], contacts: Mapping[str, ContactTotals], loose: Collection[str]
) -> list[str]:
    """The `doubts`, of rolls only those of a contact that alone supports one of its bodies, a `loose` one."""
    bearing = Counter(name for one in contacts.values() if one.acting for name in {*one.bodies})
    alone = {name for name in loose if bearing[name] == 1}
    return [
        doubt
        for doubt in doubts
        if not isinstance(doubt, Doubt)
        or doubt.kind != KIND
        or alone & {*contacts[doubt.of[0].removeprefix("contact.")].bodies}
    ]
