"""A first scene from an assembly."""

import contextlib
import re
import tomllib

import pytest
from mpi4py import MPI
from test_check import drawn_parts

from ddmpi.check import draft
from ddmpi.check.check import check
from ddmpi.check.draft import draft_scene
from ddmpi.errors import InputError, NotConvergedError, TakenError
from ddmpi.mesh.alike import Drawn
from ddmpi.mesh.build import kind_of_files
from ddmpi.scene.reader import read_scene_file, write_toml


@pytest.mark.slow
def test_an_assembly_becomes_a_scene(tmp_path, caplog, monkeypatch):
    """Its parts are bodies by name, or else by number, with contacts where they touch; check proposes no others."""
    monkeypatch.setattr(draft, "FINE", 2.0)
    drawn_parts(tmp_path)
    step = tmp_path / "all.step"
    step.write_text(
        re.sub(r"'Open CASCADE STEP translator [\d.]+ \d+\.1'", "'a block'", step.read_text())
    )
    said = draft_scene(step, tmp_path / "made")
    assert "made/scene.toml: 3 bodies, 3 contacts" in said
    assert "  young = 210000 MPa, poisson = 0.3, lengths in mm\n" in said
    assert (
        "# assumed: steel, MPa and mm; to be added: clamps, loads, friction"
        in (tmp_path / "made" / "scene.toml").read_text()
    )
    halves = "['cylinder r=0.5 at (0, 0.5, {0})', 'cylinder r=0.5 at (0, -0.5, {0})']"
    sides = ", ".join(map(halves.format, ("1", "0.5")))
    assert f"contact of part_2 and part_3: on = [{sides}]" in said
    path = tmp_path / "made" / "scene.toml"
    scene = read_scene_file(path, [], kind_of_files(path))
    parts = [(body.name, body.mesh.part) for body in scene.body]
    assert parts == [("a_block", "a block"), ("part_2", 2), ("part_3", 3)]
    caplog.set_level("INFO", "ddmpi")
    with contextlib.suppress(NotConvergedError):  # nothing is clamped yet
        check(MPI.COMM_SELF, scene, str(path), None, False)
    assert (
        "contact a_block-part_2: " in caplog.text and "where they may touch, add" not in caplog.text
    )
    with pytest.raises(TakenError, match="is there already; nothing is overwritten"):
        draft_scene(step, tmp_path / "made")
    step.write_text("no drawing")
    with pytest.raises(InputError, match=r"all\.step"):
        draft_scene(step, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_names_of_a_file_are_data():
    """Bodies have letters, digits and dashes of labels, each a name of its own; a part is found by the label itself."""
    labels = [
        '<script>alert("x")</script>',
        "../../etc/passwd",
        '"]\n[[rigid]]\nname = "wall',
        "bolt",
        "bolt",
        "bolt_5",
        "Schraube M6×20",
        "",
        "x" * 500,
    ]
    parts = [Drawn(k, label, 10.0, None) for k, label in enumerate(labels, 1)]
    bodies, words = draft._bodies(parts, "all.step")
    names = [body["name"] for body in bodies]
    assert names == [
        "script_alert_x_script",
        "etc_passwd",
        "rigid_name_wall",
        "bolt_4",
        "bolt_5",
        "bolt_5-2",
        "Schraube_M6_20",
        "part_8",
        "x" * 80,
    ]
    assert tomllib.loads(write_toml({"body": bodies}))["body"] == bodies
    assert [body["mesh"]["part"] for body in bodies] == [
        *labels[:3],
        4,
        5,
        *labels[5:7],
        8,
        labels[8],
    ]
    assert not re.search(r"[<>\n/]", "".join(words))
