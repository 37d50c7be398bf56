"""Quadratic triangles through the real command: the answer, the work it takes, and the files.

Exactness on linear fields is in test_closed_forms, rates are in test_convergence.
"""

import h5py
import matplotlib.image
import meshio
import numpy as np
import pytest
import scenes
from problems import annulus, lame_fit, plane_strain
from scenes import pinched_blocks

pytestmark = pytest.mark.slow


def quadratic(scene: dict) -> dict:
    for body in scene["body"]:
        body["mesh"]["order"] = 2
    return scene


def blocks(N: int, order: int, law: str = "coulomb", **method) -> dict:
    """Pinched blocks whose nodes are those of squares of side 1/N."""
    scene = pinched_blocks(N // order, law, **method)
    return scene if order == 1 else quadratic(scene)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("quadratic")


@pytest.fixture(scope="module")
def done(folder) -> scenes.Run:
    scene = scenes.write_scene(blocks(22, 2), folder / "blocks.toml")
    run = scenes.run_here(scene, folder / "results")
    assert run.code == 0, run.output
    return run


@pytest.fixture(scope="module")
def solutions(folder) -> dict[str, dict]:
    cases = {"linear": blocks(22, 1)}
    cases |= {kind: blocks(22, 2, compliance=kind) for kind in ("explicit", "direct", "iterative")}
    cases |= {law: blocks(22, 2, law) for law in ("tresca", "none")}
    cases |= {"quadratic, fine": blocks(44, 2)}
    cases |= {"published": blocks(12, 2, outer="relaxation", tolerance=1e-6), "newton": blocks(12, 2)}
    return scenes.solve_all(cases, folder)


def test_size(done):
    """The same unknowns as linear triangles of half the side."""
    summary = done.summary
    assert summary["order"] == 2
    assert (summary["n"], summary["m"]) == (12 * 22 * 23, 3 * 22)
    assert summary["converged"] is True


@pytest.mark.parametrize("case", ["explicit", "tresca", "none", "iterative", "linear", "published"])
def test_certified(solutions, case):
    assert "error" not in solutions[case], solutions[case]["error"]
    assert solutions[case]["certified"], solutions[case]["reason"]
    assert (solutions[case]["length"] > 0).all()


def test_no_more_work_than_for_linear_triangles(solutions):
    assert solutions["explicit"]["n_A"] <= 1.15 * solutions["linear"]["n_A"]
    assert solutions["explicit"]["n_A"] <= 230


def test_all_compliances_and_methods_give_the_same(solutions):
    def distance(one, other):
        a, b = (np.concatenate([solutions[name]["normal_force"], solutions[name]["tangential_force"]])
                for name in (one, other))
        return np.linalg.norm(a - b) / np.linalg.norm(b)

    assert distance("direct", "explicit") <= 1e-8
    assert distance("iterative", "explicit") <= 1e-6
    assert distance("published", "newton") <= 1e-3
    assert solutions["direct"]["n_A"] == solutions["explicit"]["n_A"]


def test_nearer_to_the_limit_than_linear_triangles_with_as_many_unknowns(solutions):
    """By the strain energy, which errs with the square of the energy norm."""
    linear, quadratic, limit = (sum(solutions[name]["energy"]) for name in ("linear", "explicit", "quadratic, fine"))
    assert abs(quadratic - limit) < 0.5 * abs(linear - limit)
    normal = solutions["quadratic, fine"]["normal_force"].sum()
    assert normal == pytest.approx(1.1507844e8, rel=1e-3)  # linear triangles, N = 54 (design, section 3)


def test_xdmf_reads_back(done):
    mesh = meshio.read(done.folder / "result.xdmf")
    points, cells, point_data, cell_data = mesh.points, mesh.cells, mesh.point_data, mesh.cell_data
    assert [block.type for block in cells] == ["triangle6"]
    triangles = cells[0].data
    assert triangles.shape == (4 * 33 * 11, 6)
    corners = triangles[:, :3]
    middles = (points[corners] + points[np.roll(corners, -1, axis=1)]) / 2
    assert np.abs(points[triangles[:, 3:]] - middles).max() <= 1e-15
    assert np.array_equal(np.unique(triangles), np.arange(len(points)))
    u = point_data["displacement"]
    assert np.linalg.norm(u, axis=1).max() == pytest.approx(done.summary["displacement_max"], rel=1e-12)
    assert cell_data["von_mises"][0].shape == (len(triangles),)
    below = points[triangles, 1].max(axis=1) <= 1.0
    assert np.array_equal(cell_data["body"][0] == 1, below)


def test_stress_in_the_file_carries_the_loads(done):
    """The mean of σ_xx over the triangles at the right end of the upper block is the traction there."""
    with h5py.File(done.folder / "result.h5") as file:
        points, cells, sigma = (file[name][()] for name in ("points", "cells", "stress"))
    middle = points[cells[:, :3]].mean(axis=1)
    right = (middle[:, 0] > 3.0 - 1 / 11) & (middle[:, 1] > 1.0)
    assert sigma[right, 0].mean() == pytest.approx(2.0e7, rel=0.05)


def test_interface_and_pictures(done):
    table = done.table("contact_upper-lower.csv")
    assert np.allclose(np.diff(table["x"]), 1 / 22)
    share = table["normal_force"] / np.where(table["normal_stress"] > 0, table["normal_stress"], np.inf)
    closed = table["status"] != "open"
    assert share[closed][:2] == pytest.approx([4 / 66, 2 / 66])  # a middle, then a corner: the first node is clamped
    for name in ("bodies.png", "contact.png", "convergence.png"):
        pixels = matplotlib.image.imread(done.folder / name)
        drawn = (pixels[..., :3] < 0.99).any(axis=2)
        assert 0.01 < drawn.mean() < 0.99, name


def test_means_over_sides_carry_the_force(done):
    """All of it but the share of the first side, whose corner is clamped."""
    sides, nodes = done.table("contact_upper-lower_sides.csv"), done.table("contact_upper-lower.csv")
    assert np.allclose(sides["length"], 1 / 11) and len(sides["x"]) == 32
    assert np.array_equal(sides["x"], nodes["x"][2::2])
    for kind in ("normal", "tangential"):
        force = nodes[f"{kind}_force"]
        expected = force[1:].sum() - nodes[f"{kind}_stress"][1] / 66  # the first corner is half the first side's
        assert sides["length"] @ sides[f"{kind}_stress"] == pytest.approx(expected, rel=1e-12)


def test_means_over_sides_do_not_swing_on_a_curved_interface(folder):
    bodies = [{"name": name, "mesh": annulus(radii, (24, 8), "2 straight", folder.resolve()),
               "material": {"young": 2.1e11, "poisson": 0.3},
               "clamp": [{"on": "end", "x": 0.0}, {"on": "start", "y": 0.0}]}
              for name, radii in (("inner", (0.5, 1.0 + 1e-6)), ("outer", (1.0, 1.5)))]
    contact = {"bodies": ["inner", "outer"], "on": ["outer", "inner"], "friction": {"law": "none"}}
    scene = scenes.write_scene({"title": "Shrink fit", "body": bodies, "contact": [contact]}, folder / "rings.toml")
    run = scenes.run_here(scene, folder / "rings")
    assert run.code == 0, run.output
    nodes, sides = (run.table(f"contact_inner-outer{end}.csv")["normal_stress"] for end in ("", "_sides"))
    exact = lame_fit(0.5, 1.0, 1.5, 1e-6, plane_strain(2.1e11, 0.3))
    assert np.abs(sides / exact - 1).max() < 1e-3 < 0.015 < np.abs(nodes / exact - 1).max()


@pytest.mark.mpi(ranks=2)
def test_the_coupled_problem_has_the_same_forces(comm):
    from ddmpi.run.solve import solve

    assembly = scenes.prepare_scene(comm, blocks(12, 2))
    answer, exact = solve(assembly, assembly.scene.method), scenes.exact_forces(assembly)
    forces = scenes.everywhere(assembly, answer.outer.forces)
    assert answer.certified
    assert np.linalg.norm(forces - exact) <= answer.limit * np.linalg.norm(exact)


def test_bodies_of_different_order_are_refused(folder):
    scene = blocks(12, 2)
    scene["body"][0]["mesh"]["order"] = 1
    run = scenes.run_here(scenes.write_scene(scene, folder / "mixed.toml"), folder / "mixed")
    assert run.code == 2
    assert "mesh.order 1 and 2" in run.output and run.files == set()
