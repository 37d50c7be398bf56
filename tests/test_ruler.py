"""Functions are short and simple; those that are not yet stand in a list that only shrinks."""

import ast

import pytest
import ruler
from trees import trees

COMPLEX: dict[str, int] = {}
"""Functions of the program beyond `ruler.MOST_COMPLEX`, with their complexity. Numbers only fall."""

LONG: dict[str, int] = {}
"""Functions of the program beyond `ruler.MOST_LINES`, with the lines of their bodies. Numbers only fall."""


def beyond(measured: dict[str, int], listed: dict[str, int], most: int) -> dict[str, int]:
    """What is beyond the limit and beyond its number in the list."""
    return {
        name: number for name, number in measured.items() if number > max(most, listed.get(name, 0))
    }


@pytest.fixture(scope="module")
def functions() -> list[ruler.Function]:
    return [each for module, tree in trees().items() for each in ruler.functions(tree, module)]


def overstated(measured: dict[str, int], listed: dict[str, int]) -> dict[str, int]:
    """What the list puts higher than it is: the number is to be lowered, or the entry goes."""
    return {name: number for name, number in listed.items() if number > measured.get(name, 0)}


def test_functions_are_simple(functions):
    """No function is more complex than the ruler allows, or than it was when it was listed."""
    measured = {each.name: each.complexity for each in functions}
    assert beyond(measured, COMPLEX, ruler.MOST_COMPLEX) == {}
    assert overstated(measured, COMPLEX) == {}


def test_functions_are_short(functions):
    """No function is longer than the ruler allows, or than it was when it was listed."""
    measured = {each.name: each.lines for each in functions}
    assert beyond(measured, LONG, ruler.MOST_LINES) == {}
    assert overstated(measured, LONG) == {}


def test_the_ruler_counts_branches_and_operands():
    """Complexity counts branches, conditional expressions, comprehensions, excepts and operands, nested ones too."""
    source = '''
def simple(x):
    """Not counted."""
    return x + 1
class Box:
    def lid(self, a, b, c):
        if a and b or c:
            return [each for each in a]
        try:
            return 1 if a else 2
        except ValueError:
            for _ in a:
                while b:
                    pass
        def inner():
            return a or b
'''
    found = {each.name: each for each in ruler.functions(ast.parse(source), "room/module")}
    assert found["room/module:simple"] == ("room/module:simple", 1, 1)
    assert found["room/module:Box.lid"].complexity == 1 + 6 + 3
    assert found["room/module:Box.lid"].lines == 10
    assert found["room/module:Box.lid.inner"].complexity == 2


def test_layout_changes_no_tokens():
    """Layout, comments, brackets that are not needed and the kind of quotes change no number of tokens."""
    dense = ast.parse("x = f(a, b); y = 'text'")
    loose = ast.parse('x = (  # a comment\n    f(\n        a,\n        b,\n    )\n)\ny = "text"\n')
    assert ruler.tokens(dense) == ruler.tokens(loose) == 3 + 5 + 2
