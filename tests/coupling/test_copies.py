"""Copies of bodies: the answers of bodies with meshes of their own."""

from copy import deepcopy
from unittest import mock

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, by_name, certified, rectangle, to_toml
from test_alike import FRICTION, bricks, pile

from ddmpi.body import solver
from ddmpi.coupling.assembly import prepare
from ddmpi.mesh import geometry
from ddmpi.scene.reader import read_scene

WOOD = {"young": [8e9, 2e9, 1e9], "poisson": [0.3, 0.2, 0.25]}


def by_copies(scene: dict, placed: list[dict]) -> dict:
    """The scene in which bodies but the first are copies of it."""
    copied = deepcopy(scene)
    original = copied["body"][0]["name"]
    for body, motion in zip(copied["body"][1:], placed, strict=True):
        del body["mesh"], body["material"]
        body["copy"] = {"of": original} | motion
    return copied


def arch(order: int) -> tuple[dict, list[dict]]:
    """Four stones of wood in a quarter ring, each with its own load along the axes; and the turns of copies."""
    bodies = []
    for k in range(4):
        mesh = {"shape": "annulus", "center": [0.0, 1.0], "radii": [1.0, 1.5], "order": order}
        mesh |= {"angles": [22.5 * k, 22.5 * (k + 1)], "divisions": [4, 4]}
        wood = WOOD | {"shear": 1e9, "angle": 22.5 * k + 10.0, "expansion": [1e-5, 4e-5, 0.0]}
        load = {"on": "outer", "value": [-1e5 * k, "-1e5 * (2 + x)"]}
        body = {"name": f"stone{k}", "mesh": mesh, "material": wood, "traction": [load]}
        bodies.append(body | {"volume_force": [0.0, -2e4], "temperature": f"{k} + x"})
    bodies[0]["clamp"], bodies[3]["clamp"] = ["start"], [{"on": "end", "x": 0.0, "y": 0.0}]
    turned = [{"turn": 22.5 * k, "pivot": [0.0, 1.0]} for k in range(1, 4)]
    return pile(bodies, ("start", "end")), turned


def wedges() -> tuple[dict, list[dict]]:
    """Three solids of wood around an axis parallel to z, each further along it; and the motions of copies."""
    corners = np.array(
        [[x, y, z] for z in (0.0, 1.0) for x, y in ((1.0, 0.0), (2.0, 0.0), (1.6, 1.2), (0.8, 0.6))]
    )
    bodies, motions = [], []
    for k in range(3):
        angle = k * np.arctan2(0.6, 0.8)
        turn = np.array(
            [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
        )
        at = corners @ turn.T + [0, 0, 0.25 * k]
        mesh = {"shape": "hexahedron", "corners": at.tolist(), "divisions": [2, 2, 4]}
        wood = WOOD | {"shear": [1e9, 1e9, 1e9], "axes": turn.T[:2].tolist()}
        load = {"on": "right", "value": [1e4 * k, -3e4, -1e4]}
        bodies.append({"name": f"wedge{k}", "mesh": mesh, "material": wood, "traction": [load]})
        motions.append({"turn": float(np.degrees(angle)), "axis": [0.0, 0.0, 2.0]})
        motions[-1]["shift"] = [0.0, 0.0, 0.25 * k]
    bodies[0]["clamp"] = bodies[2]["clamp"] = ["top"]
    return pile(bodies, ("front", "back")), motions[1:]


def rings() -> tuple[dict, list[dict]]:
    """Three rings around an axis on each other, and the shifts of copies."""
    bodies = [rectangle(f"ring{k}", [0.5, 0.5 * k], [0.5, 0.5], [3, 3]) for k in range(3)]
    bodies[0]["clamp"] = [{"on": "bottom", "x": 0.0, "y": 0.0}]
    bodies[2]["traction"] = [{"on": "top", "value": [1e4, -1e6]}]
    scene = pile(bodies, ("bottom", "top")) | {"axisymmetric": True}
    return scene, [{"shift": [0.0, 0.5 * k]} for k in (1, 2)]


COPIED = {
    "bricks": (bricks(), [{"shift": [0.125 * k, 0.25 * k]} for k in range(1, 5)]),
    "stones of order 1": arch(1),
    "stones of order 2": arch(2),
    "wedges": wedges(),
    "rings": rings(),
}


@pytest.mark.parametrize("case", by_name(COPIED, "rings"))
def test_copies_have_the_answers_of_separate_bodies(case):
    """Material axes turn with a copy; loads, clamps and temperatures are its own, in the axes of the scene."""
    scene, placed = case
    own, copied = certified(scene), certified(by_copies(scene, placed))
    assert copied.summary["outer_iterations"] == own.summary["outer_iterations"]
    for name, body in own.bodies.items():
        size = np.abs(body.displacement).max()
        assert copied.bodies[name].points == pytest.approx(body.points, abs=1e-14)
        assert copied.bodies[name].displacement == pytest.approx(body.displacement, abs=1e-9 * size)
    for name, contact in own.contacts.items():
        size = np.abs(contact.forces).max()
        assert copied.contacts[name].forces == pytest.approx(contact.forces, abs=1e-9 * size)


@pytest.mark.slow
def test_a_shifted_copy_is_the_separate_body_to_rounding():
    """A shape that is copied is the shape that stands there, bit for bit."""
    scene, placed = COPIED["bricks"]
    own, copied = certified(scene), certified(by_copies(scene, placed))
    for name, contact in own.contacts.items():
        assert (copied.contacts[name].forces == contact.forces).all()


def test_the_scene_of_a_result_is_solved_again():
    """The summary has copies as they are written, without mesh and material."""
    scene, placed = COPIED["stones of order 1"]
    one = certified(by_copies(scene, placed))
    assert {"mesh", "material"}.isdisjoint(one.summary["scene"]["body"][1])
    again = certified(one.summary["scene"])
    for name, contact in one.contacts.items():
        assert (again.contacts[name].forces == contact.forces).all()


def cylinders(count: int) -> dict:
    """Cylinders that gmsh meshes, on each other; the upper ones are copies of the lowest."""
    mesh = {"shape": "cylinder", "center": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0], "size": 0.5}
    mesh |= {"radii": [0.0, 1.0], "height": 1.0}
    body = {"name": "disc0", "mesh": mesh, "material": {"young": 1e9, "poisson": 0.3}}
    copies = [
        {"name": f"disc{k}", "copy": {"of": "disc0", "shift": [0.0, 0.0, 1.0 * k]}}
        for k in range(1, count)
    ]
    held = [{"on": "outer", "x": 0.0, "y": 0.0}]
    bodies = [each | {"clamp": held} for each in (body, *copies)]
    return pile(bodies, ("bottom", "top"), friction=FRICTION)


@pytest.mark.slow
def test_a_drawing_is_meshed_once_for_all_copies():
    """Elements are finer along the contacts of the original and of all copies, so that all have one mesh, and one
    factorization for those with the same candidates."""
    with (
        mock.patch.object(geometry, "mesh_geometry", wraps=geometry.mesh_geometry) as meshed,
        mock.patch.object(solver, "Factors", wraps=solver.Factors) as factors,
    ):
        assembly = prepare(MPI.COMM_SELF, read_scene("discs", to_toml(cylinders(4)), []))
    assert meshed.call_count == 1
    assert factors.call_count == 3  # the lowest, those between, the uppermost
    one, other = assembly.bodies[0].mesh, assembly.bodies[3].mesh
    assert other.home is one.home
    assert other.points == pytest.approx(one.points + np.array([0.0, 0.0, 3.0]), abs=1e-14)


def test_a_copy_of_a_copy_names_the_original():
    """A copy of a copy is refused with the body that has the mesh."""
    scene = by_copies(*COPIED["bricks"])
    for k in (2, 3):
        scene["body"][k]["copy"]["of"] = f"brick{k - 1}"
    assert_refused(scene, "'brick1' is a copy itself", 'write of = "brick0"')
    scene["body"][2]["copy"]["of"] = "brick0"
    assert_refused(scene, "'brick2' is a copy itself", 'write of = "brick0"')


def test_a_copy_is_where_its_cells_have_an_area():
    """Where coordinates are too large for the size of cells, the copy is named."""
    scene = by_copies(*COPIED["bricks"])
    scene["body"][4]["copy"]["shift"] = [1e18, 0.0]
    assert_refused(scene, "body.brick4.copy: so far away its cells have no area")


def test_a_modulus_is_differentiated_with_that_of_all_copies():
    """The key of the original's modulus changes its copies, too."""
    scene, placed = COPIED["bricks"]
    copied = by_copies(scene, placed) | {"method": {"tolerance": 1e-12}}
    copied["contact"] = [
        joint | {"kind": "bonded", "friction": {"law": "none"}} for joint in copied["contact"]
    ]
    key = "body.brick0.material.young"
    answer = certified(copied | {"output": {"derivatives": [key]}})
    young = copied["body"][0]["material"]["young"]
    # all moduli are alike, and forces are given: displacements are as 1/E
    for name, body in answer.bodies.items():
        size = np.abs(body.displacement).max() / young
        found = answer.derivative(key).bodies[name]["displacement"]
        assert found == pytest.approx(-body.displacement / young, abs=1e-6 * size)
