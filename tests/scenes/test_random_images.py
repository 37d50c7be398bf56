"""Random bodies with slits against two that are bonded, random sectors against their wheels; and scenes with slits,
images and skew supports, checked from their files as scripts/study random_images does; and that check."""

from typing import Any

import image_check
import image_scenes
import numpy as np
import pytest
import random_assemblies
from mpi4py import MPI
from scenes import run_here
from slits import Slit, scene
from test_sectors import BOND, flanks, segment, strained, wheel
from test_slits import are_alike

import ddmpi

pytestmark = pytest.mark.slow


def law_of(rng: np.random.Generator) -> dict[str, Any]:
    """Bonded, guided, by Coulomb or Tresca, or without friction."""
    match rng.integers(5):
        case 0:
            return dict(BOND)
        case 1:
            return {"kind": "guided"}
        case 2:
            return {"friction": {"law": "tresca", "slip_bound": float(rng.uniform(1e4, 1e6))}}
        case 3:
            return {}
    return {"friction": {"law": "coulomb", "coefficient": float(rng.uniform(0.0, 1.0))}}


@pytest.mark.parametrize("seed", range(10))
def test_a_random_slit_is_one_beside_a_bond(tmp_path, seed):
    """In the plane, around an axis and in space, with any law, once or in load steps."""
    rng = np.random.default_rng(seed)
    flat = rng.random() < 0.8
    slit = Slit(2) if flat else Slit(3, (8, 2, 2))
    slit = slit._replace(gap=float(rng.choice([0.0, 1e-4, 1e-3])))
    if flat:
        slit = slit._replace(
            aside=float(rng.choice([0.0, 0.03])), inside=float(rng.choice([0.0, 1.0]))
        )
    order = int(rng.integers(1, 3)) if flat else 1
    load: Any = [*rng.uniform(-8e5, 8e5, slit.dimension - 1), rng.uniform(-2e6, 1e6)]
    load = [float(value) for value in load]
    more: dict[str, Any] = {
        "axisymmetric": slit.inside > 0.0,
        "method": {"tolerance": 1e-10},
    }
    if rng.random() < 0.5:
        factors = [0.0, 1.0, float(rng.uniform(-1.0, 1.0))]
        more |= {"history": {"load": {"times": [0.0, 1.0, 2.0], "factors": factors}}}
        more |= {"time": {"points": [1.0, 2.0], "steps": 2}}
        load = {"on": "top", "value": load, "history": "load"}
    law = law_of(rng)
    one, two = (
        ddmpi.solve(scene(tmp_path, slit, order, load, parted, **law) | more, MPI.COMM_SELF)
        for parted in (False, True)
    )
    assert one.certified == two.certified
    if one.certified:
        are_alike(one, two)


@pytest.mark.parametrize("seed", range(10))
def test_a_random_sector_is_a_part_of_its_wheel(seed):
    """Of one or two parts, with matching flanks or not, bonded or with friction; both have no equilibrium, or one."""
    rng = np.random.default_rng(seed)
    order = int(rng.integers(1, 3))
    twist, waves = rng.uniform(-0.3, 0.3), rng.uniform(-0.2, 0.2)
    pressure = f"1e8 * (1 + {twist}*x*y*(x**2 - y**2) + {waves}*x**2*y**2)"
    loads: dict[str, Any] = {"traction": [{"on": "outer", "pressure": pressure}]}
    if rng.random() < 0.5:
        loads["volume_force"] = ["1e7 * x", "1e7 * y"]

    def law() -> dict[str, Any]:
        rubs = {"friction": {"law": "coulomb", "coefficient": float(rng.uniform(0.2, 0.8))}}
        return dict(BOND) if rng.random() < 0.5 else rubs

    if rng.random() < 0.5:
        middle = float(rng.uniform(20.0, 70.0))
        parts = [
            segment("one", 0.0, middle, order, int(rng.integers(2, 5)), **loads),
            segment("two", middle, 90.0, order, int(rng.integers(2, 5)), **loads),
        ]
        parts[1]["mesh"]["divisions"][1] = int(rng.integers(3, 6))
        inner = {"name": "inner", "bodies": ["one", "two"], "on": ["end", "start"]} | law()
        sector, whole = wheel(parts, [inner, flanks("two", "one", **law())])
    else:
        ring = segment("one", 0.0, 90.0, order, int(rng.integers(3, 6)), **loads)
        sector, whole = wheel([ring], [flanks("one", **law())])
    tight = {"method": {"tolerance": 1e-11}}
    one, all_of_it = (ddmpi.solve(each | tight, MPI.COMM_SELF) for each in (sector, whole))
    assert one.certified == all_of_it.certified
    for body in sector["body"] if one.certified else ():
        found, right = strained(one, body["name"]), strained(all_of_it, f"{body['name']}0")
        assert found == pytest.approx(right, abs=1e-8 * np.abs(right).max())


VERDICTS = {"verified": (1, 6, 8, 28, 52), "reported": (2, 7, 9)}
"""Of seeds: 8 and 52 are bonded slits of linear and quadratic solids, 28 a slit with a soft joint."""


@pytest.mark.parametrize(
    "seed, verdict", [(seed, verdict) for verdict, some in VERDICTS.items() for seed in some]
)
def test_files_of_random_images(tmp_path, seed, verdict):
    """Certified and verified, or without equilibrium."""
    scene = image_scenes.random_scene(seed, tmp_path)
    found = random_assemblies.judge(scene, tmp_path, 1e-5, run_here, image_check)
    assert found[0] == verdict, found


@pytest.mark.parametrize(
    "seed, column, law",
    [
        (6, "gap", "gap by displacements"),
        (6, "slip", "slip by displacements"),
        (6, "normal_force", "force"),
        (6, "tangential_force", "friction bound"),
        (12, "normal_force", "at nodes"),
        (3, "force_z", "tension"),
        (3, "gap", "penetration"),
    ],
)
def test_the_check_of_images_sees_what_is_wrong(tmp_path, monkeypatch, seed, column, law):
    """A column that is not what was computed."""
    scene = image_scenes.random_scene(seed, tmp_path)
    assert random_assemblies.judge(scene, tmp_path, 1e-5, run_here, image_check)[0] == "verified"
    read = image_check.read_results

    def spoiled(path):
        results = read(path)
        for table in results.contacts.values():
            table[column] = -1.01 * table[column] - 1e-6
        return results

    monkeypatch.setattr(image_check, "read_results", spoiled)
    assert image_check.violations(scene, tmp_path / "results")[law] > 1e-5
