"""All messages of the program, by its syntax trees, and which of them no test asks.

A message is a text of five words or more in a function, but for docstrings, patterns, the log and the rooms that draw
and talk. It is asked if the tests have fourteen characters of it that stand in no other message: enough to know it by.
Of those that have none the tests cannot tell.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from trees import trees

ROOT = Path(__file__).resolve().parents[2]

LEFT_OUT = ("cli", "pictures")

WORDS, KNOWN_BY = 5, 14

NO_TESTS = ("mutants.py", "pages.py", "messages.py")
"""Files below tests/ that have texts of the program without asking for them."""


def pieces(node: ast.AST) -> list[str]:
    """The parts of a text that stand in the source."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return [
        part.value
        for part in parts
        if isinstance(part, ast.Constant) and isinstance(part.value, str)
    ]


def texts(node: ast.AST, inside: bool = False) -> Iterator[list[str]]:
    """All texts in functions below a node, without docstrings and the log."""
    for child in ast.iter_child_nodes(node):
        match child:
            case ast.Expr(value=ast.Constant()):
                continue
            case ast.Call(func=ast.Attribute(value=ast.Name(id="log"))):
                continue
            case ast.Constant() if inside and pieces(child):
                yield pieces(child)
            case ast.JoinedStr() if inside:
                yield pieces(child)
                for part in child.values:
                    if isinstance(part, ast.FormattedValue):
                        yield from texts(part, inside)
            case _:
                yield from texts(child, inside or isinstance(child, ast.FunctionDef))


def messages() -> dict[str, list[str]]:
    """The parts of each message, by its file and its longest part."""
    found = {}
    for file, tree in trees().items():
        if file.partition("/")[0] not in LEFT_OUT:
            for parts in texts(tree):
                pattern = any("(?:" in part for part in parts)
                if sum(len(part.split()) for part in parts) >= WORDS and not pattern:
                    found[f"{file}: {' '.join(max(parts, key=len).split())}"] = parts
    return found


def unasked() -> set[str]:
    """The messages of which no test has words of their own."""
    found = messages()
    of = defaultdict(set)
    for name, parts in found.items():
        for part in parts:
            for k in range(len(part) - KNOWN_BY + 1):
                of[part[k : k + KNOWN_BY]].add(name)
    own = {gram: name for gram, (name, *others) in of.items() if not others}
    left = set(own.values())
    files = [path for path in (ROOT / "tests").rglob("*.py") if path.name not in NO_TESTS]
    # patterns have signs before brackets, and texts go on in the next line
    tests = [re.sub(r'"\s*\n\s*f?"|\\', "", path.read_text(encoding="utf-8")) for path in files]
    for test in tests:  # nearly all stand in simple quotes
        for text in re.findall(r'"[^"\n]*"', test):
            parts = (text[k : k + KNOWN_BY] for k in range(len(text) - KNOWN_BY + 1))
            left -= {own[part] for part in parts if part in own}
    whole = "\n".join(tests)
    return {
        name
        for name in left
        if not any(part in whole for part, of_name in own.items() if of_name == name)
    }
