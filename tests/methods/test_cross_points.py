"""Where a body has several contacts, its nodes give way to the forces of all of them, and GMRES knows."""

import numpy as np
import pytest
import scipy.sparse as sparse
from mpi4py import MPI
from scenes import certified, prepare_scene, rectangle, to_toml
from solid_scenes import box, two_boxes

import ddmpi

pytestmark = pytest.mark.slow


def cube(side: int, N: int, pairing: str) -> dict:
    """Loose cubes in rows, columns and layers on a rigid floor, Coulomb 0.5; by mortar every other one is finer."""
    law = {"friction": {"law": "coulomb", "coefficient": 0.5}}
    scene: dict = {
        "rigid": [{"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}],
        "body": [],
        "contact": [],
        "method": {"tolerance": 1e-8},
    }
    for x, y, z in np.ndindex(side, side, side):
        fine = N + ((x + y + z) % 2 if pairing == "mortar" else 0)
        loads = [{"on": "top", "value": [0.0, 0.0, -1e5]}] * (z == side - 1)
        scene["body"].append(
            {
                "name": f"b{x}{y}{z}",
                "mesh": {
                    "shape": "box",
                    "origin": [x, y, z],
                    "size": [1, 1, 1],
                    "divisions": [fine, fine, fine],
                },
                "material": {"young": 2e9, "poisson": 0.3},
                "volume_force": [0.0, 0.0, -25e3],
                "traction": loads + [{"on": "left", "value": [2e3, 0.0, 0.0]}] * (x == 0),
            }
        )
        if z == 0:
            scene["contact"].append({"bodies": [f"b{x}{y}0", "floor"], "on": ["bottom"]} | law)
        for X, Y, Z, *on in (
            (x + 1, y, z, "right", "left"),
            (x, y + 1, z, "back", "front"),
            (x, y, z + 1, "top", "bottom"),
        ):
            if max(X, Y, Z) < side:
                scene["contact"].append(
                    {"bodies": [f"b{x}{y}{z}", f"b{X}{Y}{Z}"], "on": on, "pairing": pairing} | law
                )
    return scene


@pytest.mark.parametrize(("pairing", "most"), [("nodes", 9.0), ("mortar", 9.5)])
def test_gmres_knows_edges_where_bricks_meet(pairing, most):
    """Twice the iterations where half-spaces know one contact only, 10 a step where each is solved to 1e-3."""
    answer = ddmpi.solve(to_toml(cube(2, 4, pairing)), MPI.COMM_SELF)
    outer = answer.solved.solution.outer
    assert answer.certified
    assert outer.inner_steps["gmres"] <= most * len(outer.history)


@pytest.mark.parametrize("pairing", ["nodes", "mortar"])
def test_less_precise_steps_are_no_more_steps(pairing):
    """Two boxes take 9 and 10 steps, as with 1e-3 in all of them, and 20 where the first one has 1e-2 as well."""
    answer = ddmpi.solve(two_boxes(8, pairing=pairing), MPI.COMM_SELF)
    precision = [step.inner_precision for step in answer.solved.solution.outer.history]
    assert answer.certified
    assert len(precision) <= 12
    assert precision[:2] == [1e-3, 1e-2]
    assert precision[-1] < 1e-2


@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize("ranks", [2, 3])
def test_edges_are_the_same_on_any_ranks(ranks):
    """What forces at the edges of bricks do to each other does not depend on who holds the bricks."""
    comm = MPI.COMM_WORLD.Split(0 if MPI.COMM_WORLD.rank < ranks else 1)
    found = []
    for each in (comm, MPI.COMM_SELF):
        joint = prepare_scene(each, cube(2, 2, "nodes")).joint
        space, crossing = joint.space, joint.cross_points()
        every, soft = sparse.identity(space.size, format="csr"), np.full(space.size, 1e-9)
        correct = crossing.corrector(every, soft, joint.shared())
        w = [np.cos(np.arange(interface.size)) for interface in space.interfaces]
        corrected = correct(np.concatenate([np.empty(0), *w]))
        everyone = each.allgather({name: corrected[part] for name, part in space.parts.items()})
        found.append({name: values for own in everyone for name, values in own.items()})
    assert found[0].keys() == found[1].keys()
    for name, values in found[1].items():
        assert found[0][name] == pytest.approx(values, rel=1e-9, abs=1e-12), name


def fit_across_bonds(d: int, gap: float, **contact) -> dict:
    """Four blocks around a point, in space around an edge: bonded but for the upper two, which do not fit by `gap`."""
    make, up = (rectangle, (0.0, 1.0)) if d == 2 else (box, (0.0, 0.0, 1.0))
    steps = {"a": 0.0 * np.array(up), "b": np.eye(d)[0], "c": np.array(up), "d": np.eye(d)[0] + up}
    bodies = [
        make(name, at.tolist(), (1.0,) * d, (3,) * d, young=3e10, poisson=0.2)
        for name, at in steps.items()
    ]
    for body in bodies[:2]:
        body["clamp"] = ["bottom"]
    bonds = [
        {"bodies": list(names), "on": list(on), "kind": "bonded"}
        for *names, on in (
            ("a", "b", ("right", "left")),
            ("c", "a", ("bottom", "top")),
            ("d", "b", ("bottom", "top")),
        )
    ]
    return {
        "body": bodies,
        "contact": [*bonds, {"bodies": ["c", "d"], "on": ["right", "left"], "gap": gap} | contact],
    }


@pytest.mark.parametrize(
    "law", [{}, {"friction": {"law": "coulomb", "coefficient": 0.3}}], ids=["smooth", "rough"]
)
@pytest.mark.parametrize("d", [2, 3])
def test_an_overlap_that_bonds_keep_is_left_out(d, law):
    """A chain of bonds holds both sides of the fit at the cross point: the rest is solved, with a warning."""
    answer = certified(fit_across_bonds(d, -4e-6, **law))
    (warning,) = [each for each in answer.summary["warnings"] if "bonds of other contacts" in each]
    assert warning.startswith("contact.c-d: ") and "overlap of 4e-06" in warning
    state = answer.contacts["c-d"]
    at_edge = state.interface.xy[:, -1] == 1.0
    assert (state.interface.gap[at_edge] == 0.0).all() and (
        state.interface.gap[~at_edge] == -4e-6
    ).all()
    assert state.force[0] < -1e3


def test_a_gap_that_bonds_keep_open_is_no_contradiction():
    """Where bonds hold the sides apart or in touch nothing is changed."""
    for gap in (0.0, 4e-6):
        answer = certified(fit_across_bonds(2, gap))
        assert not [each for each in answer.summary["warnings"] if "bonds" in each]
        assert (answer.contacts["c-d"].interface.gap == gap).all()


def test_bonds_and_fits_on_an_axis_are_solved():
    """Rows of quadratic elements on an axis stand for two nodes each, and are left as they are."""
    scene = fit_across_bonds(2, -4e-6) | {"axisymmetric": True}
    for body in scene["body"]:
        body["mesh"]["order"] = 2
    scene["contact"] += [scene["contact"].pop(1) | {"kind": "unilateral", "gap": -1e-6}]
    answer = certified(scene)
    assert answer.contacts["c-a"].interface.gap.max() < 0.0


@pytest.mark.mpi(ranks=2)
def test_an_overlap_that_bonds_keep_is_found_across_ranks(comm):
    """The chain of bonds goes through bodies of another rank."""
    answer = certified(fit_across_bonds(2, -4e-6), comm)
    if comm.rank == 0:
        assert sum("bonds of other contacts" in each for each in answer.summary["warnings"]) == 1
