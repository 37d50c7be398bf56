"""The comparison of random assemblies with the brute-force reference: the script, and what its verdicts mean."""

import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import assemblies
import pytest
import random_assemblies
import scenes
from assembly_scenes import random_scene

SCRIPT = Path(random_assemblies.__file__)
SOLVED, NONE = 1, 2
"""Seeds of scenes with and without an equilibrium."""


def run(*arguments: str) -> str:
    return subprocess.run([sys.executable, SCRIPT, "random_assemblies", *arguments], text=True, capture_output=True,
                          check=True, timeout=scenes.LIMIT).stdout


def test_the_reference_alone():
    """A line for each seed and a table; the scenes can be written, too."""
    lines = run("--reference-only", "--seeds", "1:3").splitlines()
    assert lines[1].split()[:4] == ["1", "wall", "5", "coulomb"] and lines[1].split()[-1] == "solved"
    assert lines[2].split()[-1] == "none"
    assert "family" in lines[4]


def test_scenes_as_files(tmp_path):
    run("--write", str(tmp_path), "--seeds", "1,4")
    for seed in (1, 4):
        assert tomllib.loads((tmp_path / f"random_{seed}.toml").read_text(encoding="utf-8")) == random_scene(seed)


@pytest.fixture(scope="module")
def references():
    return {seed: assemblies.solve(random_scene(seed)) for seed in (SOLVED, NONE)}


@pytest.mark.parametrize("seed, factor, certified, reason, verdict", [
    (SOLVED, 1.0, True, "", "agrees"), (SOLVED, 1.01, True, "", "differs"),
    (SOLVED, 1.0, False, "no equilibrium found", "missed"), (NONE, 0.0, False, "no equilibrium: …", "reported"),
    (NONE, 0.0, False, "diverged", "unreported"), (NONE, 0.0, True, "", "unreported")])
def test_verdicts(references, seed, factor, certified, reason, verdict):
    """Each way to be right or wrong has its word."""
    found = references[seed]
    bodies = {name: SimpleNamespace(points=found.points[name], displacement=factor * u)
              for name, u in found.displacement.items()}
    answer = SimpleNamespace(error="", certified=certified, reason=reason, bodies=bodies)
    assert random_assemblies.judge(found, answer, 1e-6)[0] == verdict
