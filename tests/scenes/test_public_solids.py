"""Solids with published answers: eleven scenes by another program, and the model scene of two boxes in space."""

import numpy as np
import pytest
import scenes
from elsewhere import corners
from mpi4py import MPI
from solid_scenes import PUBLIC, two_boxes

import ddmpi

IMPOSSIBLE = [
    title for title, each in PUBLIC.items() if each["answer"]["status"] == "no equilibrium"
]
POSSIBLE = [title for title in PUBLIC if title not in IMPOSSIBLE]


@pytest.mark.parametrize("title", [*map(scenes.seldom, POSSIBLE[::2]), *POSSIBLE[1::2]])
def test_answer_is_the_published_one(title):
    """Displacements to 1e-6; resultants and statuses where no node belongs to several contacts, thus unique."""
    scene, known = PUBLIC[title]["scene"], PUBLIC[title]["answer"]
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    assert answer.certified, answer.reason
    largest = known["displacement_max"]
    assert answer.summary["displacement_max"] == pytest.approx(largest, rel=1e-6)
    for spec in scene["body"]:
        body = answer.bodies[spec["name"]]
        for at, u in zip(
            corners(spec["mesh"])[[0, 6]], known["corners"][spec["name"]], strict=True
        ):
            node = np.linalg.norm(body.points - at, axis=1).argmin()
            assert np.abs(body.displacement[node] - u).max() <= 1e-6 * largest
    assert len(answer.summary["steps"]) == len(known["steps"])
    for step, expected in zip(answer.summary["steps"], known["steps"], strict=True):
        for found, each in zip(step["contacts"].values(), expected, strict=True):
            if each["shared_nodes"]:
                continue
            assert [found[key] for key in ("open", "slip", "stick")] == [
                each[key] for key in ("open", "slip", "stick")
            ]
            size = np.abs(each["force"]).max()
            assert np.abs(np.subtract(found["force"], each["force"])).max() <= 1e-6 * size
            assert (
                np.abs(np.subtract(found["moment"], each["moment"])).max()
                <= 1e-6 * np.abs(each["moment"]).max()
            )


@pytest.mark.parametrize("title", [*map(scenes.seldom, IMPOSSIBLE[:-1]), IMPOSSIBLE[-1]])
@pytest.mark.clarabel
def test_what_cannot_stand_is_refused_by_the_command(title, tmp_path):
    """Exit code 3, and a reason that names it."""
    path = scenes.write_scene(PUBLIC[title]["scene"], tmp_path / "scene.toml")
    run = scenes.run_here(path, tmp_path / "results")
    assert run.code == 3, run.output
    assert run.summary["converged"] is False
    assert "no equilibrium" in run.summary["reason"]


def boxes(
    *arguments,
    steps: int,
    inner: int,
    force: tuple[float, ...],
    m: int,
    rel: float = 1e-6,
    slow: bool = False,
    **keys,
):
    """A row of the table of two boxes: Newton steps, GMRES iterations, resultants along y, x and z, and rows."""
    return pytest.param(
        arguments,
        keys,
        steps,
        inner,
        force,
        m,
        rel,
        marks=[pytest.mark.slow] if slow else [],
        id=" ".join(map(str, (*arguments, *keys.values()))),
    )


TRESCA = {"law": "tresca", "slip_bound": 1.2e7}


@pytest.mark.parametrize(
    "arguments, keys, steps, inner, force, m, rel",
    [
        boxes(4, steps=8, inner=73, force=(1.13363555e8, -8.0786785e6, -4.9433846e6), m=60),
        boxes(
            4,
            law=TRESCA,
            steps=8,
            inner=75,
            force=(1.13303709e8, -7.5050547e6, -4.6935660e6),
            m=60,
            slow=True,
        ),
        boxes(
            8, steps=10, inner=98, force=(1.146577e8, -8.234903e6, -4.547908e6), m=216, slow=True
        ),
        boxes(4, order=2, steps=8, inner=94, force=(1.15468e8,), m=65, rel=1e-4, slow=True),
    ],
)
def test_two_boxes(arguments, keys, steps, inner, force, m, rel):
    """Resultants by another program, of order 2 by this one (fine meshes have 1.1583e8); iterations within 1.2."""
    order = keys.get("order", 1)
    answer = ddmpi.solve(two_boxes(*arguments, **keys), MPI.COMM_SELF)
    assert answer.certified, answer.reason
    summary, contact = answer.summary, answer.summary["contacts"]["upper-lower"]
    assert (summary["order"], contact["m"]) == (order, m)
    assert contact["pairing"] == (
        "nodes" if order == 1 and len(arguments) == 1 and "pairing" not in keys else "mortar"
    )
    assert np.array(contact["force"])[[1, 0, 2]][: len(force)] == pytest.approx(force, rel=rel)
    assert summary["outer_iterations"] <= 1.2 * steps
    assert summary["inner_iterations"] <= 1.2 * inner


@pytest.mark.slow
@pytest.mark.parametrize("part", [scenes.seldom(0.8), 1.2])
def test_a_twisted_block(part):
    """Friction on a square holds 0.8 of the torque that a uniform pressure gives, and not 1.2, though forces at nodes
    that balance it exist: ∫ r dA of a unit square about its centre is (√2 + ln(1 + √2)) / 6, ∫ r² dA is 1/6."""
    pressure, friction = 1e6, 0.3
    shear = part * friction * pressure * (2**0.5 + np.log(1.0 + 2**0.5))
    block = {
        "name": "block",
        "mesh": {"shape": "box", "size": [1.0, 1.0, 0.6], "divisions": [4, 4, 2]},
        "material": {"young": 2e9, "poisson": 0.25},
        "traction": [
            {"on": "top", "value": [f"-{shear} * (y - 0.5)", f"{shear} * (x - 0.5)", -pressure]}
        ],
    }
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    contact = {
        "bodies": ["block", "floor"],
        "on": ["bottom"],
        "friction": {"law": "coulomb", "coefficient": friction},
    }
    answer = ddmpi.solve({"body": [block], "rigid": [floor], "contact": [contact]}, MPI.COMM_SELF)
    assert answer.certified == (part < 1.0)
    if part > 1.0:
        assert answer.reason.startswith("no equilibrium found: block would ")
        assert ", 0.3) along z" in answer.reason
        assert answer.summary["outer_iterations"] <= 60
    else:
        assert answer.contacts["block-floor"].moment[2] == pytest.approx(-shear / 6.0, rel=1e-6)
