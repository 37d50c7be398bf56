"""The certificate sees every way in which an answer can be wrong, names where, and says by how much."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import scipy.sparse as sparse

from ddmpi.interface.interface import Geometry, Interface, Places
from ddmpi.interface.law import BondedLaw, CoulombLaw, Law, TrescaLaw
from ddmpi.interface.state import ContactState, contact_state
from ddmpi.judge.certificate import (
    Certificate,
    ContactResiduals,
    certificate_limit,
    contact_residuals,
)
from ddmpi.methods.newton import Newton
from ddmpi.run.solve import Solution, solve

two_ranks = pytest.mark.mpi(ranks=2)

LIMIT = certificate_limit(1e-8)
KINDS = ("force_mismatch", "penetration", "complementarity", "friction")

NORMAL, TANGENTIAL = np.array([2e6, 1e6, 1e6, 0.0]), np.array([0.3e6, 0.5e6, -0.5e6, 0.0])
"""Forces (N) of an answer with coefficient 0.5: a node that sticks, two that slip to both sides, an open one."""

GAP, APPROACH, SLIP = (
    np.array([0.0, 1e-3, 0.0, 2e-3]),
    np.array([0.0, 1e-3, 0.0, 1e-3]),
    [0.0, 2e-4, -2e-4, 5e-4],
)
"""Its initial gaps, and how far the bodies move towards and along each other (m)."""

S, U, LOAD, OFF = 2e6, 0.7e-3, 1e7, 1e-2
"""Its largest force (N) and displacement (m); the loads (N); an error, relative."""


def contact(gap: np.ndarray = GAP, law: Law | None = None) -> Interface:
    """Four nodes at x = 1, 2, 3, 4 below the first body."""
    nodes, alone = np.arange(4), sparse.identity(4, format="csr")
    law, xy = (
        law or CoulombLaw(4, nodes, 1, np.full(4, 0.5)),
        np.column_stack([nodes + 1.0, np.zeros(4)]),
    )
    return Interface(
        name="seam",
        bodies=("upper", "lower"),
        geometry=Geometry(
            xy=xy,
            tangents=np.tile([1.0, 0.0], (4, 1, 1)),
            area=np.full(4, 0.5),
            at=(xy, xy),
            facets=np.empty((0, 2), int),
            laplacian=sparse.csr_matrix((4, 4)),
        ),
        rows=Places((nodes, nodes), np.tile([0.0, -1.0], (4, 1)), gap.copy(), (alone, alone)),
        law=law,
        modulus=1e11,
    )


def answer() -> dict[str, np.ndarray]:
    """All that a contact's residuals are computed from; the first body takes seven tenths of each displacement."""
    u = np.concatenate([APPROACH, SLIP])
    return {
        "s": np.concatenate([NORMAL, TANGENTIAL]),
        "mismatch": np.zeros(8),
        "first": 0.7 * u,
        "second": 0.3 * u,
        "gap": GAP.copy(),
    }


def state_of(parts: dict[str, np.ndarray], law: Law | None = None) -> ContactState:
    interface = contact(parts["gap"], law)
    return contact_state(
        interface, parts["s"], interface.law.bound_at(parts["s"]), parts["first"] + parts["second"]
    )


def judged(
    parts: dict[str, np.ndarray], law: Law | None = None, **numbers: float
) -> ContactResiduals:
    numbers = {"load": LOAD, "yielding": 1.0, "moved": 1e-3} | numbers
    yielding = numbers.pop("yielding")
    numbers["everywhere"] = numbers.pop("moved"), yielding  # there is no other contact
    return contact_residuals(
        replace(state_of(parts, law), yielding=yielding),
        parts["s"],
        parts["mismatch"],
        (parts["first"], parts["second"]),
        **numbers,
    )


def test_a_right_answer_has_no_residual():
    found = judged(answer())
    assert all(getattr(found, kind) <= 1e-15 for kind in KINDS)
    assert Certificate({"seam": found}, {"upper": 0.0}).violations(LIMIT) == []


SPOILT = {
    # what: changes (part, entry, by), residuals that they cause
    "forces that do not cancel": (
        [("mismatch", 3, OFF * np.hypot(*[np.linalg.norm(f) for f in (NORMAL, TANGENTIAL)]))],
        {"force_mismatch": OFF / np.hypot(1.0, OFF)},
    ),
    "overlap under pressure": (
        [("second", 0, OFF * U)],
        {"penetration": OFF, "complementarity": OFF / 2},
    ),
    "gap under pressure": ([("second", 0, -OFF * U)], {"complementarity": OFF / 2}),
    "overlap of an open node": ([("gap", 3, -1e-3 - OFF * U)], {"penetration": OFF}),
    "overlap through the initial gap": (
        [("gap", 0, -OFF * U)],
        {"penetration": OFF, "complementarity": OFF / 2},
    ),
    "force at an open node": (
        [("s", 3, OFF * S)],
        {"complementarity": OFF * S * 1e-3 / ((4e6 + OFF * S) * U), "friction": OFF / 2},
    ),  # it slips, with no force along
    "tension": ([("s", 3, -OFF * S)], {"complementarity": OFF}),
    "friction beyond its bound": ([("s", 5, OFF * S)], {"friction": OFF}),
    "friction below its bound where the node slips": ([("s", 5, -OFF * S)], {"friction": OFF}),
    "friction at an open node": ([("s", 7, OFF * S)], {"friction": OFF}),
    "slip below the bound": ([("second", 4, OFF * U)], {"friction": OFF}),
    "slip against the force": ([("second", 5, -2e-4 - OFF * U)], {"friction": OFF}),
    "slip against the other force": ([("second", 6, 2e-4 + OFF * U)], {"friction": OFF}),
}


def check_spoilt(
    parts, changes, expected: dict[str, float], law: Law | None = None
) -> ContactResiduals:
    """Residuals of a right answer after changes (part, entry, by): the expected ones, and no others."""
    for part, entry, by in changes:
        parts[part][entry] += by
    found = judged(parts, law)
    for kind in KINDS:
        assert getattr(found, kind) == pytest.approx(
            expected.get(kind, 0.0), rel=1e-6, abs=1e-14
        ), kind
    return found


@pytest.mark.parametrize("what", SPOILT)
def test_a_wrong_answer_has_the_residual_of_its_error(what):
    changes, expected = SPOILT[what]
    found = check_spoilt(answer(), changes, expected)
    said = Certificate({"seam": found}, {"upper": 0.0}).violations(LIMIT)
    assert {
        text.rpartition(" of ")[0].rpartition(" ")[0].replace(" ", "_") for text in said
    } == set(expected)


@pytest.mark.parametrize("part", ["s", "mismatch", "first", "second", "gap"])
def test_no_answer_with_a_number_that_is_none_is_certified(part):
    for law, right in ((None, answer), (BONDED, bond)):
        for entry in range(len(right()[part])):
            parts = right()
            parts[part][entry] = np.nan
            assert Certificate({"seam": judged(parts, law)}, {"upper": 0.0}).violations(1e9), entry
    for equilibrium in ({"upper": np.nan, "lower": 1.0}, {"upper": 1.0, "lower": np.nan}):
        certificate = Certificate({"seam": judged(answer())}, equilibrium)
        assert np.isnan(certificate.worst()["equilibrium"][0])
        assert len(certificate.violations(1e9)) == 1


def test_where_nothing_presses_forces_are_compared_with_the_loads():
    parts = answer()
    parts["s"][:] = 0.0
    parts["mismatch"][0] = OFF * LOAD / 2  # a node's share is the load over √m
    assert judged(parts).force_mismatch == pytest.approx(OFF)
    parts = answer()
    parts["s"] *= 1e-9
    parts["mismatch"][0] = OFF * 1e-6 * LOAD / 2
    assert judged(parts).force_mismatch == pytest.approx(OFF)


def test_what_is_small_beside_the_loads_of_other_steps_is_judged_by_itself():
    """Late in a history errors of 1e-12 of what there was before are rounding; those of a small load still count."""
    parts = {name: 1e-4 * values for name, values in answer().items()}
    parts["second"][0] += 1e-4 * OFF * U
    scale = {"moved": 1e-7, "yielding": 1e-4}
    assert judged(parts, **scale, former=(1e-3, 1e-3)).penetration == pytest.approx(OFF, rel=1e-6)
    nothing = {name: 1e-7 * values for name, values in parts.items()}
    scale = {"moved": 1e-14, "yielding": 1e-14}
    assert judged(nothing, **scale).penetration > LIMIT
    assert judged(nothing, **scale, former=(1e-3, 1e-3)).penetration <= LIMIT


def test_displacements_are_compared_with_what_the_forces_cause():
    """A body that moves far as a whole does not flatter the overlap."""
    parts = answer()
    parts["first"] += 1.0
    parts["second"] -= 1.0
    parts["second"][0] += OFF * U
    assert judged(parts, yielding=U, moved=1.0).penetration == pytest.approx(OFF, rel=1e-6)
    assert judged(parts, yielding=0.0, moved=1.0).penetration == pytest.approx(
        1.0
    )  # no more than the overlap itself
    parts["second"][0] = -parts["first"][0] + 1e-10
    assert judged(parts, yielding=0.0, moved=1.0).penetration == pytest.approx(
        0.01
    )  # rounding of that motion


def test_bodies_that_overlap_and_do_not_move_are_not_certified():
    parts = {name: np.zeros_like(values) for name, values in answer().items()}
    parts["gap"][1] = -1e-6
    assert judged(parts, yielding=0.0, moved=0.0).penetration == np.inf


def test_without_friction_slip_is_free():
    parts, law = answer(), Law(4, np.empty(0, int), 1)
    for name in ("s", "mismatch", "first", "second"):
        parts[name] = parts[name][:4]
    assert judged(parts, law) == ContactResiduals(0.0, 0.0, 0.0, 0.0)
    parts["second"][0] += OFF * U
    assert judged(parts, law).penetration == pytest.approx(OFF)


def test_a_given_slip_bound_holds_at_open_nodes_too():
    parts, law = answer(), TrescaLaw(4, np.arange(4), 1, np.array([0.4e6, 0.5e6, 0.5e6, 0.5e6]))
    parts["s"][7] = 0.5e6
    assert judged(parts, law).friction == pytest.approx(0.0, abs=1e-15)
    parts["s"][7] = 0.5e6 + OFF * S
    assert judged(parts, law).friction == pytest.approx(OFF)


def test_in_space_friction_has_a_direction():
    """Two tangents: the force has the slip's direction, not only its components' signs."""
    law = CoulombLaw(1, np.array([0]), 2, np.array([0.5]))
    s, along, across = np.array([10.0, 3.0, 4.0]), np.array([[0.6, 0.8]]), np.array([[-0.8, 0.6]])
    assert law.violation(s, 2.0 * along, 1.0) <= 1e-14
    assert law.violation(s, -2.0 * along, 1.0) == pytest.approx(2.0)
    assert law.violation(s, 12.0 * across, 1.0) == pytest.approx(
        5.0 * np.linalg.norm((5.0 * along + 12.0 * across) / 13.0 - along)
    )
    assert law.violation(1.1 * s - [1.0, 0.0, 0.0], 0.0 * along, 1.0) == pytest.approx(0.5)


def test_the_state_of_the_nodes():
    """Gap, slip, status, stresses, and the resultant and moment of the forces on the first body, which is above."""
    state = state_of(answer())
    assert state.status.tolist() == ["stick", "slip", "slip", "open"]
    assert state.gap == pytest.approx([0.0, 0.0, 0.0, 1e-3], abs=1e-18)
    assert state.slip[:, 0] == pytest.approx(SLIP)
    assert state.pressure == pytest.approx(NORMAL / 0.5)
    assert state.shear[:, 0] == pytest.approx(TANGENTIAL / 0.5)
    assert state.force == pytest.approx([-0.3e6, 4e6])
    assert state.moment == pytest.approx(1 * 2e6 + 2 * 1e6 + 3 * 1e6)


def test_the_spoilt_contact_and_body_are_named():
    right, parts = judged(answer()), answer()
    parts["gap"][3] -= 1e-3 + OFF * U
    for names in (("left", "right"), ("right", "left")):
        certificate = Certificate(
            dict(zip(names, (judged(parts), right), strict=True)),
            {"upper": 1e-15, "middle": 1e-3, "lower": 1e-14},
        )
        worst = certificate.worst()
        assert worst["penetration"] == (pytest.approx(OFF), names[0])
        assert worst["equilibrium"] == (1e-3, "middle")
        assert certificate.violations(LIMIT) == [
            f"penetration 1.0e-02 of {names[0]}",
            "equilibrium 1.0e-03 of middle",
        ]
        assert certificate.violations(2e-3) == [f"penetration 1.0e-02 of {names[0]}"]
        assert certificate.contacts[names[1]].penetration <= 1e-15


@pytest.mark.parametrize(
    "tolerance, limit", [(1e-15, 1e-10), (1e-8, 5e-7), (1e-4, 5e-3), (0.01, 0.05), (0.5, 0.05)]
)
def test_the_limit_follows_the_tolerance_within_bounds(tolerance, limit):
    assert certificate_limit(tolerance) == pytest.approx(limit, rel=1e-12)


# The certificate of a run


@pytest.mark.slow
@two_ranks
def test_a_solved_scene_that_is_spoilt_is_not_certified(comm, monkeypatch):
    from ddmpi.methods.outer import no_report
    from ddmpi.run.solve import Iteration
    from ddmpi.system.clock import Clock

    assembly = scenes.prepare_scene(comm, scenes.pinched_blocks(4))
    solution = solve(assembly, assembly.scene.method)
    newton, forces = solution.outer, solution.outer.forces
    iteration = Iteration(assembly, assembly.scene.method, no_report, Clock())
    iteration.outer = newton

    def concluded(stopped: str = "converged") -> Solution:
        return iteration.conclude(stopped)

    def move(s: np.ndarray) -> None:
        newton._at = newton._at._replace(point=newton._at.point._replace(s=s))

    def worst() -> dict[str, tuple[float, str]]:
        return concluded().certificate.worst()

    def large(found: dict[str, tuple[float, str]]) -> set[str]:
        return {kind for kind, (value, _) in found.items() if not value <= solution.limit}

    assert solution.certified
    assert large(worst()) == set()
    assert concluded().certified and not concluded("max_iterations").certified
    move(1.01 * forces)
    assert not concluded().certified
    assert "complementarity" in large(worst())
    move(0.99 * forces)
    assert large(worst()) >= {"penetration", "complementarity"}
    move(forces.copy())
    newton.forces[sum(each.m for each in assembly.space.interfaces) :] = 0.0  # of this rank
    assert "friction" in large(worst())
    move(forces)
    assert large(worst()) == set()

    with monkeypatch.context() as patch:
        patch.setattr(Newton, "mismatch", property(lambda self: -OFF * self.forces))
        found = worst()
        assert large(found) == {"force_mismatch"}
        assert found["force_mismatch"] == (pytest.approx(OFF), "upper-lower")

    right = assembly.member.C.solve
    for rank, body in enumerate(("upper", "lower")):

        def wrong(f, u, *rest, rank=rank):
            right(f, u, *rest)
            if comm.rank == rank:
                u.scale(1.0 + OFF)

        with monkeypatch.context() as patch:
            patch.setattr(assembly.member.C, "solve", wrong)
            value, name = worst()["equilibrium"]
        assert name == body
        assert 0.1 * OFF <= value <= 2 * OFF


def test_friction_is_judged_at_the_nodes_that_slide():
    """A node that clamps keep from sliding has no tangential entry; the others keep their own bounds."""
    law = CoulombLaw(4, np.array([1, 2, 3]), 1, np.array([0.5, 0.5, 0.5]))
    parts = answer()
    for name in ("s", "mismatch", "first", "second"):
        parts[name] = np.delete(parts[name], 4)
    assert judged(parts, law).friction <= 1e-15
    assert judged(
        parts, replace(law, coefficient=np.array([0.4, 0.5, 0.5]))
    ).friction == pytest.approx(0.1e6 / S)


# Bonded contacts

BONDED = BondedLaw(4, np.arange(4), 1)
TORN = {
    # what: changes (part, entry, by), residuals that they cause
    "nothing": ([], {}),
    "tension": ([("s", 0, -3 * S)], {}),
    "any tangential force": ([("s", 7, 5 * S)], {}),
    "an overlap": ([("second", 0, OFF * U)], {"penetration": OFF}),
    "an opening": ([("second", 0, -OFF * U)], {"penetration": OFF}),
    "an opening under no force": ([("gap", 3, OFF * U)], {"penetration": OFF}),
    "slip": ([("second", 5, OFF * U)], {"friction": OFF}),
    "slip to the other side": ([("second", 6, -OFF * U)], {"friction": OFF}),
    "forces that do not cancel": (
        [("mismatch", 3, OFF * np.hypot(*[np.linalg.norm(f) for f in (NORMAL, TANGENTIAL)]))],
        {"force_mismatch": OFF / np.hypot(1.0, OFF)},
    ),
}


def bond() -> dict[str, np.ndarray]:
    """Both bodies move seven tenths of the displacements above, together."""
    parts = answer()
    return parts | {"second": -parts["first"], "gap": np.zeros(4)}


@pytest.mark.parametrize("what", TORN)
def test_a_bond_neither_opens_nor_slips_whatever_its_forces(what):
    changes, expected = TORN[what]
    check_spoilt(parts := bond(), changes, expected, BONDED)
    assert state_of(parts, BONDED).status.tolist() == ["stick"] * 4


@pytest.mark.parametrize("load", [LOAD, 0.0])
def test_slip_without_any_force_is_seen(load):
    """A bond, or a given slip bound, that bears nothing although the bodies slide past each other."""
    tresca = TrescaLaw(4, np.arange(4), 1, np.full(4, 0.5e6))
    for law, least in (
        (BONDED, OFF),
        (tresca, 1e-6),
        (CoulombLaw(4, np.arange(4), 1, np.full(4, 0.5)), None),
    ):
        parts = bond()
        parts["s"][:] = 0.0
        assert judged(parts, law, load=load, yielding=U).friction == 0.0
        parts["second"][5] += OFF * U
        found = judged(parts, law, load=load, yielding=U).friction
        assert found == 0.0 if least is None else found >= 0.999 * least
