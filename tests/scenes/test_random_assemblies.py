"""Random assemblies in the plane, verified as `scripts/study random_assemblies` does, and that check."""

import tomllib
from types import SimpleNamespace

import assemblies
import numpy as np
import pytest
import random_assemblies
import scenes
from assembly_scenes import FAMILIES, random_scene
from mpi4py import MPI

TOLERANCE = 1e-8
SEEDS = {
    # family: seeds with an equilibrium, seeds without
    "stack": ((80, 168, 176), (88,)),
    "wall": ((9, 25, 193), (161,)),
    "arch": ((10, 162, 170, 178), (194,)),
    "row": ((43, 107, 171), (115,)),
    "checkerboard": ((12, 172, 188), ()),
    "tower": ((5, 189), (197,)),
    "pushed": ((166, 190), (70, 150)),
    "lintel": ((79, 183, 191), ()),
}


@pytest.mark.slow
@pytest.mark.parametrize("family, seed, verdict", [
    (family, seed, verdict) for family, both in SEEDS.items()
    for seeds, verdict in zip(both, ("verified", "reported"), strict=True) for seed in seeds])
def test_random_assembly(family, seed, verdict):
    """Displacements obey all laws to 1e-8 where there is an equilibrium; where there is none, ddmpi says so."""
    scene = random_scene(seed)
    assert scene["title"].startswith(family)
    found = random_assemblies.judge(scene, random_assemblies.solve(scene, MPI.COMM_SELF), TOLERANCE)
    assert found[0] == verdict, found


def test_scenes_are_the_same_for_the_same_seed(tmp_path, monkeypatch):
    """In all families, and as the files that the study writes."""
    monkeypatch.setattr("sys.argv", ["", "--seeds", "0:8", "--write", str(tmp_path)])
    with pytest.raises(SystemExit):
        random_assemblies.random_assemblies()
    for seed, family in enumerate(FAMILIES):
        scene = tomllib.loads((tmp_path / f"random_{seed}.toml").read_text(encoding="utf-8"))
        assert scene == random_scene(seed) and scene["title"].startswith(family)


@pytest.fixture(scope="module")
def blocks():
    """Two loose blocks on a held one, of which nodes stick and slip, and their answer."""
    scene = random_scene(80)
    return scene, random_assemblies.solve(scene, MPI.COMM_SELF)


def pushed(u: np.ndarray, points: np.ndarray) -> np.ndarray:
    return u + 1e-3 * np.abs(u).max() * np.array([0.0, 1.0])


@pytest.mark.parametrize("change, seen", [
    (lambda u, points: u, 0.0), (lambda u, points: (1.0 + 1e-5) * u, 1e-6), (pushed, 1e-4),
    (lambda u, points: u + 1e-4 * np.abs(u).max() * np.sin(20.0 * points), 1e-4)])
def test_the_check_sees_what_is_wrong(blocks, change, seen):
    """Loads that are not balanced, motions of clamps and stresses within a body; but nothing in what is right."""
    scene, answer = blocks
    changed = {name: SimpleNamespace(points=body.points, displacement=change(body.displacement, body.points))
               for name, body in answer.bodies.items()}
    found = assemblies.violation(assemblies.Assembly(scene), SimpleNamespace(bodies=changed))
    assert found >= seen if seen else found < TOLERANCE


@pytest.mark.parametrize("certified, reason, seed, verdict", [
    (False, "no equilibrium found: …", 80, "finding"), (False, "no equilibrium: …", 80, "missed"),
    (False, "max_iterations", 80, "missed"), (True, "", 88, "violated")])
def test_verdicts(blocks, certified, reason, seed, verdict):
    """Each way to be wrong has its word."""
    bodies = {body["name"]: SimpleNamespace(points=points, displacement=0.0 * points) for body in
              random_scene(seed)["body"] for points in [assemblies.build(body).points]}
    answer = SimpleNamespace(certified=certified, reason=reason, steps=1, bodies=bodies)
    assert random_assemblies.judge(random_scene(seed), answer, TOLERANCE)[0] == verdict


@pytest.mark.parametrize("bound, left", [(0.8, 0.0), (1.2, 1.0)])
def test_what_friction_cannot_hold_is_certain(bound, left):
    """A block on a floor is pushed by 0.8 or 1.2 of what Tresca's friction bears: the rest stays without balance."""
    block = scenes.rectangle("block", (0, 0), (2, 1), (4, 2), traction=[
        {"on": "top", "value": [bound * 1e4, -1e6]}])
    scene = {"body": [block], "rigid": [scenes.FLOOR], "contact": [
        {"bodies": ["block", "floor"], "on": ["bottom"], "friction": {"law": "tresca", "slip_bound": 1e4}}]}
    found = assemblies.imbalance(assemblies.Assembly(scene))
    assert (found > assemblies.INFEASIBLE) == bool(left)
