"""Bodies that are alike, as bricks of a wall: made once, with the answers of separate bodies."""

from itertools import pairwise
from unittest import mock

import msgspec
import numpy as np
import pytest
from mpi4py import MPI
from scenes import by_name, certified, rectangle, to_toml

import ddmpi
from ddmpi.body import solver
from ddmpi.coupling.assembly import prepare
from ddmpi.errors import InputError
from ddmpi.judge.motions import MotionsOfBody
from ddmpi.mesh.build import build_mesh
from ddmpi.run.equilibrium import with_partners
from ddmpi.scene.meshes import MeshSpec
from ddmpi.scene.reader import read_scene
from meshes import body_of

FRICTION = {"law": "coulomb", "coefficient": 0.3}


def pile(bodies: list[dict], on: tuple[str, str], **keys) -> dict:
    """Bodies on each other, the first one below."""
    joints = [
        {"bodies": [upper["name"], lower["name"]], "on": list(on), "friction": FRICTION} | keys
        for lower, upper in pairwise(bodies)
    ]
    return {"body": bodies, "contact": joints, "method": {"tolerance": 1e-10}}


def bricks(apart: float = 0.0, number: int = 5, **keys) -> dict:
    """Bricks of which all but the first and the last are alike, the upper ones `apart` (m) from the others."""
    bodies = [
        rectangle(f"brick{k}", [0.125 * k, 0.25 * k + apart * (k > 2)], [2.0, 0.25], [4, 1])
        | {"traction": [{"on": "left", "value": [1e3 * (k + 1), 0.0]}]}
        for k in range(number)
    ]
    bodies[0]["clamp"] = ["bottom"]
    bodies[-1]["traction"] = [{"on": "top", "value": [1e4, "-2e5 * (1 + x)"]}]
    return pile(bodies, ("bottom", "top"), **keys)


def held_bricks() -> dict:
    """The same with two of the alike bricks held at the left, one along each axis, and one moved there."""
    scene = bricks()
    for k, held in enumerate(({"x": 0.0}, {"y": 0.0}, {"x": 1e-5}), 1):
        scene["body"][k] |= {"clamp": [{"on": "left"} | held], "traction": []}
    return scene


def quadrilaterals() -> dict:
    """Trapezoids that get further to the right, of order 2."""
    bodies = []
    for k in range(4):
        corners = [[k / 16 + x, k / 2 + y] for x, y in ((0, 0), (2, 0), (1.75, 0.5), (0.25, 0.5))]
        mesh = {"shape": "quadrilateral", "corners": corners, "divisions": [4, 2], "order": 2}
        bodies.append(
            {"name": f"stone{k}", "mesh": mesh, "material": {"young": 1e9, "poisson": 0.3}}
        )
    bodies[0]["clamp"] = ["bottom"]
    bodies[-1]["traction"] = [{"on": "top", "value": [2e3, -2e5]}]
    return pile(bodies, ("bottom", "top"))


def rings() -> dict:
    """Rings around an axis, three on each other and three around these."""
    bodies, contacts = [], []
    for column, radius in enumerate((0.5, 1.0)):
        for row in range(3):
            body = rectangle(f"ring{column}{row}", [radius, 0.5 * row], [0.5, 0.5], [2, 2])
            body["clamp"] = [{"on": "bottom", "y": 0.0}] if row == 0 else []
            bodies.append(body)
    for row in range(3):
        names = [f"ring0{row}", f"ring1{row}"]
        contacts.append({"bodies": names, "on": ["right", "left"], "gap": 1e-5})
    for column in range(2):
        bodies[3 * column + 2]["traction"] = [{"on": "top", "value": [0.0, -1e6 * (1 + column)]}]
        for row in range(2):
            names = [f"ring{column}{row + 1}", f"ring{column}{row}"]
            contacts.append({"bodies": names, "on": ["bottom", "top"], "friction": FRICTION})
    for body in bodies[:3]:
        body["traction"] = [*body.get("traction", ()), {"on": "left", "pressure": 1e6}]
    return {"axisymmetric": True, "body": bodies, "contact": contacts}


def cubes() -> dict:
    """Boxes on each other, pushed aside."""
    bodies = [
        {
            "name": f"box{k}",
            "mesh": {
                "shape": "box",
                "origin": [0.0, 0.0, float(k)],
                "size": [1.0, 1.0, 1.0],
                "divisions": [2, 2, 2],
            },
            "material": {"young": 1e9, "poisson": 0.3},
        }
        for k in range(4)
    ]
    bodies[0]["clamp"] = ["bottom"]
    bodies[-1]["traction"] = [{"on": "top", "value": [1e4, 2e4, -2e5]}]
    return pile(bodies, ("bottom", "top"))


SCENES = {
    "bricks": bricks(),
    # three touch bricks that are alike on both sides, and have their modes in common
    "seven bricks": bricks(number=7),
    "one joint is open": bricks(1e-6),
    "gaps vary": bricks(gap="1e-6 * x**2"),
    "held": held_bricks(),
    "quadrilaterals": quadrilaterals(),
    "rings": rings(),
    "boxes": cubes(),
}


@pytest.mark.parametrize("scene", by_name(SCENES, "held"))
def test_answers_are_those_of_separate_bodies(scene):
    """Bodies that share mesh, factors, sides and rows have the displacements, forces and counts of separate ones."""
    alike = certified(scene)
    with mock.patch.object(MeshSpec, "at_home", lambda mesh, axisymmetric: ({}, ())):
        separate = certified(scene)
    assert alike.summary["outer_iterations"] == separate.summary["outer_iterations"]
    for name, body in separate.summary["bodies"].items():
        found = alike.summary["bodies"][name]
        assert found["n_A_by_purpose"] == body["n_A_by_purpose"]
        assert found["energy"] == pytest.approx(body["energy"], rel=1e-9)
        assert alike.bodies[name].points == pytest.approx(separate.bodies[name].points, abs=1e-15)
    for name, other in separate.contacts.items():
        one = alike.contacts[name]
        assert one.interface.bodies == other.interface.bodies
        assert one.interface.slave == other.interface.slave
        assert one.interface.xy == pytest.approx(other.interface.xy, abs=1e-14)
        assert one.forces == pytest.approx(other.forces, abs=1e-9 * np.abs(other.forces).max())


def test_alike_bodies_are_factored_once():
    """Five bricks are of three kinds: clamped below, loaded on both sides, and loaded above."""
    with mock.patch.object(solver, "Factors", wraps=solver.Factors) as factors:
        certified(bricks())
    assert factors.call_count == 3


@pytest.mark.mpi(ranks=2)
def test_ranks_share_alike():
    """What a rank makes for its own bodies is what one rank makes for all."""
    scene = bricks(number=4)
    one, two = certified(scene), certified(scene, MPI.COMM_WORLD)
    assert one.summary["n_A"] == two.summary["n_A"]
    for name, contact in two.contacts.items():
        forces = one.contacts[name].forces
        assert contact.forces == pytest.approx(forces, abs=1e-11 * np.abs(forces).max())


def test_alike_bodies_have_one_mesh():
    """What no shift changes is found once for all."""
    bodies = prepare(MPI.COMM_SELF, read_scene("bricks", to_toml(bricks()), [])).bodies
    one, other = bodies[1].mesh, bodies[3].mesh
    assert one.home is other.home
    assert one.boundary is other.boundary
    assert other.points == pytest.approx(one.points + np.array([0.25, 0.5]), abs=1e-15)


def test_what_no_shift_changes_is_found_once():
    """A function of a mesh is called at home, for the first of the meshes that are shifts of one."""
    home = build_mesh(body_of(shape="rectangle", size=(1.0, 1.0), divisions=(2, 2)))
    moved, seen = [home.shifted((k, 2.0)).shifted((1.0, k)) for k in (1.0, 2.0)], []

    def find(mesh):
        seen.append(mesh)
        return len(mesh.points)

    assert [mesh.once(find) for mesh in moved] == [9, 9]
    assert [mesh.points.min(axis=0).tolist() for mesh in moved] == [[2.0, 3.0], [3.0, 4.0]]
    assert len(seen) == 1
    assert seen[0] is home


def test_motions_of_alike_bodies_are_those_of_each():
    """Centre, outline and inertia of a body that is alike are those of its own nodes."""
    assembly = prepare(MPI.COMM_SELF, read_scene("bricks", to_toml(bricks()), []))
    found = {body.name: body for body in with_partners(assembly)}
    assert list(found) == ["brick1", "brick2", "brick3", "brick4"]
    for body in assembly.bodies[1:]:
        one, name = found[body.spec.name], body.spec.name
        own = MotionsOfBody.of(name, body.mesh.points, body.member.motions)
        for each in ("centre", "size", "outline", "basis", "inertia"):
            assert getattr(one, each) == pytest.approx(getattr(own, each), abs=1e-12)
    assert with_partners(assembly) is with_partners(assembly)


@pytest.mark.parametrize(
    ("keys", "shift"),
    [
        ({"shape": "rectangle", "origin": (0.1, 0.7), "size": (0.3, 1.0)}, (0.1, 0.7)),
        (
            {"shape": "annulus", "center": (0.1, 0.7), "radii": (0.3, 0.7), "angles": (10, 95)},
            (0.1, 0.7),
        ),
        (
            {
                "shape": "quadrilateral",
                "corners": ((0.5, 1.0), (1.5, 1.25), (1.5, 2.0), (0.25, 2.0)),
            },
            (0.5, 1.0),
        ),
        # differences of these corners are rounded, and nodes at corners are these to the last bit
        (
            {
                "shape": "quadrilateral",
                "corners": ((-1.0, 0.7), (1.8, 0.7), (1.8, 2.0), (-1.0, 2.0)),
            },
            (),
        ),
    ],
)
def test_shapes_come_home(keys, shift):
    """The shape at the origin, shifted, has the nodes of the shape that is asked for."""
    body = body_of(divisions=(5, 3), **keys)
    home, found = body.mesh.at_home(False)
    assert found == shift
    at_home = msgspec.structs.replace(body.mesh, **home)
    moved = build_mesh(msgspec.structs.replace(body, mesh=at_home)).shifted(found or (0.0, 0.0))
    assert moved.points == pytest.approx(build_mesh(body).points, abs=1e-15)


def test_rings_stay_at_their_radius():
    """Around an axis bodies are alike at any height, but not at another radius."""
    mesh = body_of(shape="rectangle", origin=(0.5, 2.0), size=(1.0, 1.0), divisions=(2, 2)).mesh
    assert mesh.at_home(True) == ({"origin": (0.5, 0.0)}, (0.0, 2.0))


def test_mistakes_are_where_bodies_are():
    """Words on alike bodies have the places of the scene, not those at home."""
    scene = bricks()
    scene["contact"][3]["on"] = ["top", "top"]
    with pytest.raises(InputError, match=r"begins at \(0\.5, 1\.25\)"):
        ddmpi.solve(scene)


def test_a_mesh_that_is_refused_is_made_again_only_where_its_place_is_another(tmp_path):
    """A shape is made at the origin first, so that its message needs its own place; a drawing is meshed once."""
    (tmp_path / "part.geo").write_text("")
    scene = pile(
        [rectangle(name, [1.0, y], [1.0, 1.0], [1, 1]) for name, y in (("a", 0.0), ("b", 1.0))],
        ("bottom", "top"),
    )
    for mesh, times in (
        (scene["body"][0]["mesh"], 2),
        ({"geometry": str(tmp_path / "part.geo"), "size": 1.0}, 1),
    ):
        scene["body"][0]["mesh"] = mesh
        with (
            mock.patch(
                "ddmpi.coupling.parts.build_mesh", side_effect=InputError("refused")
            ) as build,
            pytest.raises(InputError, match="refused"),
        ):
            prepare(MPI.COMM_SELF, read_scene("scene", scene))
        assert build.call_count == times
