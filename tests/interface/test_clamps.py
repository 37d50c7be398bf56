"""Clamps of both sides of a contact: what they may prescribe together, and what no force could prevent."""

from dataclasses import replace

import numpy as np
import pytest
from boundaries import join, rectangle, side, touch, turned

from ddmpi.body.loads import supports
from ddmpi.errors import InputError
from ddmpi.interface.contradictions import Mover, refuse_contradiction
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec
from ddmpi.scene.contacts import NoFriction, Plane
from ddmpi.scene.formulas import evaluate
from ddmpi.surface.boundary import contact_side
from ddmpi.surface.side import Side

NOW = {1.0: {None: 1.0}}
meshes = pytest.mark.parametrize("below", [6, 7], ids=["pairs", "mortar"])
orders = pytest.mark.parametrize("order", [1, 2])


def blocks(
    upper: Clamp,
    lower: Clamp,
    below: int = 6,
    order: int = 1,
    drawn: float = 0.0,
    kind: str = "unilateral",
    gap: float | None = None,
    angle: float = 0.0,
    factors=None,
    swapped: bool = False,
) -> str:
    """What is said of blocks of 3 × 1, one on the other, whose left ends are clamped; nothing if they are solved."""
    found = []
    for (n, y, on), name, clamp in zip(
        ((6, 1.0 + drawn, "bottom"), (below, 0.0, "top")),
        ("upper", "lower"),
        (upper, lower),
        strict=True,
    ):
        mesh = rectangle((n, 2), (3.0, 1.0), (0.0, y), order)
        left = np.unique(mesh.groups["left"])
        boundary = side(
            turned(mesh, angle),
            on,
            body=name,
            x=clamp.x is not None,
            y=clamp.y is not None,
            where=lambda x, y, left=left: np.isin(np.arange(len(x)), left),
        )
        found.append(Mover(moved(boundary, clamp), [clamp]))
    if swapped:
        found.reverse()
    interface = join(*(mover.side for mover in found), NoFriction(), "seam", gap=gap, kind=kind)
    try:
        refuse_contradiction(interface, found, factors or NOW)
    except InputError as error:
        return str(error)
    return ""


def moved(boundary: Side, clamp: Clamp) -> Side:
    """The side with the displacements that its clamp prescribes."""
    u = np.zeros_like(boundary.xy)
    for axis, value in enumerate(clamp.components[:2]):
        held = boundary.clamps[:, axis] >= 0
        u[held, axis] = 0.0 if value is None else evaluate(value, *boundary.xy[held].T)
    return replace(boundary, moved={clamp.history: u})


def left(x=None, y=None, history=None) -> Clamp:
    return Clamp(on="left", x=x, y=y, history=history)


@orders
@meshes
@pytest.mark.parametrize("swapped", [False, True])
def test_clamps_that_push_bodies_into_each_other_are_named(swapped, below, order):
    """The place, both clamps, their values and the overlap, whichever body comes first."""
    said = blocks(left(x=0.0, y=-0.005), left(x=0.0, y=0.001), below, order, swapped=swapped)
    for words in (
        "contact.seam: at (0, 1) ",
        "body.upper.clamp.0 on 'left' prescribes y = -0.005",
        "body.lower.clamp.0 on 'left' prescribes y = 0.001",
        "into each other by 0.006",
    ):
        assert words in said
    # Sides that part contradict nothing.
    assert blocks(left(x=0.0, y=0.005), left(x=0.0, y=0.001), below, order, swapped=swapped) == ""


@meshes
@pytest.mark.parametrize(
    ("drawn", "y", "said"),
    [
        (0.01, -0.01, ""),
        (0.01, -0.012, "by 0.002"),
        (-0.01, 0.0, ""),
        (-0.01, 0.004, ""),
        (-0.01, -0.003, "by 0.003"),
    ],
)
def test_gaps_may_close_and_overlaps_may_stay(drawn, y, said, below):
    """A drawn clearance may be used up; a fit is no mistake, but clamps must not deepen it."""
    found = blocks(left(x=0.0, y=y), left(x=0.0, y=0.0), below, drawn=drawn)
    assert said in found and bool(found) == bool(said)
    given = blocks(left(x=0.0, y=y), left(x=0.0, y=0.0), below, gap=drawn)
    assert said in given and bool(given) == bool(said)


@meshes
@pytest.mark.parametrize(
    ("x", "y", "gap", "said"),
    [
        (0.0, 0.0, None, ""),
        (0.0, 0.0, -1e-5, ""),
        (0.0, 1e-5, -1e-5, ""),
        (0.0, 2e-5, -1e-5, "prescribes y = 2e-05"),
        (0.0, 1e-3, None, "prescribes y = 0.001"),
        (0.0, -1e-3, None, "prescribes y = -0.001"),
        (1e-3, 0.0, None, "prescribes x = 0.001"),
    ],
)
def test_a_bond_must_not_be_torn(x, y, gap, said, below):
    """Neither apart nor along itself; where it closes a gap or a fit, clamps may do so, too."""
    found = blocks(left(x=x, y=y), left(x=0.0, y=0.0), below, kind="bonded", gap=gap)
    assert said in found and bool(found) == bool(said)
    assert ("they tear the bond apart by" in found) == bool(said)
    # Without a bond they may slide.
    assert blocks(left(x=x, y=y), left(x=0.0, y=0.0), below) == (
        "" if y >= 0.0 else blocks(left(x=0.0, y=y), left(x=0.0, y=0.0), below)
    )


@meshes
def test_what_clamps_leave_free_contradicts_nothing(below):
    """One body that can give way, or one component of a slanted normal."""
    for kind in ("unilateral", "bonded"):
        assert blocks(left(x=0.0), left(x=0.0, y=1.0), below, kind=kind) == ""
        assert blocks(left(x=0.0, y=-1.0), left(x=0.0), below, kind=kind) == ""
    assert blocks(left(y=-1.0), left(y=0.0), below) != ""  # along y they cannot, whatever x does
    # Along the normal they can, a little.
    assert blocks(left(y=-1.0), left(y=0.0), below, angle=0.1) == ""
    said = blocks(left(x=0.1, y=-1.0), left(x=0.0, y=0.0), below, angle=0.1)
    assert "prescribes x = 0.1, body.upper.clamp.0 on 'left' prescribes y = -1, and" in said
    closing = np.cos(0.1) + 0.1 * np.sin(0.1)
    assert f"by {closing:.3g}" in said


@meshes
def test_rounding_contradicts_nothing(below):
    """Both clamps follow one formula, which rounding makes differ."""
    formula = "-1e-3 * (1 + x + sin(y))"
    assert (
        blocks(left(x=0.0, y=formula), left(x=0.0, y=f"1e-17 + 3 * ({formula}) / 3"), below) == ""
    )
    assert blocks(left(x=0.0, y=f"1.001 * {formula}"), left(x=0.0, y=formula), below) != ""


def test_the_time_at_which_clamps_contradict_each_other_is_named():
    """The worst of the given times, between which displacements are linear."""
    factors = {
        time: {None: 1.0, "press": factor} for time, factor in ((0.0, 0.0), (1.0, 2.0), (2.0, 1.0))
    }
    said = blocks(left(x=0.0, y=-0.001, history="press"), left(x=0.0, y=-0.001), factors=factors)
    assert (
        "at (0, 1), at time 1, " in said and "prescribes y = -0.002" in said and "by 0.001" in said
    )
    factors[1.0]["press"] = 1.0
    assert (
        blocks(left(x=0.0, y=-0.001, history="press"), left(x=0.0, y=-0.001), factors=factors) == ""
    )


@pytest.mark.parametrize(
    ("U", "said"), [((0.3, 0.02), "by 0.01"), ((0.0, 0.01), ""), ((0.0, -0.02), "")]
)
def test_a_rigid_partner_that_moves_into_clamped_nodes_is_refused(U, said):
    """A floor that is lifted by more than its distance from a held edge; one that is lowered may be."""
    clamp, floor = (
        left(y=0.0),
        Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=U, history="lift"),
    )
    boundary = side(
        rectangle((6, 2), (3.0, 1.0), (0.0, 0.01)), "bottom", where=lambda x, y: x == 0.0, y=True
    )
    interface = touch(boundary, floor, NoFriction(), "seam")
    movers = [Mover(moved(boundary, clamp), [clamp]), Mover(floor)]
    refuse_contradiction(interface, movers, {0.0: {None: 1.0, "lift": 0.0}})
    times = {0.0: {None: 1.0, "lift": 0.0}, 1.0: {None: 1.0, "lift": 1.0}}
    if not said:
        return refuse_contradiction(interface, movers, times)
    with pytest.raises(InputError) as error:
        refuse_contradiction(interface, movers, times)
    assert said in str(error.value) and "rigid.floor.displacement prescribes y = 0.02" in str(
        error.value
    )
    every = np.tile(np.eye(2), (len(boundary.xy), 1, 1))
    free = replace(boundary, clamps=np.full_like(boundary.clamps, -1), free=every)
    # A body whose nodes are free can give way.
    refuse_contradiction(interface, [replace(movers[0], side=free), movers[1]], times)


@pytest.mark.every(5)
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
@meshes
def test_clamps_along_normals_that_push_bodies_into_each_other(below, angle):
    """At any angle they are refused where they push into each other, and not where they part."""

    def said(push: float) -> str:
        movers = []
        for (n, y, on), name, value in zip(
            ((6, 1.0, "bottom"), (below, 0.0, "top")), ("upper", "lower"), (push, 1e-3), strict=True
        ):
            mesh = turned(rectangle((n, 2), (3.0, 1.0), (0.0, y)), angle)
            edges = mesh.groups[on]
            along = mesh.points[edges].mean(axis=1) @ [np.cos(angle), np.sin(angle)]
            mesh = Mesh(mesh.points, mesh.triangles, mesh.groups | {"part": edges[along < 1.6]})
            clamp = Clamp(on="part", normal=value)
            held = supports(
                mesh,
                BodySpec(
                    name=name,
                    mesh=MeshSpec(file="none.msh"),
                    clamp=[clamp],
                    material=Material(young=1.0, poisson=0.3),
                ),
            )
            movers.append(Mover(contact_side(mesh, mesh.facets(on), held, name, 1.0), [clamp]))
        interface = join(*(mover.side for mover in movers), NoFriction(), "seam")
        if below == 6:
            # The pairs that both sides hold carry no row.
            assert interface.m == 3 and len(interface.fixed.gap) == 4
        try:
            refuse_contradiction(interface, movers, NOW)
        except InputError as error:
            return str(error)
        return ""

    assert "push the bodies into each other by 0.006" in said(5e-3)
    assert "body.upper.clamp.0 on 'part' prescribes" in said(5e-3)
    assert said(-2e-3) == ""
