"""Both sides of each bound, and whether every message is asked."""

from collections import Counter
from collections.abc import Iterable, Iterator

import pytest
from bounds import BOUNDS, REFUSED, SCENES, SOLVED
from messages import unasked
from mpi4py import MPI
from scenes import assert_refused

import ddmpi
from ddmpi.errors import InputError
from ddmpi.scene.reader import read_scene


def names(words: Iterable[str]) -> Iterator[str]:
    """Of cases, which stay where others come before them; those with the same words are counted."""
    times = Counter[str]()
    for each in words:
        times[each] += 1
        yield each if times[each] == 1 else f"{each} {times[each]}"


def settings(of: str | list[str]) -> list[str]:
    return [of] if isinstance(of, str) else of


@pytest.mark.parametrize("bound", BOUNDS, ids=names(bound.words[:40] for bound in BOUNDS))
def test_a_scene_is_refused_just_past_a_bound_and_not_before(bound):
    """What is past a limit is refused in words, what is on its other side is read."""
    text = SCENES[bound.scene]
    with pytest.raises(InputError) as refused:
        read_scene("scene of a test", text, settings(bound.past))
    assert bound.words in str(refused.value)
    read_scene("scene of a test", text, settings(bound.before))


@pytest.mark.parametrize("bound", REFUSED, ids=[bound.of.__name__ for bound in REFUSED])
def test_meshes_and_clamps_are_refused_just_past_a_bound_and_not_before(bound):
    """What no mesh, clamp or contact may be is refused in words, and what is just before it is solved."""
    assert_refused(bound.of(True), bound.words)
    ddmpi.solve(bound.of(False), MPI.COMM_SELF)


@pytest.mark.parametrize("bound", SOLVED, ids=[bound.of.__name__ for bound in SOLVED])
def test_an_answer_has_a_warning_just_past_a_bound_and_not_before(bound):
    """A warning comes with what it warns of, and not without."""
    for past in (True, False):
        warnings = ddmpi.solve(bound.of(past), MPI.COMM_SELF).summary["warnings"]
        assert any(bound.words in warning for warning in warnings) is past, warnings


def test_every_message_is_asked():
    """Of each message a test has words of its own."""
    assert sorted(unasked()) == [], "write a test that has words of these messages"
