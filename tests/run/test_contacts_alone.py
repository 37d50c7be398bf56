"""output.only = "contacts": the same contacts, certificate and reactions as of a whole run, and nothing else."""

import json

import pytest
from scenes import call, pinched_blocks, rectangle, seldom, to_toml, tower

import ddmpi
from ddmpi.errors import InputError

LEFT_OUT = {"von_mises_max", "von_mises_max_at", "energy", "discretization_error", "memory_mib"}
"""Entries of a body that are null, or differ from run to run."""


def rubbed() -> dict:
    """A block on a block that is pressed, then pushed to and fro, in three legs."""
    lower = rectangle("lower", [0.0, 0.0], [3.0, 1.0], [9, 3], clamp=["bottom"])
    upper = rectangle(
        "upper",
        [0.5, 1.0],
        [2.0, 1.0],
        [4, 2],
        young=2e9,
        clamp=[{"on": "top", "y": -1e-3}, {"on": "top", "x": 1e-3, "history": "push"}],
    )
    return {
        "body": [upper, lower],
        "contact": [
            {
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.4},
            }
        ],
        "history": {"push": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 0.0, 1.0, -1.0]}},
        "time": {"points": [1.0, 2.0, 3.0], "steps": 2},
    }


@pytest.mark.parametrize(
    "scene", [pinched_blocks(4), seldom(rubbed()), tower(2, 2)], ids=["held", "load steps", "loose"]
)
def test_tables_are_those_of_a_whole_run(scene, tmp_path):
    """The tables and the summary's numbers are those of a whole run to the bit; nothing else is written or told."""
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene), encoding="utf-8")
    whole, alone = tmp_path / "whole", tmp_path / "alone"
    call("run", str(path), "--output", str(whole), "--no-figures")
    done = call("run", str(path), "--output", str(alone), "--set=output.only=contacts")
    contacts = {
        f"contact_{name}.csv"
        for name in json.loads((whole / "summary.json").read_text())["contacts"]
    }
    tables = (
        contacts | {"steps.csv", "history.csv"} | ({"energy.csv"} if "time" in scene else set())
    )
    assert {file.name for file in alone.iterdir()} == tables | {"summary.json"}
    for name in tables:
        assert (alone / name).read_bytes() == (whole / name).read_bytes()
    one, other = (json.loads((folder / "summary.json").read_text()) for folder in (alone, whole))
    assert 'output.only = "contacts"' in done.stdout
    for entry in one["bodies"].values():
        assert [entry[key] for key in ("von_mises_max", "energy", "discretization_error")] == [
            None
        ] * 3
    for summary in one, other:
        for body in summary["bodies"].values():
            for key in LEFT_OUT:
                del body[key]
        for key in (
            "scene",
            "seconds",
            "started",
            "run",
            "command",
            "discretization_error",
            "warnings",
        ):
            del summary[key]
    assert one == other
    for command in ["figures"], ["path", "--from=0,0", "--to=1,0"]:
        refused = call(*command, str(alone))
        assert refused.code == 2
        assert "holds contacts alone" in refused.stderr
    assert call("report", str(alone)).code == 0


def test_what_is_left_out_cannot_be_asked_for():
    """What only = "contacts" leaves out is refused beside it; a target of accuracy has its estimate."""
    scene = pinched_blocks(4)
    for key in "error", "animation", "view":
        with pytest.raises(InputError, match=f"{key} = true asks for what only"):
            ddmpi.solve(scene, overrides={f"output.{key}": True}, only="contacts")
    with pytest.raises(InputError, match=r"output\.only"):
        ddmpi.solve(scene, only="contact")
    answer = ddmpi.solve(
        scene, overrides={"method.target_error": 0.2, "body.upper.mesh.order": 1}, only="contacts"
    )
    assert answer.summary["discretization_error"]["energy_norm"] < 0.2


@pytest.mark.slow
def test_a_drawn_body_needs_no_estimate_without_a_target(tmp_path):
    """Finer meshes follow from estimates, which are made with a target alone."""
    pytest.importorskip("gmsh")
    (tmp_path / "block.geo").write_text(
        'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 1, 1}; Physical Surface("b") = {1};'
        'Physical Curve("low") = {1}; Physical Curve("top") = {3};',
        encoding="utf-8",
    )
    block = {
        "name": "block",
        "mesh": {"geometry": str(tmp_path / "block.geo"), "size": 0.5},
        "material": {"young": 2e11, "poisson": 0.3},
        "traction": [{"on": "top", "pressure": 1e6}],
    }
    scene = {
        "body": [block],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0, 0], "normal": [0, 1]}],
        "contact": [{"bodies": ["block", "floor"], "on": ["low"]}],
    }
    answer = ddmpi.solve(scene, only="contacts")
    assert answer.certified
    assert answer.contacts["block-floor"].pressure == pytest.approx(1e6)
    assert answer.summary["discretization_error"]["energy_norm"] is None
    finer = ddmpi.solve(scene, overrides={"method.target_error": 0.3}, only="contacts")
    assert finer.summary["discretization_error"]["energy_norm"] < 1e-3
