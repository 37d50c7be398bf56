"""Warnings of one kind are one line: how many, the worst, where."""

import pickle

import pytest
import scenes

from ddmpi.run.gather import StepLog
from ddmpi.system.doubts import Doubt, condensed, kind_of


def moves(name: str, far: float) -> Doubt:
    return Doubt(f"body.{name}: moves by {far:g} m", "motion", far)


def test_warnings_of_a_kind_are_one_line_that_tells_the_worst():
    """With their number and what they are about, in the order of the first of each kind; other kinds stay."""
    found = condensed([moves("a", 1.0), Doubt("contact.c: few nodes", "few"), moves("b", 3.0)])
    assert found == [
        "body.b: moves by 3 m; the worst of 2 such warnings: body.a, body.b",
        "contact.c: few nodes",
    ]


def test_many_are_named_by_the_first_two_and_the_last():
    """A line stays short, however many bodies there are."""
    (line,) = condensed([moves(f"b{k}", 1.0 + k) for k in range(300)])
    assert line == (
        "body.b299: moves by 300 m; the worst of 300 such warnings: body.b0, body.b1, … body.b299 (300 in all)"
    )


def test_of_equally_bad_ones_the_first_is_told():
    """Rounding does not choose."""
    for more in (-1e-12, 0.0, 1e-12):
        (line,) = condensed([moves("a", 1.0), moves("b", 1.0 + more)])
        assert line.startswith("body.a: moves by 1 m; ")


def test_lines_are_condensed_again_with_more():
    """Warnings of the scene, of the answer and of load steps come at different times, and equal ones count once."""
    once = condensed([moves("a", 1.0), moves("b", 2.0)])
    (line,) = condensed([*once, *once, moves("c", 0.5), moves("c", 0.5)])
    assert line == "body.b: moves by 2 m; the worst of 3 such warnings: body.a, body.b, body.c"


def test_warnings_without_a_kind_are_alike_but_for_numbers_and_subject():
    """Numbers in names of others count, as `b2` here."""
    assert kind_of("body.a1: 3 of 4 cells, as at (1e-3, -2.5)") == kind_of(
        "body.b: 7 of 90 cells, as at (0, 1)"
    )
    assert kind_of("body.a: beside b2") != kind_of("body.a: beside b3")
    (line,) = condensed(["rigid.a: nothing touches it", "rigid.b: nothing touches it"])
    assert line == "rigid.a: nothing touches it; the worst of 2 such warnings: rigid.a, rigid.b"


def test_other_ranks_and_checkpoints_keep_what_a_warning_is_made_of():
    """It is condensed after it was sent, or read back, as before."""
    doubts = condensed([moves("a", 1.0), moves("b", 2.0)])
    (sent,) = pickle.loads(pickle.dumps(doubts))
    log, back = StepLog(), StepLog()
    log.doubt(0.5, [sent])
    back.restore(log.state())
    assert back.doubts_beside([]) == log.doubts_beside([]) != []
    (line,) = condensed([*back.doubts_beside([]), moves("c", 5.0)])
    assert line == "body.c: moves by 5 m; the worst of 3 such warnings: body.a, body.b, body.c"
    (line,) = condensed([*back.doubts_beside([]), moves("c", 0.5)])
    assert line.startswith("body.b: moves by 2 m (at time 0.5); the worst of 3")


def stack(number: int) -> dict:
    """Blocks of 1 m on each other, so soft that each moves by more than a tenth of its size."""
    blocks = [
        scenes.rectangle(
            f"b{k}", (0.0, float(k)), (1.0, 1.0), (2, 2), young=1e6, clamp=["bottom"] * (k == 0)
        )
        for k in range(number)
    ]
    blocks[-1]["traction"] = [{"on": "top", "pressure": 3e5}]
    return {
        "body": blocks,
        "contact": [
            {"bodies": [f"b{k + 1}", f"b{k}"], "on": ["bottom", "top"], "friction": scenes.COULOMB}
            for k in range(number - 1)
        ],
    }


@pytest.mark.slow
def test_a_stack_has_one_line_for_each_kind(tmp_path):
    """In the summary, on stderr and in the report; the top of a stack moves farthest."""
    path = scenes.write_scene(stack(6), tmp_path / "scene.toml")
    run = scenes.run_here(path, tmp_path / "out", "--no-figures")
    moved = [words for words in run.summary["warnings"] if "largest displacement" in words]
    assert len(moved) == 1 and moved[0].startswith("body.b5: its largest displacement of ")
    assert moved[0].endswith("the worst of 6 such warnings: body.b0, body.b1, … body.b5 (6 in all)")
    assert run.stderr.count("its largest displacement") == 1
    report = tmp_path / "report.html"
    assert scenes.call("report", str(run.folder), "--output", str(report)).code == 0
    assert report.read_text("utf-8").count("its largest displacement") == 1
