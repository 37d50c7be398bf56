"""Bodies on several ranks each: the answers of one rank each, and errors on any rank end all of them."""

import json

import fault
import numpy as np
import pytest
import scenes
from fault_cases import run_in_one_go
from scenes import COULOMB, FLOOR, pinched_blocks, rectangle, to_toml

import ddmpi
from ddmpi.coupling.ranks import place_ranks
from ddmpi.run.answer import Answer
from ddmpi.system.numbers import bisect

pytestmark = pytest.mark.slow

METHODS = {
    "explicit": {"compliance": "explicit"},
    "direct": {"compliance": "direct"},
    "iterative": {"compliance": "iterative", "tolerance": 1e-11},
}


def loose_block(**method) -> dict:
    """A block that rests on a rigid floor, held along it by its weight's friction and a roller only."""
    return {
        "title": "loose",
        "method": method,
        "body": [
            rectangle(
                "block",
                (0, 0),
                (3, 1),
                (18, 6),
                young=2e11,
                clamp=[{"on": "left", "x": 0.0}],
                traction=[{"on": "top", "value": [2e6, -1e7]}],
            )
        ],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": COULOMB}],
    }


def free_block(**method) -> dict:
    """A block without any clamp in a corner of two rigid planes."""
    scene = loose_block(**method)
    scene["body"][0] |= {"clamp": [], "traction": [{"on": "top", "value": [-2e6, -1e7]}]}
    scene["rigid"].append(
        {"name": "wall", "shape": "plane", "point": [0.0, 0.0], "normal": [1.0, 0.0]}
    )
    scene["contact"].append({"bodies": ["block", "wall"], "on": ["left"], "friction": COULOMB})
    return scene


SCENES = {
    "two blocks": pinched_blocks,
    "one loose block": loose_block,
    "one free block": free_block,
}


def both_ways(comm, scene: dict) -> tuple[Answer, Answer, dict, dict]:
    """Answers of a rank for each body and of all ranks of `comm`, with all bodies' displacements, on all ranks."""
    import petsc4py

    petsc4py.init(comm=comm)
    text, bodies = to_toml(scene), len(scene["body"])
    part = comm.Split(int(comm.rank >= bodies))
    few = ddmpi.solve(text, part) if comm.rank < bodies else None
    many = ddmpi.solve(text, comm)
    moved = [
        {
            name: body.displacement
            for own in comm.allgather(answer.bodies if answer else {})
            for name, body in own.items()
        }
        for answer in (few, many)
    ]
    part.Free()
    return few or many, many, *moved


def compare(comm, scene: dict) -> None:
    few, many, u, v = both_ways(comm, scene)
    assert few.certified and many.certified
    assert many.summary["ranks"] == len(many.summary["hosts"]) == comm.size
    assert sorted(
        rank for body in many.summary["bodies"].values() for rank in body["ranks"]
    ) == list(range(comm.size))
    assert set(u) == set(v) == {body["name"] for body in scene["body"]}
    for name in u:
        assert np.abs(u[name] - v[name]).max() <= 1e-9 * np.abs(u[name]).max()
    for name in few.contacts:
        assert few.contacts[name].status.tolist() == many.contacts[name].status.tolist()
    for name, body in few.summary["bodies"].items():
        assert many.summary["bodies"][name]["compliance"] == body["compliance"]


@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize(
    "name, kind",
    [
        ("two blocks", "explicit"),
        ("two blocks", "iterative"),
        ("one loose block", "iterative"),
        ("one free block", "direct"),
    ],
)
def test_three_ranks_answer_as_one_for_each_body(comm, name, kind):
    """However a body's compliance is made, and whether clamps hold it: displacements to 1e-9, the same statuses."""
    compare(comm, SCENES[name](**(METHODS[kind] | ({"N": 6} if name == "two blocks" else {}))))


@pytest.mark.mpi(ranks=2)
def test_two_ranks_where_petsc_calls_mumps(comm, petsc_options):
    """As where this version of MUMPS is not known: the compliance is explicit all the same."""
    petsc_options(body_mat_mumps_icntl_10=0)
    scene = loose_block()
    scene["body"][0]["mesh"]["divisions"] = [9, 3]
    compare(comm, scene)


@pytest.mark.mpi(ranks=5)
def test_five_ranks(comm):
    """On a body of a few nodes; on two bodies and one that nothing touches."""
    scene = loose_block()
    scene["body"][0]["mesh"]["divisions"] = [1, 1]
    compare(comm, scene)
    scene = pinched_blocks(6)
    scene["body"].append(
        rectangle(
            "alone",
            (9, 0),
            (3, 3),
            (20, 20),
            young=1e11,
            clamp=["bottom"],
            traction=[{"on": "top", "value": [0.0, -1e7]}],
        )
    )
    compare(comm, scene)


@pytest.mark.mpi(ranks=3)
def test_quadratic_elements_and_meshes_that_become_finer(comm):
    """Each mesh of an accuracy target is dealt out anew."""
    scene = pinched_blocks(4, target_error=0.05)
    for body in scene["body"]:
        body["mesh"]["order"] = 2
    compare(comm, scene)


@pytest.mark.mpi(ranks=3)
def test_options_reach_the_solvers_of_all_ranks(comm, petsc_options):
    petsc_options(body_ksp_type="cg", body_pc_type="jacobi")
    answer = ddmpi.solve(to_toml(pinched_blocks(4)), comm)
    assert answer.certified
    assert {body["solver"] for body in answer.summary["bodies"].values()} == {"cg + jacobi"}


# Errors


FAULTS = {
    # where: rank (0 and 1 have the first body, 2 the second one), target, call, fault, exit codes
    "mesh, root": (0, "ddmpi.coupling.parts.build_mesh", 1, "InputError", {2}),
    "assemble, other root": (2, "ddmpi.coupling.parts.assemble", 1, "SolverError", {4}),
    "outer, root": (0, "ddmpi.body.compliance.Compliance.mult", 12, "SolverError", {4}),
    "outer, internal error on a root": (
        2,
        "ddmpi.body.compliance.Compliance.mult",
        12,
        "RuntimeError",
        {1},
    ),
    "factor, root, before PETSc": (0, "ddmpi.coupling.team.Share.factor", 1, "SolverError", {4}),
    "factor, other rank, after MUMPS": (
        1,
        "ddmpi.petsc.mumps.Factors._check",
        1,
        "RuntimeError",
        {1},
    ),
    "end of a command, other rank": (1, "ddmpi.coupling.team.Share.machine", 1, "MemoryError", {4}),
    "an error of a solver, other rank": (
        1,
        "ddmpi.body.solver.StiffnessSolver._solve_with",
        1,
        "SolverError",
        {4},
    ),
    "killed, other rank": (1, "ddmpi.coupling.team.Share.solve", 1, "SIGKILL", None),
    "terminated, root": (0, "ddmpi.body.compliance.Compliance.mult", 12, "SIGTERM", {6}),
}


IMPATIENT = f"""
import runpy
from ddmpi.coupling import team
team.GRACE = 1.0
runpy.run_path({fault.__file__!r}, run_name="__main__")
"""
ORDERLY = ("mesh, root", "assemble, other root", "outer, root", "terminated, root")
"""These end on all ranks, so that one child has them one after another."""


def test_an_error_that_is_agreed_on_ends_all_in_order(tmp_path):
    """With one message, one exit code and no results."""
    scene = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    runs = run_in_one_go(
        [(*FAULTS[where][:4], str(tmp_path / where), []) for where in ORDERLY],
        "run",
        str(scene),
        "--no-figures",
        ranks=3,
    )
    for where, run in zip(ORDERLY, runs, strict=True):
        assert {run.code} == FAULTS[where][4]
        assert run.stderr.count("ddmpi: ") == 1 and run.files == set(), run.output


@pytest.mark.parametrize("where", [where for where in FAULTS if where not in ORDERLY])
def test_an_error_on_any_rank_ends_all(where, tmp_path):
    """With one message and its exit code, in time; a rank that failed waits for the others for a second, not five."""
    rank, target, call, kind, codes = FAULTS[where]
    scene = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    faults = [(rank, target, call, kind, str(tmp_path / "results"), [])]
    run = scenes.run_python(
        ["-c", IMPATIENT, json.dumps(faults), "run", str(scene), "--no-figures"], 3
    )
    assert run.code in codes if codes else run.code != 0
    assert not codes or sum("ddmpi: " in line for line in run.stderr.splitlines()) == 1, run.output
    assert not (tmp_path / "results" / "summary.json").exists()


# Who gets what


def test_ranks_go_where_a_rank_has_most():
    assert place_ranks([100, 100], 3) == [0, 0, 1]
    assert place_ranks([100, 300], 4) == [0, 1, 1, 1]
    assert place_ranks([100, 300, 1000], 7) == [0, 1, 1, 2, 2, 2, 2]
    assert place_ranks([100, None], 4) == [0, 0, 1, 1]


def test_parts_of_a_mesh_are_of_one_size_and_compact():
    x, y = np.meshgrid(np.arange(30.0), np.arange(10.0))
    points = np.column_stack([x.ravel(), y.ravel()])
    for parts in (1, 2, 3, 5, 8):
        part = bisect(points, parts)
        sizes = np.bincount(part, minlength=parts)
        assert len(sizes) == parts and np.ptp(sizes) <= 3
        assert sum(np.prod(np.ptp(points[part == k], axis=0) + 1) for k in range(parts)) <= 400
    assert bisect(points[:2], 5).tolist() == sorted(bisect(points[:2], 5).tolist())
    assert (bisect(points, 4) == bisect(points.copy(), 4)).all()
