"""The same solids elsewhere: turned, mirrored, in other units, with bodies in another order, on several ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import cKDTree
from solid_scenes import PUBLIC, moved, two_boxes

import ddmpi

pytestmark = pytest.mark.slow

SAME = 1e-9
TIGHT = {"method": {"tolerance": 1e-12}}
TURN = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
MIRROR = np.diag([1.0, -1.0, 1.0])

SCENES = {"pairs": lambda: two_boxes(3), "mortar": lambda: two_boxes(3, 2), "order 2": lambda: two_boxes(2, order=2),
          "Tresca": lambda: two_boxes(3, law={"law": "tresca", "slip_bound": 1.2e7}),
          "loose": lambda: PUBLIC["two loose boxes on a plane"]["scene"]}


STILL = np.eye(3)


def compare(one, other, Q=STILL, length=1.0, stress=1.0):
    """The second answer is the first one, moved by Q and in other units."""
    assert one.certified and other.certified, (one.reason, other.reason)
    largest = one.summary["displacement_max"]
    for name, body in one.bodies.items():
        far, node = cKDTree(other.bodies[name].points * length).query(body.points @ Q.T)
        assert far.max() < 1e-9
        found = other.bodies[name].displacement[node] * length
        assert np.abs(found - body.displacement @ Q.T).max() <= SAME * largest
    unit = stress * length**2
    for name, contact in one.summary["contacts"].items():
        found = other.summary["contacts"][name]
        assert [found[key] for key in ("open", "slip", "stick")] == [contact[key] for key in ("open", "slip", "stick")]
        size = np.abs(contact["force"]).max()
        assert np.abs(np.array(found["force"]) * unit - Q @ contact["force"]).max() <= SAME * size


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("Q, length, stress", [(TURN, 1.0, 1.0), (MIRROR, 1.0, 1.0), (MIRROR @ TURN, 1e-3, 1e6)],
                         ids=["turned", "mirrored", "both, in mm and MPa"])
def test_moved(name, Q, length, stress):
    scene = SCENES[name]() | TIGHT
    one, other = (ddmpi.solve(each, MPI.COMM_SELF) for each in (scene, moved(scene, Q, length, stress)))
    compare(one, other, Q, length, stress)


@pytest.mark.parametrize("length", [1e9, 1e-9])
def test_far_units(length):
    """Loose bodies take the same steps, and no warning comes with units in which they are very small or large."""
    scene = SCENES["loose"]()
    one, other = (ddmpi.solve(each, MPI.COMM_SELF) for each in (scene, moved(scene, STILL, length)))
    assert other.certified, other.reason
    for key in ("outer_iterations", "n_A", "warnings"):
        assert one.summary[key] == other.summary[key]


@pytest.mark.parametrize("name", SCENES)
def test_order_of_bodies(name):
    """Bodies and contacts the other way round; contacts keep which body is the first."""
    scene = SCENES[name]() | TIGHT
    turned = scene | {"body": scene["body"][::-1], "contact": scene["contact"][::-1]}
    compare(*(ddmpi.solve(each, MPI.COMM_SELF) for each in (scene, turned)))


@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("name", SCENES)
def test_two_ranks(comm, name):
    """Each body on a rank of its own."""
    scene = SCENES[name]() | TIGHT
    one, other = ddmpi.solve(scene, MPI.COMM_SELF), ddmpi.solve(scene, comm)
    bodies = {body: one.bodies[body] for body in other.bodies}
    one.bodies.clear()
    one.bodies.update(bodies)
    compare(one, other)


@pytest.mark.parametrize("order", [1, 2])
def test_normals_on_a_rigid_partner_are_its_own(order):
    """Also where a body lies askew on it: no force along a plane without friction."""
    corners = [[0, 0, 0.0], [1, 0, 0.01], [1, 1, 0.03], [0, 1, 0.02], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    mesh = {"shape": "hexahedron", "corners": corners, "divisions": [2, 2, 2], "order": order}
    block = {"name": "block", "mesh": mesh,
             "material": {"young": 1e9, "poisson": 0.3}, "clamp": [{"on": "top", "x": 0.0, "y": 0.0, "z": -0.05}]}
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    answer = ddmpi.solve({"body": [block], "rigid": [floor],
                          "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}]}, MPI.COMM_SELF)
    state = answer.contacts["block-floor"]
    assert np.abs(state.interface.normal + np.eye(3)[2]).max() < 1e-15
    assert np.abs(state.force[:2]).max() <= 1e-12 * state.force[2]
