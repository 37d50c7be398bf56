"""Whether a record tells what has changed: a number of an answer, a word of the log, a line that comes or goes."""

from types import SimpleNamespace

import approved
import numpy as np
import pytest
import transcripts
from approved import Facts, both, compare, differences, folded, noted, written
from mpi4py import MPI
from scenes import rectangle

import ddmpi
from ddmpi.errors import InputError


def facts_of(change=lambda answer: None) -> Facts:
    """Of a scene with friction that slips, whose answer may be changed before it is noted."""
    push = [
        {"on": "top", "pressure": 4.1, "history": "way"},
        {"on": "left", "value": [2.9, 0.0], "history": "way"},
    ]
    block = rectangle("block", (0.75, 0.375), (0.6, 0.8), (2, 2), traction=push, clamp=["right"])
    scene = {
        "body": [block | {"material": {"young": 7.1e3, "poisson": 0.31}}],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0.0, 0.375], "normal": [0.0, 1.0]}],
        "contact": [
            {
                "bodies": ["block", "floor"],
                "on": ["bottom"],
                "friction": {"law": "coulomb", "coefficient": 0.2},
            }
        ],
        "history": {"way": {"times": [0.0, 1.0, 2.3], "factors": [0.0, 0.35, 1.0]}},
        "time": {"points": [1.0, 2.3], "steps": 1},
    }
    with noted() as notes:
        pass
    answer = ddmpi.solve(scene, MPI.COMM_SELF)
    change(answer)
    notes.answer(answer)
    return notes.whole()


@pytest.fixture(scope="module")
def right() -> Facts:
    return facts_of()


def moved(answer) -> None:
    u = answer.bodies["block"].displacement
    u[3, 0] += 1e-4 * np.abs(u).max()


def slid(answer) -> None:
    state = answer.contacts["block-floor"]
    state.slip[1] *= 1.0 + 1e-3


def counted(answer) -> None:
    answer.summary["steps"][1]["contacts"]["block-floor"]["stick"] += 1


def spent(answer) -> None:
    answer.summary["energy"]["dissipated"] *= 1.0001


def said(answer) -> None:
    answer.summary["bodies"]["block"]["solver"] = "another"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (moved, "fields.displacement"),
        (slid, "table.slip"),
        (counted, "steps.contacts.*.stick"),
        (spent, "energy.dissipated"),
        (said, "solver: another"),
    ],
)
def test_one_number_or_word_of_an_answer_is_told_by_its_name(right, change, words):
    told = differences(facts_of(change), right)
    assert told and all(words in line or line.startswith("gone: bodies") for line in told), told


def test_an_answer_that_is_solved_again_is_as_approved(right):
    assert differences(facts_of(), right) == []


def test_records_are_read_as_they_are_written(right, tmp_path, monkeypatch):
    """Also those with rounding, and of tests without numbers; a test without a record is told."""
    right.groups["rounding"] = (4, None)
    tests = {
        "products: one[a b-1]": right,
        "products: one[c]": Facts(texts={"no word": 1.0, "n = #": None}),
    }
    (tmp_path / "records.txt").write_text(written(tests), encoding="utf-8")
    monkeypatch.setattr(approved, "HERE", tmp_path)
    monkeypatch.delenv(approved.WRITTEN, raising=False)
    again = approved.approved("records")
    assert again.keys() == tests.keys()
    for name, facts in tests.items():
        assert again[name].texts.keys() == facts.texts.keys()
        assert differences(facts, again[name]) == [], name
    compare("records", "products: one[a b-1]", right)
    with pytest.raises(
        AssertionError, match="no approved record of this test; run scripts/study approve"
    ):
        compare("records", "products: another", right)
    right.groups["table.gap"] = (2, 1.2345)
    with pytest.raises(AssertionError, match=r"table.gap: 2:1.2345, approved"):
        compare("records", "products: one[a b-1]", right)


def test_messages_of_errors_and_the_log_are_noted():
    with noted() as notes, pytest.raises(InputError):
        ddmpi.solve({"body": [], "title": 3}, MPI.COMM_SELF)
    assert any(text.startswith("InputError: scene: ") for text in notes.whole().texts)


def test_weights_tell_an_exchange_and_a_sign():
    x = np.array([3.0, -1.0, 0.4, 0.0])
    sums = [folded(values) for values in (x, -x, x[::-1], 1.001 * x, np.append(x, 0.0), x[:3])]
    assert len(set(np.round(sums[:4], 4))) == 4 and sums[4] == pytest.approx(sums[0]) == sums[5]
    assert folded(1e-10 * x, 1.0) == 0.0  # rounding beside what is of its kind


def test_what_hangs_on_rounding_is_no_record():
    """Numbers that differ between two runs are left out; words that do are an error."""
    one = Facts({"a": (3, 1.5), "b": (3, 0.5)}, {"at #": 2.0})
    other = Facts({"a": (3, 1.5), "b": (3, 0.7)}, {"at #": 2.3})
    assert both("t", one, other) == Facts({"a": (3, 1.5), "b": (3, None)}, {"at #": None})
    with pytest.raises(SystemExit, match="hangs on rounding"):
        both("t", one, Facts(other.groups, {"near #": 2.3}))


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("force (1.234, 5) N", "force (1.235, 5) N", True),  # one in the last digit
        ("force (1.234, 5) N", "force (1.236, 5) N", False),
        ("force (1.234, 5) N", "force (1.234, 6) N", False),
        ("3 open nodes", "3 closed nodes", False),
        ("gap: 1.0001 2e-6", "gap: 1.0002 4e-5", True),  # beside the largest
        ("gap: 1.0001 2e-6", "gap: 1.0004 2e-6", False),
        ("gap: 1.0 2.0", "gap: 1.0 2.0 3.0", False),
        ("off by ~ of it", "off by 7 of it", True),
        ("residual 3e-14", "residual 0.0", True),
    ],
)
def test_a_transcript_tells_words_and_numbers(old, new, same):
    told = transcripts.differences([new, "end"], [old, "end"])
    assert (told == []) is same
    assert same or told == [f"- {old}", f"+ {new}"]


def test_lines_that_come_and_go_are_told():
    assert transcripts.differences(["a", "c 1"], ["a", "b", "c 1"]) == ["- b"]
    assert transcripts.merged("t", ["x 1.5 of 3"], ["x 1.7 of 3"]) == ["x ~ of 3"]
    with pytest.raises(SystemExit, match="words hang on rounding"):
        transcripts.merged("t", ["x 1"], ["y 1"])


def test_tests_of_several_ranks_and_slow_ones_have_no_records(monkeypatch):
    monkeypatch.setenv(approved.WRITTEN, "notes")  # also where there are none yet

    def item(folder: str, *marks: str) -> SimpleNamespace:
        path = SimpleNamespace(parent=SimpleNamespace(name=folder))
        return SimpleNamespace(path=path, get_closest_marker=lambda name: name in marks)

    assert approved.has_record(item("products"))
    for other in (item("run"), item("products", "slow"), item("products", "mpi")):
        assert not approved.has_record(other)


def test_every_folder_has_its_records():
    """Without the file nothing is compared."""
    missing = [folder for folder in approved.RECORDED if not approved.file_of(folder).is_file()]
    assert not missing, f"run {approved.RENEW}"
