"""Meshes of a program, as arrays or of meshio, against the shapes and files that they are of."""

import copy
import gc

import meshio
import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, certified, pinched_blocks
from scipy.spatial import cKDTree
from solid_scenes import two_boxes

import ddmpi
from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.scene.given import GIVEN
from ddmpi.scene.reader import read_scene


def as_arrays(scene: dict, order: int = 1) -> dict:
    """The scene with its generated meshes as arrays."""
    scene = copy.deepcopy(scene)
    for body in scene["body"]:
        body["mesh"]["order"] = order
    for body, spec in zip(scene["body"], read_scene("scene", scene).body, strict=True):
        mesh = build_mesh(spec)
        body["mesh"] = {"points": mesh.points, "cells": mesh.triangles, "groups": mesh.groups}
    return scene


@pytest.mark.every(5)
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("scene", [pinched_blocks(4), two_boxes(2)], ids=["plane", "space"])
def test_a_mesh_as_arrays_is_that_of_the_shape(scene, order):
    """Forces and displacements are those of the generated mesh; the order is that of the cells."""
    made = copy.deepcopy(scene)
    for body in made["body"]:
        body["mesh"]["order"] = order
    one, other = certified(made), certified(as_arrays(scene, order))
    assert other.summary["order"] == order
    for name, fields in one.bodies.items():
        found = other.bodies[name]
        far, place = cKDTree(found.points).query(fields.points)
        assert far.max() == 0.0 and len(found.points) == len(fields.points)
        size = np.abs(fields.displacement).max()
        assert np.abs(found.displacement[place] - fields.displacement).max() <= 1e-9 * size
    if order == 1:  # nodes keep their numbers
        assert np.array_equal(found.points, fields.points)


def square(n: int = 4) -> dict:
    """Of quadrilaterals; a group of facets, one of nodes, and one of a single node."""
    x = np.linspace(0.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    corners = k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]
    bottom = np.column_stack([k[0, :-1], k[0, 1:]])
    return {
        "points": points,
        "cells": np.stack(corners, axis=-1).reshape(-1, 4),
        "groups": {"bottom": bottom, "top": k[-1].tolist(), "corner": k[0, :1]},
    }


def pressed(mesh) -> dict:
    return {
        "body": [
            {
                "name": "block",
                "mesh": mesh,
                "material": {"young": 1e9, "poisson": 0.3},
                "clamp": [{"on": "bottom", "y": 0.0}, {"on": "corner", "x": 0.0}],
                "traction": [{"on": "top", "pressure": 1e6}],
            }
        ]
    }


def of_meshio() -> meshio.Mesh:
    arrays = square()
    blocks = [("quad", arrays["cells"]), ("line", arrays["groups"]["bottom"])]
    return meshio.Mesh(
        arrays["points"],
        blocks,
        point_sets={name: np.array(arrays["groups"][name]) for name in ("top", "corner")},
        cell_sets={"bottom": [np.empty(0, int), np.arange(4)]},
    )


@pytest.mark.parametrize("mesh", [square(), of_meshio()], ids=["arrays", "meshio"])
def test_groups_are_facets_or_nodes(mesh):
    """A block under a pressure yields by p H (1 − ν²) / E; what the program does to its mesh afterwards does not count."""
    with ddmpi.prepare(pressed(mesh), MPI.COMM_SELF) as model:
        points = mesh["points"] if isinstance(mesh, dict) else mesh.points
        points *= 2.0
        answer = model.solve()
        again = model.solve({"body.block.traction.0.pressure": 2e6})
    points /= 2.0
    moved = answer.bodies["block"].displacement[:, 1].min()
    assert moved == pytest.approx(-1e6 * (1 - 0.3**2) / 1e9, rel=1e-9)
    assert again.bodies["block"].displacement[:, 1].min() == pytest.approx(2.0 * moved, rel=1e-12)
    assert "mesh" in model.reused["block"]


def test_points_of_the_plane_may_have_a_third_coordinate_of_zero():
    """As those of meshio have."""
    plane = square()
    flat = plane | {"points": np.pad(plane["points"], ((0, 0), (0, 1)))}
    one, other = certified(pressed(plane)).bodies, certified(pressed(flat)).bodies
    assert np.array_equal(one["block"].displacement, other["block"].displacement)


def test_arrays_take_the_place_of_a_mesh_by_its_key():
    """Of a shape, and of other arrays; only for one solve. A profile has points, too, and is none."""
    fine, coarse = square(6), square(2)
    shape = {"shape": "rectangle", "size": [1.0, 1.0], "divisions": [2, 2]}
    scene = pressed(shape)
    scene["body"][0]["clamp"] = [{"on": "bottom", "y": 0.0}, {"on": "left", "x": 0.0}]
    clamp = {"body.block.clamp.1": {"on": "corner", "x": 0.0}}
    with ddmpi.prepare(scene, MPI.COMM_SELF) as model:
        for mesh in (fine, coarse, of_meshio()):
            answer = model.solve({"body.block.mesh": mesh} | clamp)
            there = mesh["points"] if isinstance(mesh, dict) else mesh.points
            assert len(answer.bodies["block"].points) == len(there)
            moved = answer.bodies["block"].displacement[:, 1].min()
            assert moved == pytest.approx(-1e6 * (1 - 0.3**2) / 1e9, rel=1e-9)
        assert len(model.solve().bodies["block"].points) == 9
        with pytest.raises(InputError, match=r"^overrides: body\.block\.mesh\.cells: is empty"):
            model.solve({"body.block.mesh": fine | {"cells": []}})
        with pytest.raises(InputError, match=r"time\.points"):
            model.solve({"time": {"points": []}})


def test_meshes_last_as_long_as_their_model():
    model = ddmpi.prepare(pressed(square()), MPI.COMM_SELF)
    (name,) = GIVEN
    answer = model.solve()
    assert answer.summary["scene"]["body"][0]["mesh"]["file"] == name
    model.close()
    del model
    gc.collect()
    assert not GIVEN


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_each_rank_has_its_arrays(comm):
    """The answer on two ranks is that on one."""
    scene = as_arrays(pinched_blocks(4))
    alone, together = certified(scene), certified(scene, comm)
    force = alone.contacts["upper-lower"].force
    assert together.contacts["upper-lower"].force == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"groups": None}, "a mesh as arrays has points (n, d), cells (nt, k) and groups"),
        ({"points": np.zeros((25, 4))}, "expected numbers of size (n, 2) or (n, 3)"),
        ({"points": [["a", "b"]]}, "body.block.mesh.points: expected numbers, got an array of"),
        ({"points": [[0.0, 0.0], [1.0]]}, "expected rows of numbers of one length"),
        ({"cells": np.zeros((3, 5), int)}, "expected rows of nodes, of as many as 3 (triangle)"),
        ({"cells": [[0, 1, 25]]}, "there are 25 points, counted from 0; 0 to 25 are named"),
        ({"cells": [[0, 1, -1]]}, "counted from 0; -1 to 1 are named"),
        ({"cells": [[0.5, 1.0, 2.0]]}, "expected whole numbers, those of nodes, from 0 on"),
        ({"cells": []}, "body.block.mesh.cells: is empty"),
        ({"groups": {"top": []}}, "body.block.mesh.groups.top: is empty"),
        (
            {"points": [[0.0, 0.0], [np.nan, 1.0]]},
            "expected finite numbers up to 1e+100, point 1 is at (nan, 1)",
        ),
        ({"points": np.ma.masked_equal(square()["points"], 0.5)}, "points: has masked numbers"),
        ({"groups": {"top": np.zeros((1, 1, 1), int)}}, "expected numbers of nodes, (nt, k) or"),
        ({"groups": {"top": [[0, 1, 2, 3]]}}, "of as many as 2 (line), 3 (line3)"),
        ({"groups": [[0, 1]]}, "body.block.mesh.groups: expected facets or nodes by name"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(change, words):
    assert_refused(pressed(square() | change), words)
    certified(pressed(square()))


@pytest.mark.parametrize("key", ["points", "cells"])
def test_arrays_without_points_or_cells_are_refused(key):
    """They are told as arrays, not as a file's mesh."""
    arrays = square()
    del arrays[key]
    assert_refused(pressed(arrays), f"{key} is missing")


def test_a_mesh_of_meshio_with_nodes_that_are_not_there_is_refused():
    """With the number of the cell among all of its kind, counted from 0 through blocks with others between them."""
    arrays = square()
    cells, lines = arrays["cells"], arrays["groups"]["bottom"]
    cells[10, 2] = 77
    blocks = [("quad", cells[:5]), ("line", lines), ("quad", cells[5:8]), ("quad", cells[8:])]
    words = (
        "quad 10 has the node 77, which is not there; its nodes are 0 to 24, both counted from 0"
    )
    with pytest.raises(InputError, match=words):
        ddmpi.solve(pressed(meshio.Mesh(arrays["points"], blocks)), MPI.COMM_SELF)
