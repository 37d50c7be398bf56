"""The warning of round bodies that roll to where a few nodes of a mesh bear them.

A roll by θ closes a node at t along the other side, from the foot of the load, by θ t, and the gap of two sides that curve
apart is κ t²/2. Smooth sides touch at t = θ/κ then, where their force N has the moment N θ/κ, which resists the roll. Where
all nodes that bear are within a facet of length h, wherever the mesh happens to have its nodes, their force is up to h/2
beside: nodes decide on a moment N h/2 either way.

So take bodies as rigid, held by contacts at all nodes that bear, but where these are within a facet on a line across the
roll alone. The motions that are left are resisted by K = Σ g N/κ gᵀ, with the rolls g of these contacts, and of the roll
at contact i nodes decide Σ |g_i K⁻¹ g_j| N_j h_j/2: of a wheel on a floor κ h/2, half of what a facet turns; of a roller
that sticks in a groove nothing, as no motion is left.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.mesh.boundary import creases
from ddmpi.mesh.elements import cell_with
from ddmpi.scene.contacts import both_sides
from ddmpi.sets import magnitude
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import in_words

ROLL = 1.0
"""Least distance by which a roll moves a side, over the displacement by contact forces, of which a warning tells."""

UNSURE = 0.25
"""Least part of a roll that nodes decide, of which a warning tells."""

NEAR = 1.01
"""Facets are equal whose lengths differ by less than this factor."""

HELD = 1e-2
"""Motions are left that move what contacts hold by less than this, of what the fastest do: rolls of a facet by 1e-3. Nodes
hold along the contact by what friction they have left, if that is more than this part."""

MOST = 1800
"""Of more motions nothing is told: as of the free motions of 300 bodies in space."""

KIND = "roll"


class Bearing(NamedTuple):
    """How a contact holds its bodies.

    Attributes
    ----------
    numbers : (c,) of the motions of its bodies
    holds : (c, c) mean of the squares of how they move what it holds
    roll : (c,) by how much they roll its sides on each other (1/m); zero where these are not round, or many nodes bear
    stiff, moment : N/κ and N h/2 (N m)
    turn : the roll in the answer (rad), zero if it is no more than deformations
    words : of the sides, and of where they are
    """

    numbers: np.ndarray
    holds: np.ndarray
    roll: np.ndarray
    stiff: float = 0.0
    moment: float = 0.0
    turn: float = 0.0
    words: tuple[str, str] = ("", "")


class Round(NamedTuple):
    """Sides that curve apart and bear on nodes within a facet.

    Attributes
    ----------
    around : (k,) the rows that bear and those beside them
    x : (m, d − 1) where rows are along the other side (m)
    way : (d − 1,) the unit vector along which the sides roll
    curvature : κ (1/m)
    length : of a facet (m)
    turn : of the roll (rad), zero if it is no more than deformations
    """

    around: np.ndarray
    x: np.ndarray
    way: np.ndarray
    curvature: float
    length: float
    turn: float


def mean_turn(state: ContactState, moved: np.ndarray) -> np.ndarray:
    """The turn (1,) or (3,) of the first side of a contact (rad), of which a body has `moved` (m, d) the rows past the
    second as a whole (m). Not collective."""
    x = state.interface.xy - state.interface.xy.mean(axis=0)
    motions = rigid_motions(x, 0.0 * x[0]).reshape(moved.size, -1)
    return np.linalg.lstsq(motions, moved.ravel(), rcond=None)[0][x.shape[1] :]


def bearing(
    state: ContactState, numbers: np.ndarray, block: np.ndarray, turn: np.ndarray | None
) -> Bearing | None:
    """How a contact holds its bodies, with the `numbers` (c,) of their motions, which move its rows by `block` (size, c).
    They `turn` past each other (rad); None if it is not to be told. None if nothing bears. Not collective."""
    interface, closed = state.interface, state.status != "open"
    if not (closed.any() and len(numbers)):
        return None
    m, law = interface.m, interface.law
    # in the pass of a far motion nodes that have slipped have next to no slip, and may stick by rounding
    rubbed = magnitude(state.tangential_force[law.sliding])
    sticks = rubbed < (1.0 - HELD) * law.slip_bound(np.maximum(state.normal_force, 0.0))
    normal = block[:m][closed]
    rubs = block[m:][np.repeat(sticks & closed[law.sliding], law.components)]
    pressed = float(state.normal_force[closed].sum())
    met = None if turn is None or pressed <= 0.0 else _round(interface, closed, turn)
    if met is None:
        rows = np.vstack([normal, rubs])
        return Bearing(numbers, rows.T @ rows / len(rows), np.zeros(len(numbers)))
    terms = np.column_stack([np.ones(len(met.around)), met.x[met.around]])
    slopes = np.linalg.lstsq(terms, block[met.around], rcond=None)[0][1:]
    roll = met.way @ slopes
    rows = np.vstack([normal - np.outer(met.x[closed] @ met.way, roll), rubs])
    size = np.linalg.norm(interface.xy - interface.xy[closed].mean(axis=0), axis=1).max()
    return Bearing(
        numbers,
        rows.T @ rows / len(rows),
        roll,
        pressed / met.curvature,
        pressed * met.length / 2.0,
        met.turn * (met.turn * size > ROLL * state.yielding),
        (both_sides(interface.bodies), in_words(interface.xy[closed].mean(axis=0), 4)),
    )


def _round(interface: Interface, closed: np.ndarray, turn: np.ndarray) -> Round | None:
    """How sides roll by a `turn` (rad) on their `closed` (m,) rows; None where they are not round, or many nodes bear. Not
    collective."""
    pairs = interface.geometry.neighbours
    pairs = pairs[closed[pairs].any(axis=1)]
    if interface.axisymmetric or interface.law.two_sided or interface.itself or not len(pairs):
        return None
    around = np.unique(pairs)
    place, frame = interface.xy[closed].mean(axis=0), interface.frame[closed][0]
    x = (interface.xy - place) @ frame[1:].T
    # how far the motion goes along the normal, at unit distances along the tangents
    turning = rigid_motions(frame[1:], 0.0 * place)[:, :, len(place) :] @ turn
    slope = turning @ frame[0]
    size = float(np.linalg.norm(slope))
    if not size and len(slope) > 1:  # nothing tells which way
        return None
    way = slope / size if size else np.ones(1)
    t = x @ way
    places = t[around] / (np.ptp(t[around]) or 1.0)
    if len(np.unique(np.round(places, 3))) < 3:  # they show no curve
        return None
    curvature = 2.0 * float(np.polyfit(t[around], interface.opening[around], 2)[0])
    spacing = float(np.abs(np.diff(t[pairs], axis=1)).max())
    order = cell_with(interface.geometry.facets.shape[1], len(place) - 1).order
    narrow = np.ptp(t[closed]) <= NEAR * order * spacing
    if curvature <= 0.0 or not narrow or has_corner(interface, around):
        return None
    return Round(around, x, way, curvature, spacing, size)


def has_corner(interface: Interface, some: np.ndarray, ends: bool = False) -> bool:
    """Whether one of `some` rows is at a corner of the first side, with `ends` also at its end. Not collective."""
    facets = interface.geometry.facets[:, : interface.dimension]
    bent = creases(interface.xy, facets, interface.normal[facets].sum(axis=1))
    marked = np.append(bent.nodes[bent.corner], bent.rim if ends else [])
    return bool(np.isin(some, marked).any())


def doubt_rolls(bearings: Mapping[str, Bearing], size: int) -> list[str]:
    """Warnings of contacts whose sides roll on each other, and of how much of that nodes decide, by the bearings of all
    contacts; `size` is the number of motions of all bodies. Not collective."""
    turning = [name for name, one in bearings.items() if one.turn]
    if not turning or size > MOST:
        return []
    holds, rolls = np.zeros((size, size)), np.zeros((len(bearings), size))
    for roll, one in zip(rolls, bearings.values(), strict=True):
        holds[np.ix_(one.numbers, one.numbers)] += one.holds
        roll[one.numbers] += one.roll
    values, motions = np.linalg.eigh(holds)
    left = rolls @ motions[:, values <= HELD**2 * values[-1]]
    stiff, moments = np.transpose([(one.stiff, one.moment) for one in bearings.values()])
    yields = left @ np.linalg.pinv(left.T * stiff @ left, rcond=HELD**2, hermitian=True) @ left.T
    most = dict(zip(bearings, np.abs(yields) @ moments, strict=True))
    told = list[str]()
    for name in turning:
        turn, (sides, place) = bearings[name].turn, bearings[name].words
        if turn * UNSURE < most[name]:
            words = (
                f"contact.{name}: {sides} roll on each other by {np.degrees(turn):.2g} degrees, of which the few nodes at "
                f"{place} decide up to {np.degrees(most[name]):.2g} either way, by where they are; refine the mesh there, "
                "or clamp the turn"
            )
            told.append(Doubt(words, KIND, turn))
    return told
