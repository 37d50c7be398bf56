"""Bodies that touch only along an edge or at a vertex: forces without an area."""

import numpy as np
import pytest
from scenes import rectangle, run_here, seldom, write_scene
from solid_scenes import box

import ddmpi
from ddmpi.errors import InputError

PLACES = {
    "edge": ((1.0, 0.0, 1.0), 4),
    "vertex": ((1.0, 1.0, 1.0), 1),
    "corner in the plane": ((1.0, 1.0), 1),
}
"""Where the upper body begins, and how many nodes it shares with the lower one."""


def scene(place: str, cells: int = 3, **more) -> dict:
    """A unit body that presses with its weight on one of 3 cells a side, which it touches at the `place`."""
    origin, d = PLACES[place][0], len(PLACES[place][0])
    make, still = (rectangle, {"x": 0.0}) if d == 2 else (box, {"x": 0.0, "y": 0.0})
    return {
        "body": [
            make("a", (0.0,) * d, (1.0,) * d, (3,) * d, clamp=["bottom"]),
            make(
                "b",
                origin,
                (1.0,) * d,
                (cells,) * d,
                clamp=[{"on": "right"} | still],
                volume_force=[0.0] * (d - 1) + [-1e3],
            ),
        ],
        "contact": [
            {
                "bodies": ["b", "a"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
            | more
        ],
    }


@pytest.mark.parametrize("place", [seldom("edge"), "vertex", "corner in the plane"])
def test_forces_without_stresses(place, tmp_path):
    """The nodes carry the weight and no stress, the table and the summary say so, and pictures can be drawn."""
    drawn = [] if place == "edge" else ["--no-figures"]
    done = run_here(write_scene(scene(place), tmp_path / "scene.toml"), tmp_path / "out", *drawn)
    assert done.code == 0, done.output
    summary, table = done.summary["contacts"]["b-a"], done.table("contact_b-a.csv")
    assert summary["force"][-1] == pytest.approx(1e3) and summary["m"] == PLACES[place][1]
    assert summary["pressure_max"] is None
    assert np.array(table["normal_force"], float).sum() == pytest.approx(1e3)
    assert np.isnan(np.array(table["normal_stress"], float)).all()
    assert not np.array(table["area" if "area" in table else "length"], float).any()
    assert sum("no area and no stresses" in each for each in done.summary["warnings"]) == 1
    assert "no area" in done.output and (tmp_path / "out" / "bodies.png").exists() == (not drawn)


@pytest.mark.parametrize("place", PLACES)
def test_a_slip_bound_without_an_area_is_refused(place):
    """Tresca's bound is a stress: times no area it holds nothing."""
    with pytest.raises(InputError, match=r"contact.b-a.friction: .* no area to act on"):
        ddmpi.solve(scene(place, friction={"law": "tresca", "slip_bound": 1e5}))


@pytest.mark.parametrize("place", PLACES)
def test_a_soft_joint_without_an_area_is_refused(place):
    """Softness is closure per pressure."""
    words = r"contact.b-a.softness: .* at \(1, [01, ]*\), where a joint has no area to be soft"
    with pytest.raises(InputError, match=words):
        ddmpi.solve(scene(place, softness=1e-12))


@pytest.mark.parametrize("cells", [2, 4, 6])
def test_nodes_along_an_edge_must_match(cells):
    """Where they do not, no pair of them stands for the edge, at its ends neither."""
    with pytest.raises(
        InputError, match="along an edge or at a vertex only, their nodes there must match"
    ):
        ddmpi.solve(scene("edge", cells))


@pytest.mark.parametrize("cells", [2, 4])
def test_at_a_vertex_other_nodes_do_not_count(cells):
    """Bodies that share a vertex have no other node to match."""
    assert ddmpi.solve(scene("vertex", cells)).contacts["b-a"].force[-1] == pytest.approx(1e3)
