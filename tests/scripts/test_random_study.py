"""The comparison of random assemblies with the brute-force reference: what its verdicts mean."""

from types import SimpleNamespace

import assemblies
import pytest
import random_assemblies
from assembly_scenes import random_scene

SOLVED, NONE = 1, 2
"""Seeds of scenes with and without an equilibrium."""


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
