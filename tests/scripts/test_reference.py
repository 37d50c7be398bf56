"""The reference pages and the JSON schema are what the code says."""

import functools
import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from scenes import pinched_blocks, run_python
from test_studies import start

from ddmpi.scene.scene import Scene
from ddmpi.scene.schema import json_schema

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "configs").rglob("*.toml"))


@functools.cache
def schema() -> dict:
    return json_schema(Scene)


def mistakes(scene: dict) -> list[str]:
    jsonschema = pytest.importorskip("jsonschema", reason="needs the package jsonschema")
    return [
        "/".join(map(str, error.absolute_path))
        for error in jsonschema.Draft7Validator(schema()).iter_errors(scene)
    ]


def content(path: Path) -> Any:
    """Text; of a schema the data, whose order depends on the version of msgspec."""
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if path.suffix == ".json" else text


def test_committed_pages_are_those_of_the_code(tmp_path):
    """The pages in docs/reference/ are generated from the code as it is."""
    start(tmp_path, "reference", str(tmp_path / "made"))
    made, committed = (
        {path.name: content(path) for path in folder.iterdir()}
        for folder in (tmp_path / "made", ROOT / "docs" / "reference")
    )
    assert made.keys() == committed.keys() - {"results.md", "security.md"}
    for name in made:
        assert made[name] == committed[name], (
            f"docs/reference/{name} is stale: run scripts/reference.py"
        )


@pytest.mark.parametrize("path", SCENES)
def test_schema_accepts(path):
    """The schema accepts every scene that is shipped."""
    assert mistakes(tomllib.loads((ROOT / path).read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    "key, value, where",
    [
        ("titel", "misspelt", ""),
        ("title", 3, "title"),
        ("output", {"stress": "yes"}, "output/stress"),
        ("method", {"tolerance": 2.0}, "method/tolerance"),
        ("method", {"theata": 0.2}, "method"),
        (
            "contact",
            [{"bodies": ["upper", "lower", "both"], "on": ["bottom", "top"]}],
            "contact/0/bodies",
        ),
        ("history", {"a b": {"times": [0.0], "factors": [1.0]}}, "history"),
    ],
)
def test_schema_refuses(key, value, where):
    """The schema refuses misspelt keys, wrong types and numbers beyond their limits, and says where."""
    scene = json.loads(json.dumps(pinched_blocks(2)))
    assert mistakes(scene) == []
    assert mistakes(scene | {key: value}) == [where]


@pytest.mark.slow
def test_the_command_prints_the_schema():
    """``ddmpi schema`` prints the schema, once, on any number of ranks."""
    done = run_python(["-m", "ddmpi", "schema"], ranks=2)
    assert done.code == 0, done.messages
    assert json.loads(done.stdout) == json_schema(Scene)


def test_every_key_has_a_meaning():
    """Every key of a scene is described, but for those that only choose a table."""
    described = {
        f"{name}.{key}": "description" in value
        for name, table in schema()["$defs"].items()
        for key, value in table["properties"].items()
    }
    assert len(described) > 90
    assert {key for key, has in described.items() if not has} == {
        "Plane.shape",
        "Circle.shape",
        "Sphere.shape",
        "Cylinder.shape",
        "Node.shape",
        "Coulomb.law",
        "Tresca.law",
        "NoFriction.law",
    }
