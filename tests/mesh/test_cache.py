"""Meshes of drawings that are kept: what they depend on, and that nothing of others is believed."""

import json
import os
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import run_python, to_toml

from ddmpi.errors import InputError
from ddmpi.mesh import cache, geometry
from ddmpi.mesh.cache import FOLDER, beside, opened
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.reader import read_data
from meshes import cad, write
from meshes import drawn as drawn_of

SQUARE = """
SetFactory("OpenCASCADE");
Include "size.geo";
Rectangle(1) = {0, 0, 0, a, 1};
Physical Curve("rim") = {1, 2, 3, 4};
"""

SIDES = "bottom", "right", "top", "left"

drawn = partial(drawn_of, size=0.25)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A function that meshes the drawing with a `size`, whether gmsh did; what it keeps is beside tmp_path/results."""
    monkeypatch.setattr(cache, "LONG", 0.0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    write(tmp_path / "size.geo", "a = 1;\n")
    path, apart = write(tmp_path / "square.geo", SQUARE), geometry.apart

    def mesh(size: float = 0.25, cache: bool | str = True) -> tuple[Mesh, bool]:
        calls = []
        monkeypatch.setattr(
            geometry, "apart", lambda *of, **how: (calls.append(of), apart(*of, **how))[1]
        )
        with beside(str(tmp_path / "results")), opened(cache):
            return drawn(path, size=size), bool(calls)

    return mesh


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.exists() else set()


def test_a_drawing_is_meshed_once(kept, tmp_path):
    """The kept mesh is the same to the bit; other sizes, other content of the drawing or of a file that it includes,
    have other meshes."""
    (first, made), (again, made_again) = kept(), kept()
    assert made and not made_again
    assert (first.points == again.points).all() and (first.triangles == again.triangles).all()
    assert first.groups.keys() == again.groups.keys()
    assert kept(0.5)[1] and not kept(0.5)[1]
    write(tmp_path / "size.geo", "a = 2;\n")
    wide, made = kept()
    assert made and np.ptp(wide.points[:, 0]) == pytest.approx(2.0)
    write(tmp_path / "square.geo", SQUARE + "// another\nRectangle(2) = {0, 2, 0, 1, 1};\n")
    with pytest.raises(InputError, match="2 surfaces"):
        kept()
    assert len(names(tmp_path / FOLDER)) == 3


def test_numbered_faces_are_kept(kept, tmp_path):
    """With all that a drawing says of them."""
    cad(tmp_path / "part.step", lambda occ: occ.addCylinder(0, 0, 0, 0, 0, 1, 0.5))
    kept()
    with beside(str(tmp_path / "results")), opened(True):
        one, other = (drawn(tmp_path / "part.step") for _ in range(2))
    assert one.faces == other.faces and any(face.axis for face in one.faces.values())
    assert len(names(tmp_path / FOLDER)) == 2


def test_another_version_makes_other_meshes(kept, tmp_path, monkeypatch):
    """Of ddmpi and of gmsh, whose module names it."""
    kept()
    with monkeypatch.context() as patch:
        patch.setattr(cache.ddmpi, "__version__", "0.0.0")
        assert kept()[1]
    write(tmp_path / "gmsh.py", "__version__ = '0.0.0'")
    monkeypatch.setattr(cache, "find_spec", lambda _: SimpleNamespace(origin=tmp_path / "gmsh.py"))
    assert kept()[1] and not kept()[1]


def test_nothing_is_kept_unasked(kept, tmp_path, monkeypatch):
    """Without a folder of results, as in Python, with output.cache = false, and of meshes that take no time."""
    assert kept(cache=False)[1] and kept(cache=False)[1]
    with opened(True):
        drawn(tmp_path / "square.geo")
    monkeypatch.setattr(cache, "LONG", 1e9)
    assert kept()[1] and kept()[1]
    monkeypatch.setenv(geometry.TRUST, "1")  # such a drawing may read anything
    monkeypatch.setattr(cache, "LONG", 0.0)
    assert kept()[1] and kept()[1]
    assert not (tmp_path / FOLDER).exists()


def test_a_damaged_mesh_is_told_and_made_again(kept, tmp_path, capfd):
    """Cut, changed, a pipe, a link; nothing of it is read, and the next mesh is kept in its place."""
    whole = kept()[0]
    (entry,) = (tmp_path / FOLDER).iterdir()
    data = entry.read_bytes()
    outside = tmp_path / "outside"
    outside.write_bytes(data)

    def link() -> None:
        entry.unlink()
        entry.symlink_to(outside)

    def pipe() -> None:
        entry.unlink()
        os.mkfifo(entry)

    for spoil in (
        lambda: entry.write_bytes(data[:-1]),
        lambda: entry.write_bytes(data.replace(b"rim", b"rin")),
        lambda: entry.write_bytes(b""),
        link,
        pipe,
    ):
        spoil()
        mesh, made = kept()
        assert made and "is damaged, and not used" in capfd.readouterr().err
        assert (mesh.points == whole.points).all()
        assert not kept()[1] and not capfd.readouterr().err
    assert outside.read_bytes() == data and entry.read_bytes() == data


def test_meshes_of_another_account_are_not_believed(kept, tmp_path, monkeypatch):
    """They have other names, and would have another digest; each finds its own."""
    kept()
    theirs = (tmp_path / FOLDER / names(tmp_path / FOLDER).pop()).read_bytes()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "other"))
    assert kept()[1] and len(names(tmp_path / FOLDER)) == 2
    for entry in (tmp_path / FOLDER).iterdir():
        entry.write_bytes(theirs)
    assert kept()[1] and not kept()[1]
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "odd" / "ddmpi").mkdir(parents=True)
    (tmp_path / "odd" / "ddmpi" / "key").symlink_to(tmp_path / "pipe")
    for home in "/proc/nowhere", str(tmp_path / "odd"):  # no key, so none is kept
        monkeypatch.setenv("XDG_CACHE_HOME", home)
        assert kept()[1] and kept()[1]
    assert (tmp_path / "home" / "ddmpi" / "key").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("where", ["parts", "in/parts"])
def test_links_lead_nowhere(kept, tmp_path, capfd, where):
    """A folder of a scene is beside the results; one that is a link, or in a link, is not used."""
    (tmp_path / "outside" / "parts").mkdir(parents=True)
    assert kept(cache="mine/parts")[1] and not kept(cache="mine/parts")[1]
    link = tmp_path / where.partition("/")[0]
    link.symlink_to(tmp_path / "outside")
    assert kept(cache=where)[1] and kept(cache=where)[1]
    assert f"{tmp_path / where} is a link, and no folder for meshes" in capfd.readouterr().err
    assert names(tmp_path / "outside") == {"parts"} and not names(tmp_path / "outside" / "parts")
    assert kept(cache=str(tmp_path / "outside"))[1]  # of the command line
    assert len(names(tmp_path / "outside")) == 2


@pytest.mark.parametrize("cache", ["/tmp/meshes", "../meshes", "a/../../b"])
def test_a_scene_names_no_folder_elsewhere(cache):
    """Who starts the run may."""
    scene = f'[output]\ncache = "{cache}"\n'
    with pytest.raises(InputError, match="a scene may name a folder beside its results alone"):
        read_data("scene.toml", scene)
    assert read_data("scene.toml", "", [f"output.cache={cache}"])["output"] == {"cache": cache}
    assert read_data("scene.toml", '[output]\ncache = "a/b"\n')["output"] == {"cache": "a/b"}


@pytest.mark.parametrize("cache", ["a\x00b", "a\x1b[31m"])
def test_control_characters_name_no_folder(cache):
    """A zero would end the program, and others would be told to a terminal."""
    scene = f"[output]\ncache = {json.dumps(cache)}\n"
    with pytest.raises(InputError, match=r"output\.cache: 'a\\x.*' has control characters"):
        read_data("scene.toml", scene)


def test_a_folder_that_cannot_be_written_is_told(kept, tmp_path, capfd):
    """The mesh is there all the same."""
    (tmp_path / FOLDER).write_text("a file")
    assert len(kept()[0].points) > 4
    assert "meshes are not kept" in capfd.readouterr().err


COMMAND = """
import sys
from ddmpi.mesh import cache
cache.LONG = 0.0
sys.argv[:] = ["ddmpi", *sys.argv[1:]]
from ddmpi.cli.main import main
main()
"""


@pytest.mark.slow
def test_commands_keep_meshes_for_each_other(tmp_path):
    """Beside the folder of results, also on several ranks at once; the answer is the same."""
    for name, y in (("upper", 1), ("lower", 0)):
        groups = (f'Physical Curve("{side}") = {{{k}}};' for k, side in enumerate(SIDES, 1))
        rectangle = f'SetFactory("OpenCASCADE"); Rectangle(1) = {{0, {y}, 0, 1, 1}};'
        write(tmp_path / f"{name}.geo", "\n".join([rectangle, *groups]))
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    bodies = [
        {
            "name": name,
            "mesh": {"geometry": f"{name}.geo", "size": size},
            "material": {"young": 1e9, "poisson": 0.3},
            "clamp": ["left"],
            "traction": [{"on": "right", "value": [0.0, -1e5]}],
        }
        for name, size in (("upper", 0.25), ("lower", 0.5))
    ]
    scene = write(tmp_path / "scene.toml", to_toml({"body": bodies, "contact": [contact]}))
    kept = []
    for command, more in ("check", ["--no-figures"]), ("run", ["--no-figures"]):
        output = str(tmp_path / "results" / command)
        arguments = [command, str(scene), "--output", output, *more]
        run = run_python(["-c", COMMAND, *arguments], 2, cwd=tmp_path)
        assert run.code == 0, run.stderr
        folder = tmp_path / "results" / FOLDER
        kept.append({path.name: path.stat().st_mtime_ns for path in folder.iterdir()})
    assert kept[0] == kept[1] and len(kept[0]) == 2
