"""Sides whose nodes do not match: rows, their partners, gaps between arcs, ends, clamps, who is the slave."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from boundaries import held_beside, join, mortar, rectangle, ring, side, turned
from made_up_solids import box

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState, contact_state
from ddmpi.mesh.elements import on_line
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.contacts import Coulomb, NoFriction
from ddmpi.surface.cover import corners, cover
from ddmpi.surface.side import Side

COULOMB = Coulomb(coefficient=0.3)
orders = pytest.mark.parametrize("order", [1, 2])
slaves = pytest.mark.parametrize("slave", ["upper", "lower"])
QUARTER = np.pi / 2
FREE: Mapping[str, dict] = {}


def blocks(
    above: int,
    below: int,
    order: int = 1,
    x: float = 0.0,
    gap: float = 0.0,
    held: Mapping = FREE,
    **how,
) -> tuple[Side, Side]:
    """Blocks of 2 × 1, the upper one at `x`, with so many sides along the contact, `held` by name."""
    upper = rectangle((above, 2), (2.0, 1.0), (x, 1.0 + gap), order)
    lower = rectangle((below, 2), (2.0, 1.0), order=order)
    return (
        side(turned(upper, **how), "bottom", body="upper", **held.get("upper", {})),
        side(turned(lower, **how), "top", body="lower", **held.get("lower", {})),
    )


def clamped(where, x: bool = True, y: bool = True) -> dict[str, Any]:
    """Clamps of nodes, as of `side`."""
    return {"where": where, "x": x, "y": y}


def arcs(one: int, two: int, order: int, gap: float = 0.0) -> tuple[Side, Side]:
    """A quarter of a shaft in a quarter of a hub."""
    shaft, hub = (
        ring(*radii, np.linspace(0.0, QUARTER, n + 1), order, closed=False)
        for radii, n in (((0.5, 1.0 - gap / 2), one), ((1.0 + gap / 2, 2.0), two))
    )
    return side(shaft, "outer", body="shaft"), side(hub, "inner", body="hub")


def met(sides: tuple[Side, Side], **how) -> Interface:
    return mortar(*sides, NoFriction() if "kind" in how else COULOMB, "seam", **how)


def nodal_lengths(boundary: Side, low: float, high: float) -> dict[int, float]:
    """Integrals of a straight side's shape functions over low < x < high, by node."""
    found = dict.fromkeys(boundary.nodes.tolist(), 0.0)
    at, weight = np.polynomial.legendre.leggauss(4)
    for link in boundary.facets:
        a, b = boundary.xy[link[:2], 0]
        start, stop = max(min(a, b), low), min(max(a, b), high)
        if stop > start:
            x = (start + stop) / 2 + (stop - start) / 2 * at
            shapes = boundary.cell.shapes(on_line((x - a) / (b - a)))
            for node, value in zip(link, (stop - start) / 2 * weight @ shapes, strict=True):
                found[boundary.nodes[node]] += value
    return found


# Rows


@orders
@slaves
@pytest.mark.parametrize(
    "divisions, x",
    [((7, 11), 0.3), ((11, 7), 0.977), ((3, 16), 1.7), ((16, 3), -0.6), ((7, 7), 0.0)],
)
def test_a_constant_pressure_has_the_nodal_forces_of_both_bodies(x, divisions, slave, order):
    """On any meshes, wherever the sides end, so that a constant stress is exact."""
    sides = blocks(*divisions, order, x)
    contact = met(sides, slave=slave)
    low, high = max(0.0, x), min(2.0, 2.0 + x)
    for boundary, nodes, transfer in zip(
        sides, contact.rows.nodes, contact.rows.transfer, strict=True
    ):
        lengths = nodal_lengths(boundary, low, high)
        assert contact.area @ transfer == pytest.approx(
            [lengths[node] for node in nodes.tolist()], abs=1e-13
        )
        assert sum(lengths.values()) == pytest.approx(high - low)
        assert np.asarray(transfer.sum(axis=1)) == pytest.approx(1.0, abs=1e-14)
    assert (contact.area > 0).all() and contact.area.sum() == pytest.approx(high - low)
    assert contact.normal == pytest.approx(np.tile([0.0, -1.0], (contact.m, 1)))
    assert not contact.gap.any() and contact.slave == slave
    assert contact.lines.area.sum() == pytest.approx(high - low)
    assert np.bincount(contact.lines.row, contact.lines.area) == pytest.approx(contact.area)


@orders
def test_matching_sides_stay_paired(order):
    """Bit for bit; `pairing` chooses otherwise."""
    sides = blocks(6, 6, order)
    assert join(*sides, COULOMB, "seam").slave is None
    assert join(*sides, COULOMB, "seam", pairing="mortar").slave == "upper"
    assert join(*blocks(6, 7, order), COULOMB, "seam").slave == "upper"
    with pytest.raises(InputError, match="match node by node"):
        join(*blocks(6, 7, order), COULOMB, "seam", pairing="nodes")


# Gaps


@orders
def test_sides_that_touch_do_so_between_nodes_too(order):
    """Where they are turned, gaps are rounding, which was told as penetration without a load."""
    contact = met(blocks(7, 11, order, 0.3, angle=np.radians(37.0)))
    assert len(contact.probes.gap) and not contact.probes.gap.any()


@pytest.mark.every(5)
@orders
@pytest.mark.parametrize("gap", [0.0, 1e-4, -1e-4])
@pytest.mark.parametrize("divisions", [(12, 15), (15, 12), (24, 13)])
def test_arcs_of_circles_have_their_true_gap(divisions, gap, order):
    """Polygons of two circles: the chords' own heights, 100 times this gap, do not count."""
    for slave in ("shaft", "hub"):
        assert met(arcs(*divisions, order, gap), slave=slave).gap == pytest.approx(gap, abs=5e-9)


@orders
@slaves
@pytest.mark.parametrize("angle", [0.0, 0.2, 0.5])
def test_the_gap_of_a_wedge_counts_along_the_normal(angle, slave, order):
    """The normal of the contact halves the angle of the sides; the distance is found along that of the slave."""
    upper = rectangle((7, 2), (2.0, 1.0), order=order)
    lower = rectangle((8, 2), (3.0, 1.0), (-0.5, -1.0), order=order)
    tilt, height = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]), 0.1
    sides = [
        side(
            Mesh(upper.points @ tilt + [0.0, height], upper.triangles, upper.groups),
            "bottom",
            body="upper",
        ),
        side(lower, "top", body="lower"),
    ]
    contact = met(sides, slave=slave)
    inner = (contact.xy[:, 0] > 0.4) & (contact.xy[:, 0] < 1.2)  # around which all is covered
    assert contact.normal[inner] == pytest.approx(
        np.tile([np.sin(angle / 2), -np.cos(angle / 2)], (inner.sum(), 1))
    )
    above = contact.xy[:, 1] if slave == "upper" else height + contact.xy[:, 0] * np.tan(angle)
    upright = above / np.cos(angle) if slave == "upper" else above
    assert inner.sum() >= 2 and contact.gap[inner] == pytest.approx(
        (upright * np.cos(angle / 2))[inner]
    )


def test_a_corner_is_no_curve():
    """Two straight sides at a small angle do not bulge, and neither does the straight end of a rounded side."""
    mesh = rectangle((8, 2), (2.0, 1.0))
    mesh.points[:, 1] += 0.1 * np.abs(mesh.points[:, 0] - 1.0)
    assert not side(mesh, "top").slopes.any()
    mesh = rectangle((8, 2), (2.0, 1.0))
    x = np.clip(mesh.points[:, 0] - 1.0, 0.0, None)
    mesh.points[:, 1] -= 0.2 * x**2
    boundary = side(mesh, "top")
    straight = boundary.xy[boundary.facets].mean(axis=1)[:, 0] < 1.0
    assert not boundary.slopes[straight].any() and (boundary.slopes[~straight] > 0.0).all()


@pytest.mark.parametrize("gap", [1e-3, -0.02])
def test_a_given_gap_overrides(gap):
    contact = met(arcs(4, 5, 1, 1e-4), gap=gap)
    assert contact.gap == pytest.approx(gap) and contact.probes.gap == pytest.approx(gap)
    assert not met(blocks(5, 8, gap=gap), kind="bonded").gap.any()


# What faces what


@orders
def test_the_far_side_of_a_ring_is_no_partner(order):
    """A ring on a block: only what faces the block meets it; and the block does not see the bore or the far side."""
    wheel = turned(ring(0.5, 1.0, 2 * np.pi * np.arange(36) / 36, order))
    wheel.points[:, 1] += 1.001
    block = rectangle((9, 2), (3.0, 1.0), (-1.5, -1.0), order)
    for groups in (("outer",), ("outer", "inner")):
        for slave in ("ring", "block"):
            contact = met(
                (side(wheel, *groups, body="ring"), side(block, "top", body="block")), slave=slave
            )
            assert np.hypot(
                *(wheel.points[contact.rows.nodes[0]] - [0.0, 1.001]).T
            ) == pytest.approx(1.0, abs=6e-3)
            assert wheel.points[contact.rows.nodes[0], 1].max() < 0.6
            # The gap is a mean over two sides of 10°.
            assert contact.gap.min() == pytest.approx(1e-3, abs=5e-3)


def walls(divisions: int, order: int) -> Side:
    """What faces the other of two walls of one body, 0.8 apart: a bottomless channel along y."""
    left, right = (
        box((x, 0.0, 0.0), (0.2, 1.0, 1.0), (1, divisions, divisions), order) for x in (0.0, 1.0)
    )
    number = len(left.points)
    facets = np.concatenate([left.groups["right"], right.groups["left"] + number])
    mesh = Mesh(
        np.concatenate([left.points, right.points]),
        np.concatenate([left.triangles, right.triangles + number]),
        {"walls": facets},
    )
    return side(mesh, "walls", body="channel")


@orders
@pytest.mark.parametrize("divisions", [1, 5])
@pytest.mark.parametrize("size", [0.6, 8.0])
def test_a_wall_hides_what_stands_behind_it_in_space(divisions, size, order):
    """The left wall of a channel does not see a block behind the right one, but a block between the two."""
    channel = walls(divisions, order)
    behind, between = (
        side(box((x, 0.1, 0.1), (width, size, size), (2, 3, 3), order), group, body="block")
        for x, width, group in ((1.5, size, "left"), (0.5, 0.2, "left"))
    )
    assert not cover(channel, behind).weight.size
    over = cover(channel, between)
    assert over.weight.sum() == pytest.approx(min(size, 0.9) ** 2) and over.gap == pytest.approx(
        0.3
    )


def teeth(order: int, width: float, *places: float) -> Side:
    """Both flanks of two teeth of one body, from the `places` over a width."""
    one, other = (rectangle((1, 4), (width, 1.0), (x, 0.0), order) for x in places)
    number = len(one.points)
    flanks = [
        mesh.groups[name] + k * number
        for k, mesh in enumerate((one, other))
        for name in ("left", "right")
    ]
    mesh = Mesh(
        np.concatenate([one.points, other.points]),
        np.concatenate([one.triangles, other.triangles + number]),
        {"flanks": np.concatenate(flanks)},
    )
    return side(mesh, "flanks", body=f"teeth at {places}")


@orders
def test_a_tooth_overlaps_nothing_beyond_its_other_flank(order):
    """Teeth between teeth see the flanks that they face, and no overlap with those behind their own backs."""
    over = cover(teeth(order, 0.2, 0.0, 3.0), teeth(order, 0.1, 0.5, 2.6))
    assert over.weight.sum() == pytest.approx(2.0) and over.gap == pytest.approx(0.3)


def test_sides_that_turn_their_backs_on_each_other_are_refused():
    upper, lower = (rectangle((n, 2), (2.0, 1.0), (0.0, y)) for n, y in ((5, 1.0), (8, 0.0)))
    for groups in (("top", "bottom"), ("left", "top"), ("bottom", "bottom"), ("left", "right")):
        with pytest.raises(InputError, match=r"contact\.seam: .*do not face each other"):
            met(
                tuple(
                    side(mesh, group, body=group)
                    for mesh, group in zip((upper, lower), groups, strict=True)
                )
            )


# Ends


@pytest.mark.parametrize("part", [1e-5, 0.008, 0.1, 0.44, 0.56, 0.74, 0.84])
@orders
def test_nearly_uncovered_nodes_share_a_row(part, order):
    """No row has a length near zero; nodes that share one have a line each."""
    contact = met(blocks(8, 9, order, 2.0 - 0.25 * (3 + part)), slave="upper")
    typical = 0.25 / (1 if order == 1 else 6)
    assert contact.area.min() >= 0.15 * 0.5 * typical
    assert len(contact.lines.row) >= contact.m
    assert contact.area.sum() == pytest.approx(0.25 * (3 + part))
    assert len(contact.lines.row) == len(contact.lines.xy) and set(contact.lines.row) == set(
        range(contact.m)
    )


def forces_on_lines(state: ContactState) -> tuple[np.ndarray, float]:
    """Resultant and moment of the forces on the first body that contact_NAME.csv has at its nodes."""
    lines = state.interface.lines
    forces = state.forces[lines.row] * (lines.area / state.interface.area[lines.row])[:, None]
    return forces.sum(axis=0), float(
        lines.acting[:, 0] @ forces[:, 1] - lines.acting[:, 1] @ forces[:, 0]
    )


@pytest.mark.every(5)
@orders
@pytest.mark.parametrize("slave", [0, 1])
@pytest.mark.parametrize("seed", range(12))
def test_forces_at_the_nodes_have_the_resultant_and_the_moment(seed, slave, order):
    """Of any meshes, gaps and slivers; the moment is that on the first body's nodes, not on the second body's."""
    rng = np.random.default_rng(seed)
    above, below = rng.integers(3, 12, 2)
    sliver = rng.choice([1e-6, 1e-4, 4e-3, 0.018, 0.03, 0.3, rng.random()])
    x = 2.0 * (rng.integers(0, below) + sliver * rng.choice([-1, 1])) / below
    sides = [
        blocks(
            above, below, order, x, 0.02 * rng.random(), angle=rng.normal(), mirrored=bool(seed % 2)
        ),
        arcs(above, below, order, 0.02 * rng.random()),
    ][seed % 3 == 2]
    contact = met(sides, slave=sides[slave].body)
    s = np.concatenate([rng.random(contact.m), rng.normal(size=len(contact.sliding))])
    state = contact_state(contact, s, contact.law.bound_at(s), np.zeros(contact.size))
    (force, moment), size = (
        forces_on_lines(state),
        np.abs(state.forces).sum() * np.abs(contact.xy).max(),
    )
    assert force == pytest.approx(state.force, abs=1e-12 * size)
    own, other = (
        float((at[:, 0] * f[:, 1] - at[:, 1] * f[:, 0]).sum())
        for at, f in zip(contact.geometry.at, (state.forces, state.forces), strict=True)
    )
    assert state.moment == pytest.approx(own, abs=1e-14 * size)
    assert state.moment_imbalance[0] == pytest.approx(abs(other - own), abs=1e-12 * size)
    assert moment == pytest.approx((own, other)[slave], abs=1e-7 * size)
    assert contact.lines.area.sum() == pytest.approx(contact.area.sum(), rel=1e-13)
    assert np.abs(contact.lines.area).min() > 1e-9 * np.median(contact.area)


@pytest.mark.parametrize("gap", [0.0, 1e-6])
def test_sides_that_touch_have_no_moment_between_them(gap):
    """Turned sides are apart by rounding of their coordinates."""
    sides = blocks(3, 4, 1, 0.3, gap, angle=0.7)
    contact = met(sides, slave=sides[0].body)
    s = np.random.default_rng(2).random(contact.size)
    state = contact_state(contact, s, contact.law.bound_at(s), np.zeros(contact.size))
    assert (state.moment_imbalance == (0.0, 0.0)) is not bool(gap)


@orders
@pytest.mark.parametrize("part", [0.0, 1e-12, 1e-9, 8e-6, 1e-4])
def test_nodes_that_face_nothing_are_no_lines(part, order):
    """Where the other side ends next to a node, up to rounding of coordinates, the nodes beyond are not in tables."""
    for below in (8, 9):
        contact = met(blocks(8, below, order, 2.0 - 0.25 * (3 + part)), slave="upper")
        x = contact.lines.xy[:, 0]
        assert (contact.lines.area > 0.0).all() and len(x) == contact.m == 3 * order + 1
        assert x.max() == pytest.approx(2.0 - 0.25 * part, abs=1e-12)
        assert len(contact.geometry.facets) == 3 and len(contact.lines.facets) == 3 * order
        assert np.abs(np.diff(x[contact.lines.facets])).max() <= 0.25 / order + 1e-9


# Clamps


@orders
@slaves
def test_rows_that_clamps_nearly_hold_are_shared(order, slave):
    """A clamped node keeps its row where the other body can move there. Where clamps hold both bodies, an end has its
    neighbour's pressure, or none if no free node faces it."""
    left = clamped(lambda x, y: x == 0.0)
    one, both = (
        met(blocks(5, 8, order, held=dict.fromkeys(names, left)), slave=slave)
        for names in ([slave], ["upper", "lower"])
    )
    nodes = order * (5 if slave == "upper" else 8) + 1
    assert len(one.fixed.gap) == 0 and one.m == len(one.sliding) == nodes
    assert both.m == len(both.sliding) == nodes - 1
    if slave == "lower":  # its end lies within one side of the upper one
        assert len(both.fixed.gap) == 1 and len(both.lines.row) == nodes - 1
    else:
        assert len(both.fixed.gap) == 0 and sorted(both.lines.row) == [0, *range(nodes - 1)]
        assert both.area.sum() == pytest.approx(2.0)


@pytest.mark.parametrize(
    "law, reach, sliding", [(NoFriction(), 0.1, 0), (COULOMB, 0.1, 5), (COULOMB, 9.0, 0)]
)
def test_what_clamps_of_both_sides_hold_along_the_contact_carries_no_friction(law, reach, sliding):
    """The row of the node on a plane of symmetry keeps its normal."""
    held = dict.fromkeys(("upper", "lower"), clamped(lambda x, y: x < reach, y=False))
    contact = mortar(*blocks(5, 8, held=held), law, "seam", slave="upper")
    assert contact.m == 6 and len(contact.sliding) == sliding


def test_a_node_that_is_held_wholly_shares_a_row_that_slides():
    """A strip covers little of a facet whose one end is clamped: the row of its free end has friction as without."""
    held = {"where": lambda x, y: x < 0.001, "x": True, "y": True}
    upper, lower = rectangle((6, 2), (3.0, 1.0), (0.0, 1.0)), rectangle((90, 2), (0.01, 1.0))
    contact = mortar(
        side(upper, "bottom", body="upper", **held),
        side(lower, "top", body="lower", **held),
        COULOMB,
        "seam",
        slave="upper",
    )
    assert contact.m == 1 and contact.sliding.tolist() == [0] and contact.law.live.all()


@pytest.mark.parametrize("sides, rows", [((2, 3), 3), ((3, 4), 2), ((5, 8), 4)])
def test_ends_tied_in_both_bodies_are_shared_but_no_hinge_is_left(sides, rows):
    """An end shares its neighbour's row where another contact or a clamp holds both bodies at that node."""
    both = [replace(each, tied=np.abs(each.xy[:, 0] - 1.0) == 1.0) for each in blocks(*sides)]
    contact = met((both[0], both[1]), slave="upper")
    assert contact.m == rows and contact.area.sum() == pytest.approx(2.0)
    one = met((both[0], replace(both[1], tied=both[1].xy[:, 0] == 2.0)), slave="upper")
    assert one.m == sides[0]


@orders
@pytest.mark.parametrize("divisions, rows", [((2, 4), 15), ((3, 4), 6)])
def test_a_rim_tied_in_both_bodies_is_shared_but_no_hinge_is_left_in_space(divisions, rows, order):
    """Rows in a line would let bodies turn about it: then the rim keeps its rows."""
    sides = (
        side(box((0.0, 0.0, z), (1.0, 1.0, 1.0), (*n, 1), order), group, body=name)
        for z, n, group, name in (
            (1.0, divisions, "bottom", "upper"),
            (0.0, (5, 5), "top", "lower"),
        )
    )
    upper, lower = (
        replace(each, tied=(np.abs(each.xy[:, :2] - 0.5) > 0.499).any(axis=1)) for each in sides
    )
    contact = join(upper, lower, COULOMB, "seam", pairing="mortar", slave="upper")
    assert contact.m == rows and contact.area.sum() == pytest.approx(1.0)


def test_rows_that_no_body_moves_are_dropped():
    held = dict.fromkeys(("upper", "lower"), clamped(lambda x, y: x < 0.1))
    contact = met(blocks(10, 4, held=held), slave="upper")
    assert len(contact.fixed.gap) == 1 and contact.m == 10
    assert held_beside(contact)[0] == pytest.approx(1 / 0.2)
    assert contact.fixed.moved(0, np.ones((11 * 3, 2))) == pytest.approx(1.0)


def test_a_held_side_is_master():
    """Its rows would say the same thing several times."""
    held = clamped(lambda x, y: y == 1.0)
    sides = blocks(5, 8, held={"upper": held})
    assert met(sides).slave == "lower"
    with pytest.raises(InputError, match="cannot be the slave"):
        met(sides, slave="upper")
    with pytest.raises(InputError, match="cannot be the slave"):
        met(
            blocks(
                5, 8, held={"upper": held, "lower": clamped(lambda x, y: (y == 1.0) & (x < 0.3))}
            ),
            slave="upper",
        )
    with pytest.raises(InputError, match="all nodes of the contact are clamped"):
        met(blocks(5, 8, held={"upper": held, "lower": held}))


def test_of_sides_that_are_held_along_the_normal_of_a_bond_the_one_that_slides_is_the_slave():
    """However coarse the other one is: it has nothing to give way with. The bond holds what slides."""
    held = {name: clamped(lambda x, y: y == 1.0, x=name == "upper") for name in ("upper", "lower")}
    sides = blocks(5, 8, held=held)
    bond = join(*sides, NoFriction(), "seam", kind="bonded")
    assert bond.slave == "lower" and (
        bond.law.live.tolist() == [False] * bond.m + [True] * len(bond.sliding)
    )
    with pytest.raises(InputError, match="clamps constrain all of 'upper'"):
        join(*sides, NoFriction(), "seam", kind="bonded", slave="upper")


@pytest.mark.parametrize(
    "divisions, moduli, slave",
    [
        ((5, 8), (1.0, 1.0), "upper"),
        ((8, 5), (1.0, 1.0), "lower"),
        ((8, 5), (1.0, 100.0), "upper"),
        ((5, 8), (100.0, 1.0), "lower"),
        ((6, 6), (1.0, 1.0), "upper"),
        ((6, 6), (2.0, 1.0), "lower"),
    ],
)
def test_the_slave_is_coarse_and_soft(divisions, moduli, slave):
    """The larger h/E', so never a fine and stiff side; the first one if both are alike."""
    sides = tuple(
        replace(each, modulus=E) for each, E in zip(blocks(*divisions), moduli, strict=True)
    )
    assert met(sides).slave == slave


def test_probes_see_what_lies_between_the_nodes():
    """An overlap of which the weighted gaps know nothing."""
    sides = blocks(5, 8)
    contact = mortar(*sides, NoFriction(), "seam", slave="upper")
    u = [np.zeros((40, 2)), np.zeros((40, 2))]
    node = sides[1].nodes[4]
    u[1][node, 1] = 1e-3
    gap = contact.probes.gap - sum(
        sign * np.einsum("qi,qi->q", contact.probes.normal, contact.probes.moved(k, u[k]))
        for k, sign in ((0, 1.0), (1, -1.0))
    )
    assert -1e-3 <= gap.min() < -0.8e-3 and gap.max() == pytest.approx(0.0, abs=1e-15)


@orders
def test_every_corner_in_space_is_looked_at(order):
    """Each facet of the slave that lies on the master wholly has its vertices among the places that are looked at."""
    upper, lower = (
        side(box(*shape, order), group, body=group)
        for shape, group in (
            (((0.1, 0.1, 1.0), (0.6, 0.6, 1.0), (2, 3, 2)), "bottom"),
            (((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (4, 3, 2)), "top"),
        )
    )
    looked = corners(cover(upper, lower))
    places = np.einsum("qc,qcd->qd", looked.at, upper.xy[upper.facets[looked.facet, :3]])
    for number, nodes in enumerate(upper.facets[:, :3]):
        away = places[looked.facet == number] - upper.xy[nodes][:, None]
        assert np.linalg.norm(away, axis=2).min(axis=1) == pytest.approx(0.0, abs=1e-12)
