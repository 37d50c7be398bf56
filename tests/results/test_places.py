"""The places of the largest values of a summary: displacement, von Mises stress, pressure."""

import numpy as np
import pytest
import scenes
from mpi4py import MPI

import ddmpi
from ddmpi.results.histories import at_step
from ddmpi.results.summary import largest, place_of_all, where
from ddmpi.results.tables import read_results
from ddmpi.run.answer import Answer
from ddmpi.system.numbers import place_of_largest


def test_equal_values_have_one_place_in_any_order():
    """Of values that differ by rounding the smallest x, then y; whatever their order, and with rounded coordinates."""
    rng = np.random.default_rng(1)
    places = np.array([[1.0, 2.0], [1.0 + 1e-14, 1.0], [2.0, 0.0], [3.0, 0.5]])
    values = np.array([5.0, 5.0 * (1 - 1e-9), 5.0 * (1 + 1e-9), 4.9])
    for _ in range(10):
        order = rng.permutation(4)
        assert place_of_largest(values[order], places[order]) == pytest.approx([1.0, 1.0])


def test_no_value_has_no_place():
    """Zeros, values that are not finite, and no values at all; a tension everywhere has the least one."""
    assert place_of_largest(np.zeros(2), np.eye(2)) is None
    assert place_of_largest(np.ones(2), np.array([[-1e-15, 0.0], [5.0, 5.0]])).tolist() == [
        0.0,
        0.0,
    ]
    assert place_of_largest(np.full(2, np.nan), np.eye(2)) is None
    assert place_of_largest(np.empty(0), np.empty((0, 2))) is None
    assert place_of_largest(np.array([-2.0, -1.0]), np.eye(2)).tolist() == [0.0, 1.0]


def test_places_of_several_bodies_do_not_depend_on_their_order():
    """The summary's place, and the body that the log names, of two that move equally far but for rounding either way;
    others have not moved, or are not computed."""
    one = {"moved": 3.0, "moved_at": [2.0, 0.0]}
    still, unknown = {"moved": 0.0, "moved_at": None}, {"moved": None, "moved_at": None}
    for rounding in (1e-12, -1e-12):
        other = {"moved": 3.0 * (1 + rounding), "moved_at": [1.0, 0.0]}
        entries = {"a": one, "b": other, "c": still, "d": unknown}
        for some in (entries, dict(reversed(entries.items()))):
            assert place_of_all(some.values(), "moved").tolist() == [1.0, 0.0]
            assert largest(some, "moved") == (other["moved"], "b")
    assert where(other, "moved") == "(1, 0)"
    assert where(still, "moved") == ""


def check_places(answer: Answer) -> None:
    """By the fields of the answer, each by numpy alone."""
    for name, fields in answer.bodies.items():
        body, middles = (
            answer.summary["bodies"][name],
            fields.points[fields.triangles[:, :3]].mean(1),
        )
        moved = np.linalg.norm(fields.displacement, axis=1)
        for values, places, key in (
            (moved, fields.points, "displacement_max"),
            (fields.von_mises, middles, "von_mises_max"),
        ):
            k = int(np.linalg.norm(places - body[f"{key}_at"], axis=1).argmin())
            assert places[k] == pytest.approx(body[f"{key}_at"], abs=1e-12)
            assert values[k] == pytest.approx(body[key], rel=1e-6)
            assert values.max() == body[key]


def test_places_are_those_of_the_fields():
    """Of bodies, of the contact as its table has it, and of the whole scene."""
    answer = scenes.certified(scenes.pinched_blocks(4))
    check_places(answer)
    summary, table = answer.summary, answer.contacts["upper-lower"].table()
    contact = summary["contacts"]["upper-lower"]
    row = table[np.argmax(table["normal_stress"])]
    assert contact["pressure_max_at"] == pytest.approx([row["x"], row["y"]])
    assert summary["displacement_max_at"] in [
        body["displacement_max_at"] for body in summary["bodies"].values()
    ]


@pytest.mark.mpi(ranks=2)
def test_places_are_the_same_on_any_number_of_ranks(comm):
    """And with the bodies in the other order. Each rank has the history."""
    scene = scenes.pinched_blocks(4)
    answer = ddmpi.solve(scene, comm)
    several = answer.summary
    assert len(answer.history) == several["outer_iterations"] > 0
    assert answer.history["n_A"][-1] > 0
    alone = ddmpi.solve(scene | {"body": scene["body"][::-1]}, MPI.COMM_SELF).summary
    for table, keys in (
        ("bodies", ("displacement_max_at", "von_mises_max_at")),
        ("contacts", ("pressure_max_at",)),
    ):
        for name, entry in several[table].items():
            for key in keys:
                assert entry[key] == pytest.approx(alone[table][name][key], abs=1e-12)
    assert several["displacement_max_at"] == pytest.approx(alone["displacement_max_at"])


def test_places_at_a_load_step_are_those_of_its_fields(tmp_path):
    """The report and pictures of a step before the last one read them from the files."""
    scene = scenes.pinched_blocks(4) | {
        "history": {"press": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 1},
    }
    for body in scene["body"]:
        for load in body.get("traction", []):
            load["history"] = "press"
    path = scenes.write_scene(scene, tmp_path / "scene.toml")
    done = scenes.run_here(path, tmp_path / "out", "--no-figures")
    assert done.code == 0, done.output
    step = at_step(read_results(done.folder), done.folder, 1.0).summary
    for table, key in (
        ("bodies", "displacement_max"),
        ("bodies", "von_mises_max"),
        ("contacts", "pressure_max"),
    ):
        for name, entry in step[table].items():
            last = done.summary[table][name]
            assert entry[key] != last[key]
            assert np.shape(entry[f"{key}_at"]) == (2,) == np.shape(last[f"{key}_at"])


def test_places_of_bodies_that_move_far_are_where_they_are_now():
    """A clamped block that its frame has carried by 10 m and turned by a quarter."""
    block = scenes.rectangle("block", (0.0, 0.0), (2.0, 1.0), (4, 2), clamp=["left"])
    block |= {"motion": {"shift": [10.0, 0.0], "turn": 90.0, "pivot": [0.0, 0.0], "history": "go"}}
    block |= {"traction": [{"on": "right", "value": [0.0, 1e6], "follows": True}]}
    scene = {
        "body": [block],
        "history": {"go": {"times": [0.0, 1.0], "factors": [0.0, 1.0]}},
        "time": {"points": [1.0], "steps": 1, "motions": "far"},
    }
    body = scenes.certified(scene).summary["bodies"]["block"]
    x, y = body["displacement_max_at"]
    assert 8.9 < x < 10.1 and y == pytest.approx(2.0, abs=0.05)
    x, y = body["von_mises_max_at"]
    assert 8.9 < x < 10.1 and 0.0 < y < 0.6
