"""What the ranks of a scene do at the same time, and what they tell of it."""

import time

import pytest
from mpi4py import MPI
from scenes import LIMIT, pinched_blocks, prepare_scene

from ddmpi.coupling import assembly
from ddmpi.mesh import geometry

SQUARE = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, %d, 0, 1, 1};
Physical Curve("bottom") = {1}; Physical Curve("right") = {2};
Physical Curve("top") = {3}; Physical Curve("left") = {4};
"""


@pytest.mark.mpi(ranks=2)
def test_parts_are_meshed_side_by_side(comm, tmp_path, monkeypatch):
    """Each rank meshes its own parts, and none waits for another one."""
    met, apart = [], geometry.apart

    def meeting(*arguments, **how):
        both, end = MPI.COMM_WORLD.Ibarrier(), time.monotonic() + LIMIT
        while not (together := both.Test()) and time.monotonic() < end:
            time.sleep(0.01)
        met.append(together)
        return apart(*arguments, **how)

    monkeypatch.setattr(geometry, "apart", meeting)
    bodies = []
    for k, name in enumerate(("lower", "upper")):
        path = tmp_path / f"{name}.geo"
        path.write_text(SQUARE % k)
        mesh = {"geometry": str(path), "size": 0.5}
        material = {"young": 1e9, "poisson": 0.3}
        bodies.append({"name": name, "mesh": mesh, "material": material, "clamp": ["left"]})
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    prepare_scene(comm, {"body": bodies, "contact": [contact]})
    assert met == [True]


def test_a_large_body_tells_that_multigrid_is_set_up(caplog, monkeypatch):
    """Before, as no thread can tell it; a phase that takes long knows its last body."""
    told, scene = [], pinched_blocks(6, compliance="iterative")
    caplog.set_level("INFO", "ddmpi")
    monkeypatch.setattr(assembly, "now_at", told.append)
    for largest, lines in ((1, 2), (10**9, 0)):
        monkeypatch.setattr(assembly, "LARGE", largest)
        caplog.clear()
        prepare_scene(MPI.COMM_SELF, scene)
        words = [
            record.getMessage()
            for record in caplog.records
            if "multigrid is set up for" in record.message
        ]
        assert len(words) == lines
    assert told == ["body.upper, multigrid", "body.lower, multigrid"] * 2
