"""What is kept of a case is taken where, and only where, all that it depends on has the same content."""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.kept.kept import Kept, digest


@dataclass(frozen=True)
class Part:
    xy: np.ndarray
    moved: dict
    name: str = "a"


PART = Part(np.arange(4.0), {None: np.zeros(2), "push": np.ones(2)})


def test_a_digest_is_of_the_content():
    """Copies have the same digest; another bit, type, shape, name, order or nesting has another one."""
    matrix = sparse.csr_matrix([[1.0, 0.0], [2.0, 3.0]])
    things = [PART, matrix, [1, "x"], {"a": 1.0}]
    copy = [replace(PART, xy=PART.xy.copy()), matrix.copy(), [1, "x"], {"a": 1.0}]
    assert digest(*things) == digest(*copy)
    others = [
        PART,
        replace(PART, xy=np.nextafter(PART.xy, 9.0)),
        replace(PART, name="b"),
        replace(PART, moved={None: np.zeros(2), "push": np.zeros(2)}),
        replace(PART, xy=PART.xy.reshape(2, 2)),
        replace(PART, xy=np.arange(4)),
        replace(PART, moved={"push": np.zeros(2), None: np.ones(2)}),
        matrix,
        2 * matrix,
        matrix.T.tocsr(),
        [1, "x"],
        ["x", 1],
        [[1], "x"],
        [[1, "x"]],
        1,
        1.0,
        "1",
        True,
        None,
        [],
        np.array([[1.0, 2.0], [3.0, 4.0]]),
        np.array([[1.0, 3.0], [2.0, 4.0]]),
        {"a": 1},
        {"b": 1},
        0.1 + 0.2,
        0.3,
    ]
    assert len({digest(thing) for thing in others}) == len(others)


def test_values_are_taken_by_key():
    """A value is made once for a key, anew for another one, and the last one alone stays."""
    kept, made = Kept(), []

    def get(key, owner="upper", lasts=True):
        return kept.get(
            "mesh", owner, key, lambda: made.append(key) or f"{owner} {key}", lambda value: lasts
        )

    for conditions, key, number in (
        (1, "a", 1),
        (1, "a", 1),
        (1, "b", 2),
        (1, "a", 3),
        (2, "a", 4),
        (2, "a", 4),
    ):
        kept.begin(conditions)
        assert get(key) == f"upper {key}"
        assert len(made) == number
    assert kept.found == {"upper": ["mesh"]}
    assert get("b", "lower") == "lower b"
    kept.begin(2)
    assert kept.found == {}
    get("c", lasts=False)
    kept.begin(2)
    get("c")
    assert len(made) == 7


def test_what_is_alike_is_made_once_in_a_case():
    """Owners with the same key share the value of the first one, but neither one that does not last nor one of a case
    before that nobody has taken."""
    kept, made = Kept(), []

    def get(owner, key, lasts=True):
        return kept.get(
            "mesh", owner, key, lambda: made.append(owner) or [owner], lambda value: lasts
        )

    kept.begin(None)
    first = get("first", 1)
    assert get("second", 1) is first
    assert kept.key("mesh", "second") == kept.key("mesh", "first")
    assert kept.found == {}
    assert get("third", 2) == ["third"]
    assert [get("fourth", 3, lasts=False), get("fifth", 3)] == [["fourth"], ["fifth"]]
    kept.end()
    kept.begin(None)
    assert get("sixth", 1) == ["sixth"]
    kept.begin(None)
    assert get("second", 1) is first
    assert get("seventh", 1) is first
    assert kept.found == {"second": ["mesh"]}
    assert made == ["first", "third", "fourth", "fifth", "sixth"]


def test_what_depends_on_something_not_kept_is_not_taken():
    """The key of a stage that this case has not got is unlike all others."""
    kept = Kept()
    kept.begin(None)
    kept.get("mesh", "upper", 1, object)
    key = kept.key("mesh", "upper")
    assert kept.key("mesh", "upper") == key
    kept.begin(None)
    assert (
        len({key, kept.key("mesh", "upper"), kept.key("mesh", "upper"), kept.key("mesh", "lower")})
        == 4
    )


def test_what_is_not_met_again_goes_first():
    """Before factors are made those that the case will not take go, and in the end what it has not met."""

    class Factors:
        alive = 0

        def __init__(self):
            Factors.alive += 1

        def __del__(self):
            Factors.alive -= 1

    kept = Kept()
    kept.begin(None)
    for name in "upper", "lower", "gone":
        kept.get("factors", name, [name], Factors)  # unlike each other, or they would be one
        kept.get("mesh", name, 1, object)
    assert Factors.alive == 3
    kept.begin(None)
    kept.expect("factors", {"upper": ["upper"], "lower": 2})
    assert Factors.alive == 1
    for name, key in ("upper", ["upper"]), ("lower", 2):
        kept.get("factors", name, key, Factors)
        kept.get("mesh", name, 1, object)
    kept.end()
    kept.begin(None)
    kept.get("mesh", "gone", 1, object)
    assert kept.found == {}


def test_memory_is_that_of_the_first_case():
    kept = Kept()
    assert [kept.memory(lambda: 4.0), kept.memory(lambda: 2.0)] == [4.0, 4.0]
