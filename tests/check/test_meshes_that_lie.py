"""What `check` and `run` say of meshes that are not connected as they look, and of drawings without bodies."""

from pathlib import Path

import meshio
import numpy as np
import pytest
from scenes import call, run_here, write_scene
from solid_scenes import box

from ddmpi.check.draft import draft_scene
from ddmpi.errors import InputError
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import MeshSpec
from meshes import cad, write


def slit(path: Path, merged, pieces=((0.0, 0.0), (0.0, 0.5))) -> Path:
    """Rectangles of 2 by 0.5 at `pieces` as one file of gmsh, whose nodes in one place are one where `merged`."""
    points, cells = np.empty((0, 2)), np.empty((0, 3), int)
    for origin in pieces:
        spec = MeshSpec(shape="rectangle", origin=origin, size=(2.0, 0.5), divisions=(8, 2))
        mesh = generate_rectangle(spec)
        cells = np.concatenate([cells, mesh.triangles + len(points)])
        points = np.concatenate([points, mesh.points])
    key = np.column_stack([points, np.where(merged(points), -1, np.arange(len(points)))])
    _, first, number = np.unique(np.round(key, 9), axis=0, return_index=True, return_inverse=True)
    points, cells = points[first], number.ravel()[cells]
    edges = cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = (edges[(points[edges, 1] == y).all(axis=1)] for y in (0.0, points[:, 1].max()))
    path.parent.mkdir(exist_ok=True, parents=True)
    meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))),
        [("line", np.concatenate([low, high])), ("triangle", cells)],
        cell_data={
            "gmsh:physical": [np.repeat([1, 2], [len(low), len(high)]), np.full(len(cells), 3)],
            "gmsh:geometrical": [np.repeat([1, 2], [len(low), len(high)]), np.full(len(cells), 3)],
        },
        field_data={"bottom": np.array([1, 1]), "top": np.array([2, 1]), "all": np.array([3, 2])},
    ).write(path, file_format="gmsh22", binary=False)
    return path


def scene_of(mesh: Path, order: int = 1) -> dict:
    """The body on a rough floor under a slanting load."""
    return {
        "body": [
            {
                "name": "a",
                "mesh": {"file": str(mesh), "order": order},
                "material": {"young": 2e11, "poisson": 0.3},
                "traction": [{"on": "top", "value": [1e5, -1e6]}],
            }
        ],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0, 0], "normal": [0, 1]}],
        "contact": [
            {
                "bodies": ["a", "floor"],
                "on": ["bottom"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
        ],
        "output": {"figures": False},
    }


def ends_only(at: np.ndarray) -> np.ndarray:
    """Nodes that are merged: all but those inside of the seam."""
    return (at[:, 1] != 0.5) | (at[:, 0] == 0.0) | (at[:, 0] == 2.0)


def everywhere(at: np.ndarray) -> np.ndarray:
    return np.ones(len(at), bool)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_a_seam_and_what_passes_through_it_are_told(tmp_path, order):
    """By check and by run, with the number of corners; the overlap is of the size of the displacement."""
    path = write_scene(
        scene_of(slit(tmp_path / "slit.msh", ends_only), order), tmp_path / "scene.toml"
    )
    words = "body.a.mesh: 7 nodes lie in one place with another"
    assert words in call("check", str(path), "--no-figures").stderr
    told = run_here(path, tmp_path / "results")
    assert told.code == 0 and words in told.stderr
    assert "body.a penetrates itself by " in told.stderr
    path = write_scene(
        scene_of(slit(tmp_path / "slit.msh", everywhere), order), tmp_path / "scene.toml"
    )
    whole = run_here(path, tmp_path / "whole")
    assert "in one place" not in whole.stderr and "penetrates itself" not in whole.stderr


def test_a_loose_piece_is_told_with_the_seam(tmp_path):
    """Where no node of the seam is merged, a piece is loose, and the seam is the reason."""
    scene = scene_of(slit(tmp_path / "slit.msh", lambda at: at[:, 1] != 0.5))
    scene["body"][0]["clamp"] = [{"on": "bottom", "x": 0.0, "y": 0.0}]
    said = call("check", str(write_scene(scene, tmp_path / "scene.toml")), "--no-figures")
    assert said.code == 2 and "it has 2 that are not connected" in said.stderr
    assert "own boundary groups (top)" in said.stderr
    assert "9 nodes lie in one place with another and not merged" in said.stderr
    scene["body"][0]["clamp"].append({"on": "top", "x": 0.0, "y": 0.0})
    del scene["contact"], scene["rigid"]
    said = call("check", str(write_scene(scene, tmp_path / "scene.toml")), "--no-figures")
    assert "in 2 pieces that are not connected" in said.stdout and said.code == 0


def test_a_hinge_is_told_by_name(tmp_path):
    """Not as a stiffness that is singular."""
    pieces = (0.0, 0.0), (2.0, 0.5)
    scene = scene_of(slit(tmp_path / "slit.msh", everywhere, pieces))
    path = write_scene(scene, tmp_path / "scene.toml")
    said = run_here(path, tmp_path / "results")
    assert said.code == 2
    assert "is connected to the rest at one node only, at (2, 0.5), about which it can turn" in (
        said.stderr
    )


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["step", "brep"])
def test_drawings_without_bodies_are_refused(tmp_path, suffix):
    """Files that are empty, or have points, wires and faces in space alone, when a scene is drafted from them."""

    def faces(occ) -> None:
        occ.remove([(3, occ.addBox(0, 0, 0, 1, 1, 1))])

    files = {
        "nothing drawn in it; export the solids, or plane faces": write(
            tmp_path / f"empty.{suffix}", ""
        ),
        "nothing but curves": cad(
            tmp_path / f"wire.{suffix}",
            lambda occ: occ.addLine(occ.addPoint(0, 0, 0), occ.addPoint(1, 0, 0)),
        ),
        "has no solid: its face": cad(tmp_path / f"faces.{suffix}", faces),
    }
    for words, path in files.items():
        with pytest.raises(InputError, match=words):
            draft_scene(path, tmp_path / "made")
    assert not (tmp_path / "made").exists()


def test_the_memory_of_multigrid_is_told(tmp_path):
    """It is no less than the earlier solutions that it begins with, and not that of factors."""
    scene = {
        "body": [
            box("a", (0, 0, 0), (1, 1, 1), (8, 8, 8))
            | {"clamp": [{"on": "bottom", "x": 0, "y": 0, "z": 0}]}
        ],
        "method": {"compliance": "iterative"},
        "output": {"figures": False},
    }
    scene["body"].append(box("b", (0, 0, 1), (1, 1, 1), (8, 8, 8)))
    scene["contact"] = [{"bodies": ["b", "a"], "on": ["bottom", "top"], "kind": "bonded"}]
    said = call("check", str(write_scene(scene, tmp_path / "scene.toml")), "--no-figures")
    assert "solvers take about " in said.stdout, said.stderr
    size = float(said.stdout.partition("solvers take about ")[2].split()[0])
    dofs = 9 * 9 * 17 * 3
    assert 40 * 8 * dofs < size * 2**20 < 2000 * dofs
