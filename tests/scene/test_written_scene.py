"""A resolved scene as TOML."""

import json
import tomllib

import pytest
from scenes import ROOT

from ddmpi.scene.reader import read_scene, read_scene_file, write_toml


@pytest.mark.parametrize("path", sorted((ROOT / "configs").rglob("*.toml")), ids=lambda path: path.stem)
def test_a_written_scene_is_read_as_the_same(path):
    """The scene in a summary, written as TOML, is the scene that was read."""
    scene = read_scene_file(path)
    assert read_scene("written", write_toml(json.loads(json.dumps(scene.resolved())))) == scene


def test_all_that_a_scene_can_hold():
    """Strange strings and keys, empty tables, lists of tables within tables, and numbers of all sizes."""
    odd = 'quotes " \\ \n\t\x00\x7f é 🙂'
    data = {"title": odd, "body": [{"name": "a b", "clamp": ["left", {"on": odd, "x": 1e-300}], "none": None},
                                   {"traction": [{"on": "x", "value": [-0.0, 2.119e11]}, {"on": "y"}], "empty": []}],
            "rigid": [], "history": {"é.1": {"times": [0.0, 1], "factors": [True, False]}}, "time": None,
            "petsc": {"body_ksp_rtol": 1e-05}, "checkpoint": {}}
    written = tomllib.loads(write_toml(data))
    for gone in (data["body"][0].pop("none"), data["body"][1].pop("empty"), data.pop("rigid"), data.pop("time"),
                 data.pop("checkpoint")):
        assert not gone
    assert written == data
