"""ddmpi against the brute-force reference on thirty of the assemblies of scripts/random_assemblies.py."""

import assemblies
import pytest
import random_assemblies
from assembly_scenes import random_scene
from mpi4py import MPI

pytestmark = pytest.mark.slow

TOLERANCE = 1e-6
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


@pytest.mark.parametrize("family, seed, verdict", [
    (family, seed, verdict) for family, both in SEEDS.items()
    for seeds, verdict in zip(both, ("agrees", "reported"), strict=True) for seed in seeds])
def test_random_assembly(family, seed, verdict):
    """Displacements to 1e-6 where there is an equilibrium; where there is none, ddmpi says so."""
    scene = random_scene(seed)
    assert scene["title"].startswith(family)
    found = random_assemblies.judge(assemblies.solve(scene), random_assemblies.solve(scene, MPI.COMM_SELF), TOLERANCE)
    assert found[0] == verdict, found
