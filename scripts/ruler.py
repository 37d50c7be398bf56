#!/usr/bin/env python3
"""Tokens by room, and the functions that are too long or too complex.

    scripts/study ruler [FOLDER [REVISION]]

Lines are no measure of code: they fall where it gets denser. The ruler counts in a normal form, in which layout,
comments and docstrings do not matter: tokens (names, operators, numbers) of the code as `ast.unparse` writes it, and
the complexity of functions: 1, and 1 for each if, for, while, conditional expression, except, comprehension, and each
further operand of `and` and `or`. Lines of a function are those of its body as formatted, without its docstring.
"""

from __future__ import annotations

import argparse
import ast
import collections
import io
import subprocess
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

MOST_LINES = 60
MOST_COMPLEX = 15
"""Functions beyond these are exceptions, which `tests/test_ruler.py` lists."""

BRANCHES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension)
COUNTED = {tokenize.NAME, tokenize.OP, tokenize.NUMBER}


class Function(NamedTuple):
    """A function with its complexity and its number of lines; those inside of it count for it, too."""

    name: str
    complexity: int
    lines: int


def _docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def tokens(tree: ast.Module) -> int:
    """Number of names, operators and numbers of a module in normal form."""
    normal = io.StringIO(ast.unparse(tree))
    return sum(token.type in COUNTED for token in tokenize.generate_tokens(normal.readline))


def functions(node: ast.AST, name: str) -> Iterator[Function]:
    """All functions below a node, named as in ``coupling/joint:Joint.mult``."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.FunctionDef | ast.ClassDef):
            if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
                yield from functions(child, name)
            continue
        inner = f"{name}{'.' if ':' in name else ':'}{child.name}"
        if isinstance(child, ast.FunctionDef):
            yield Function(inner, complexity(child), lines(child))
        yield from functions(child, inner)


def complexity(function: ast.FunctionDef) -> int:
    """One, and one for each branch and each further operand of a condition."""
    inside = list(ast.walk(function))
    branches = sum(isinstance(each, BRANCHES) for each in inside)
    operands = sum(len(each.values) - 1 for each in inside if isinstance(each, ast.BoolOp))
    return 1 + branches + operands


def lines(function: ast.FunctionDef) -> int:
    """Lines of the body, without the docstring."""
    body = [each for each in function.body if not _docstring(each)]
    first = body[0].lineno if body else function.lineno
    assert function.end_lineno is not None
    return function.end_lineno - first + 1


def sources(folder: str, revision: str | None = None) -> Iterator[tuple[str, str]]:
    """Name below `folder`, without its ending, and text of each module: of the working tree, or of a revision."""
    if revision is None:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield (
                path.relative_to(ROOT / folder).with_suffix("").as_posix(),
                path.read_text(encoding="utf-8"),
            )
        return
    for name in _git("ls-tree", "-r", "--name-only", revision, folder).splitlines():
        if name.endswith(".py"):
            yield (
                name.removeprefix(f"{folder}/").removesuffix(".py"),
                _git("show", f"{revision}:{name}"),
            )


def _git(*arguments: str) -> str:
    return subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout


def measure(
    folder: str = "ddmpi", revision: str | None = None
) -> tuple[collections.Counter[str], list[Function]]:
    """Tokens by room, and all functions."""
    by_room: collections.Counter[str] = collections.Counter()
    found: list[Function] = []
    for module, text in sources(folder, revision):
        tree = ast.parse(text)
        room = module.split("/")[0] if "/" in module else "."
        by_room[room] += tokens(tree)
        found += functions(tree, module)
    return by_room, found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", default="ddmpi", help="ddmpi, tests or scripts")
    parser.add_argument("revision", nargs="?", help="of git; left out: the working tree")
    arguments = parser.parse_args()
    by_room, found = measure(arguments.folder, arguments.revision)
    complicated = sorted(
        (each for each in found if each.complexity > MOST_COMPLEX),
        key=lambda each: -each.complexity,
    )
    long = sorted((each for each in found if each.lines > MOST_LINES), key=lambda each: -each.lines)
    for room, number in by_room.most_common():
        print(f"{number:8} {room}")
    print(
        f"{sum(by_room.values()):8} tokens; {len(complicated)} functions of complexity > {MOST_COMPLEX}, "
        f"{len(long)} of more than {MOST_LINES} lines"
    )
    for each in complicated:
        print(f"complexity {each.complexity}: {each.name}")
    for each in long:
        print(f"{each.lines} lines: {each.name}")


if __name__ == "__main__":
    main()
