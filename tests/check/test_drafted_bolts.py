"""Bolts of assemblies: threads, heads and nuts by their faces; what is no bolt; and the scene that import writes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scenes import seldom

import ddmpi
from ddmpi.check import draft
from ddmpi.check.bolts import Bolt, find_bolts, is_of_shank
from ddmpi.check.check import check
from ddmpi.check.nearby import Boundary, Missing, find_missing
from ddmpi.errors import InputError, NotConvergedError
from ddmpi.mesh.build import kind_of_files
from ddmpi.mesh.mesh import Face
from ddmpi.scene.reader import read_scene_file
from meshes import cad, mesh_of


def block(occ, low: float, high: float, *radii: float, across: float = 10.0) -> None:
    """A square block from `low` to `high` along z, with a hole of the first radius, and of the next ones above it."""
    step = (high - low) / max(len(radii), 1)
    holes = [(3, occ.addCylinder(0, 0, low + k * step, 0, 0, step, r)) for k, r in enumerate(radii)]
    occ.cut([(3, occ.addBox(-across, -across, low, 2 * across, 2 * across, high - low))], holes)


def pin(occ, *ends: tuple[float, float, float]) -> None:
    """A pin along z of cylinders, each from where to where, and of a radius."""
    first, *others = [(3, occ.addCylinder(0, 0, low, 0, 0, high - low, r)) for low, high, r in ends]
    if others:
        occ.fuse([first], others)


def tapped(occ) -> None:
    """A plate with clearance on a tapped block, and a bolt with a head on the plate."""
    block(occ, -10, 0, 3.0)
    block(occ, 0, 5, 3.3)
    pin(occ, (-8, 5, 3.0), (5, 9, 5.0))


def through(occ) -> None:
    """Two plates, a bolt through both, and a nut below."""
    block(occ, -5, 0, 3.3)
    block(occ, 0, 5, 3.3)
    pin(occ, (-12, 5, 3.0), (5, 9, 5.0))
    block(occ, -10, -5, 3.0, across=5.0)


def rod(occ) -> None:
    """A plate between two nuts on a rod."""
    block(occ, 0, 8, 3.3)
    pin(occ, (-9, 17, 3.0))
    block(occ, -5, 0, 3.0, across=5.0)
    block(occ, 8, 13, 3.0, across=5.0)


def fit(occ) -> None:
    """A pin with a head that fits its hole from the head on."""
    block(occ, -10, 0, 3.0)
    block(occ, 0, 5, 3.0)
    pin(occ, (-8, 5, 3.0), (5, 9, 5.0))


def dowel(occ) -> None:
    """A pin without a head in two plates."""
    block(occ, -10, 0, 3.0)
    block(occ, 0, 5, 3.0)
    pin(occ, (-8, 4, 3.0))


def loose(occ) -> None:
    """A bolt whose head is away from the plate."""
    block(occ, -10, 0, 3.0)
    block(occ, 0, 5, 3.3)
    pin(occ, (-8, 9, 3.0), (9, 13, 5.0))


def thick(occ) -> None:
    """A bolt that is wider than the hole below the plate."""
    block(occ, -10, 0, 2.5)
    block(occ, 0, 5, 3.3)
    pin(occ, (-8, 5, 3.0), (5, 9, 5.0))


def bolts_of(path: Path, parts: int, size: float = 5.0) -> tuple[list[Bolt], list[set[str]]]:
    """The bolts of a drawing, and the bodies of the contacts that are not theirs."""
    bodies = {
        str(k): Boundary.of(mesh_of(geometry=str(path), part=k, size=size, around=9))
        for k in range(1, parts + 1)
    }
    missing = list(find_missing(bodies, [], []))
    found = find_bolts(bodies, missing)
    return found, [{*lack.bodies} for lack in missing if not is_of_shank(lack, found)]


@pytest.mark.parametrize(
    ("draw", "parts", "expected", "contacts"),
    [
        (tapped, 3, [("1", "3", 1.0)], [{"1", "2"}, {"2", "3"}]),
        seldom(through, 4, [("4", "3", 1.0)], [{"1", "2"}, {"1", "4"}, {"2", "3"}]),
        seldom(rod, 4, [("3", "2", 1.0), ("4", "2", 0.0)], [{"1", "3"}, {"1", "4"}]),
        seldom(fit, 3, [], None),
        seldom(dowel, 3, [], None),
        seldom(loose, 3, [], None),
        seldom(thick, 3, [], None),
    ],
)
def test_bolts_are_found_by_their_faces(tmp_path, draw: Callable, parts, expected, contacts):
    """Whatever way they point: the body with the hole first, pulled towards the head, or the other nut; the shank touches
    nothing else. Fits, dowels, heads in the air and holes of other radii are no bolts."""
    turns = {"as drawn": None} | ({"askew": (1.0, 2.0, 3.0, 2.9)} if expected else {})
    for name, turn in turns.items():

        def turned(occ, turn=turn) -> None:
            draw(occ)
            if turn:
                occ.rotate(occ.getEntities(3), 1, 2, 3, *turn)

        found, others = bolts_of(cad(tmp_path / f"{name}.brep", turned), parts)
        assert [bolt.bodies for bolt in found] == [(hole, own) for hole, own, _ in expected]
        axis = np.array([0.0, 0.0, 1.0])
        if turn:
            about = np.array(turn[:3]) / np.linalg.norm(turn[:3])
            sine, cosine = np.sin(turn[3]), np.cos(turn[3])
            axis = cosine * axis + sine * np.cross(about, axis) + (1 - cosine) * about[2] * about
        for bolt, (_, _, way) in zip(found, expected, strict=True):
            assert (bolt.along is None) == (way == 0.0)
            if bolt.along is not None:
                assert np.allclose(bolt.along, way * axis, atol=1e-6)
        assert contacts is None or sorted(map(sorted, others)) == sorted(map(sorted, contacts))


def turned(radius: float, low: float, high: float, out: float = -1.0) -> Boundary:
    """A body around z with a hole of a radius, or a pin where its normal points `out`, and both ends: a facet of each."""
    ends = ((0.0, 0.0, low), (0.0, 0.0, high))
    faces = {name: Face("plane", 0.0, 1.0, ()) for name in ("below", "above")}
    faces["side"] = Face("cylinder", radius, 1.0, (), axis=ends)
    across = [[[radius, 0.0, z], [radius + 1.0, 0.0, z], [radius, 1.0, z]] for z in (low, high)]
    along = [[radius, 0.0, low], [radius, 0.1, high], [radius, -0.1, high]]
    normal = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [out, 0.0, 0.0]])
    groups = {name: np.arange(3) == k for k, name in enumerate(faces)}
    return Boundary(np.arange(9).reshape(3, 3), np.array([*across, along]), normal, groups, faces)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        ("plate", "plate", ["low", "high"]),
        ("floor", "roof", []),
        ("plate", "roof", []),
        ("floor", "plate", []),
    ],
)
def test_two_nuts_on_a_rod_clamp_what_is_between_them(low, high, expected):
    """Both bear on it, and one of them is pulled towards the other. Nuts that bear on what is beyond them are no bolts."""
    bodies = {
        "rod": turned(3.0, -9.0, 17.0, out=1.0),
        "floor": turned(3.3, -8.0, -5.0),
        "low": turned(3.0, -5.0, 0.0),
        "plate": turned(3.3, 0.0, 8.0),
        "high": turned(3.0, 8.0, 13.0),
        "roof": turned(3.3, 13.0, 16.0),
    }
    touching = [
        Missing(pair, ("above", "below"), np.empty((0, 3, 3)), (0.0, 0.0))
        for pair in zip(bodies, [*bodies][1:], strict=False)
        if {*pair} in ({low, "low"}, {high, "high"})
    ]
    assert len(touching) == 2
    found = find_bolts(bodies, touching)
    assert [bolt.bodies for bolt in found] == [(nut, "rod") for nut in expected]
    assert [bolt.pretension for bolt in found] == [{"along": [0.0, 0.0, 1.0]}, None][: len(found)]


@pytest.mark.slow
def test_an_assembly_with_a_bolt_becomes_a_scene_that_lacks_a_force(tmp_path, caplog, monkeypatch):
    """check does without the force; a run refuses before any work, by the contact; with it the bolt is pulled."""
    monkeypatch.setattr(draft, "FINE", 2.0)
    path = cad(tmp_path / "joint.step", tapped)
    said = draft.draft_scene(path, tmp_path / "made")
    assert "thread of part_3 in part_1: on = ['cylinder r=3 at " in said
    assert "  materials, clamps, loads and friction, forces of bolts (# to be filled in); " in said
    target = tmp_path / "made" / "scene.toml"
    text = target.read_text().replace("order = 2", "around = 9")  # cheaper meshes
    assert text.count("around = 9") == 3
    (line,) = [each for each in text.splitlines() if each.startswith("pretension")]
    assert line.startswith("pretension = { along = [0.0, 0.0, 1.0] }  # to be filled in: force = ")
    bottom = "plane n=(0, 0, -1) at (9, 0, -10)"
    clamped = re.sub(r'name = "part_1"\n', f'name = "part_1"\nclamp = ["{bottom}"]\n', text)
    target.write_text(clamped)
    scene = read_scene_file(target, [], kind_of_files(target))
    caplog.set_level("INFO", ddmpi.__name__)
    try:
        check(MPI.COMM_SELF, scene, str(target), None, False)
    except NotConvergedError as mechanism:
        raise AssertionError("the bolt holds the plate") from mechanism
    assert "pulled by a force that is to be given along (0, 0, 1)" in caplog.text
    with pytest.raises(
        InputError, match=r"contact\.part_3-thread\.pretension: force is missing, the"
    ):
        ddmpi.solve(target, MPI.COMM_SELF)
    target.write_text(clamped.replace("{ along", "{ force = 1e3, along"))
    answer = ddmpi.solve(target, MPI.COMM_SELF)
    contacts = answer.summary["contacts"]
    assert contacts["part_3-thread"]["pretension"]["force"] == pytest.approx(1e3)
    assert contacts["part_2-part_3"]["normal_force"] == pytest.approx(1e3, rel=1e-6)
    assert contacts["part_1-part_2"]["normal_force"] == pytest.approx(1e3, rel=1e-6)
