"""Is an interface what its user can have meant? Looked at before anything is computed."""

from __future__ import annotations

import numpy as np

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.side import Side
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca
from ddmpi.scene.values import Profile

LARGE_OVERLAP = 0.02
"""An initial overlap of this part of the thinner body's depth is worth a warning."""

MANY_ELEMENTS = 5.0
"""So is one of so many distances between neighbouring nodes."""

BEHIND = 1.0 - 1e-9
"""A body that lies this part of its depth or more inside a rigid partner lies behind its surface."""


def check_overlap(interface: Interface, *sides: Side) -> list[str]:
    """Warnings of a large initial overlap; InputError where the sides turn their backs on each other. Not collective.

    A body's depth is its extent along the normal of the contact.

    Parameters
    ----------
    sides : of both bodies, or of the one that has a rigid partner
    """
    gap = np.concatenate([interface.gap, interface.fixed.gap])
    normal = np.concatenate([interface.normal, interface.fixed.normal])
    k = int(np.argmin(gap))
    overlap, depths = -gap[k], [float(np.abs(normal[k]) @ side.extent) for side in sides]
    thin = sides[int(np.argmin(depths))].body
    if len(sides) == 1 and overlap > BEHIND * depths[0]:
        raise InputError(f"contact.{interface.name}: {thin!r} lies {overlap:.3g} deep in {interface.bodies[1]!r}, "
                         f"more than its depth of {depths[0]:.3g}: the surface or the boundary is turned the wrong way")
    if overlap > min(depths):
        raise InputError(f"contact.{interface.name}: the sides overlap by {overlap:.3g}, more than the depth of "
                         f"{thin!r} ({min(depths):.3g}): they turn their backs on each other. Are the two names of "
                         "`on` in the order of `bodies`?")
    spacing = float(np.median(interface.area))
    if overlap > LARGE_OVERLAP * min(depths) or overlap > MANY_ELEMENTS * spacing:
        of = "of the thinner one's depth" if len(sides) == 2 else "of the body's depth"
        return [f"contact.{interface.name}: the bodies overlap by {overlap:.3g} at first, {overlap / min(depths):.1%} "
                f"{of} and {overlap / spacing:.3g} times the distance of contact nodes; "
                "small-strain theory means small overlaps"]
    return []


def uncovered_profile(interface: Interface, friction: Coulomb | Tresca | NoFriction,
                      gap: float | Profile | None = None) -> list[str]:
    """A warning where a profile of friction or of the gap ends before the contact does. Not collective."""
    found = []
    given = getattr(friction, "coefficient", getattr(friction, "slip_bound", None))
    for key, values in (("friction", given), ("gap", gap)):
        if not isinstance(values, Profile) or len(values.points) < 2:
            continue
        along = values.position(interface.xy)
        low, high, slack = values.points[0], values.points[-1], 1e-6 * float(np.ptp(along))
        if along.min() < low - slack or along.max() > high + slack:
            found.append(f"contact.{interface.name}.{key}: the profile covers {values.along} from {low:g} to {high:g}, "
                         f"the contact goes from {along.min():g} to {along.max():g}; beyond its ends the profile is "
                         "constant")
    return found
