"""PETSc's options by name, as a run reports them."""

import pytest

from ddmpi.petsc import options


@pytest.fixture
def odd(petsc_options):
    """Options that petsc4py's `getAll` takes apart: a value with a dash in it, and a name with two."""
    petsc_options(**{"odd_words": "b -x 3", "odd_flag": None, "odd_number": -3.5, "--odd": 1})
    return {"odd_words": "b -x 3", "odd_flag": None, "odd_number": "-3.5", "-odd": "1"}


def test_options_keep_their_values(odd):
    from petsc4py import PETSc

    before = options.in_force()
    assert {name: value for name, value in before.items() if "odd" in name} == odd
    with options.asked_for() as names:
        assert PETSc.Options().getString("odd_words") == "b -x 3"
        PETSc.Options().hasName("--odd")
    assert names == {"odd_words", "-odd"} and options.in_force() == before
    assert set(odd) - set(options.unused_options()) == names
    options.RunOptions().use({})
    assert options.in_force() == before and set(odd) - set(options.unused_options()) == names


def test_the_source_of_an_option_is_no_part_of_its_value():
    """Later versions of PETSc print it."""
    lines = "-a", "-a b -x 3 # (source: command line)", "-flag # (source: code)", "-note # (source"
    assert [options._SOURCE.sub("", line) for line in lines] == [
        "-a",
        "-a b -x 3",
        "-flag",
        "-note # (source",
    ]
