"""Wrong lines that are drawn by lot: one simple operator on the syntax tree of one line that computes.

Not drawn are messages, docstrings, annotations, functions that return words, and the rooms of pictures and commands.
"""

from __future__ import annotations

import ast
import copy
import random
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

LEFT_OUT = ("pictures", "cli")
"""Rooms that draw and talk."""

WORDS = {"Doubt", "print", "say", "log", "debug", "info", "warning", "format", "join", "plural"}
"""Functions whose arguments are words."""

SWAPPED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.And: ast.Or,
    ast.Or: ast.And,
}

TURNED = {
    "max": "min",
    "maximum": "minimum",
    "argmax": "argmin",
    "any": "all",
    "sin": "cos",
    "floor": "ceil",
    "zeros": "ones",
    "zeros_like": "ones_like",
}
TURNED |= {there: here for here, there in TURNED.items()}

BARE = {"abs", "sqrt", "norm", "transpose", "sorted", "sort", "abspath", "cumsum"}
"""Functions of which the argument alone is left, if it is the only one."""


FOLDERS = {"folder", "path", "parent", "place", "root"}
"""Names of what stands before a / that is none of numbers."""


@dataclass(frozen=True)
class Drawn:
    """A wrong line of `ddmpi/{file}.py`: its number in the normal form, as it is, as it becomes, and the module then."""

    file: str
    line: int
    text: str
    replacement: str
    source: str


def is_word(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def name_of(call: ast.Call) -> str:
    """The last name of what is called."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def talks(node: ast.AST) -> bool:
    """Whether a node is a message, or says what types are."""
    match node:
        case ast.Raise() | ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
            return True
        case ast.Call():
            return name_of(node) in WORDS or name_of(node).endswith("Error")
        case ast.FunctionDef(returns=ast.Name(id="str")):
            return True
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return True
    return False


def computing(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below one that compute."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "bases"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not talks(child):
                yield child
                yield from computing(child)


def joins_paths(node: ast.BinOp) -> bool:
    """Whether / is that of a folder and a name."""
    name = getattr(node.left, "attr", getattr(node.left, "id", ""))
    return isinstance(node.op, ast.Div) and name in FOLDERS


def swapped(op: ast.AST) -> list[ast.AST]:
    return [SWAPPED[type(op)]()] if type(op) in SWAPPED else []


def but(node: ast.AST, **changed: object) -> ast.AST:
    """A node with other fields."""
    new = copy.copy(node)
    for field, value in changed.items():
        setattr(new, field, value)
    return new


def negated(test: ast.expr) -> ast.expr:
    inner = isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)
    return test.operand if inner else ast.UnaryOp(ast.Not(), test)


def shifted(node: ast.Subscript) -> Iterator[ast.AST]:
    """Each whole number of an index by one."""
    parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    for k, part in enumerate(parts):
        others: list[ast.AST] = []
        if number := whole(part):
            others = [number]
        elif isinstance(part, ast.Slice):
            for field in ("lower", "upper"):
                if number := whole(getattr(part, field)):
                    others.append(but(part, **{field: number}))
        for other in others:
            if isinstance(node.slice, ast.Tuple):
                other = but(node.slice, elts=[*parts[:k], other, *parts[k + 1 :]])
            yield but(node, slice=other)


def whole(node: ast.AST | None) -> ast.AST | None:
    """The next number to a whole one; from −1 on, towards the begin."""
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return ast.Constant(node.value + 1)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and whole(node.operand):
        return but(node, operand=whole(node.operand))
    return None


def wrong(node: ast.AST) -> list[ast.AST]:
    """What a node may become."""
    match node:
        case ast.BinOp(left, op, right) if not is_word(left) and not is_word(right):
            if joins_paths(node):
                return []
            found = [but(node, op=other) for other in swapped(op)]
            if isinstance(op, ast.Mult):
                found += [left, right]
            return found
        case ast.AugAssign(op=op, value=value) if not is_word(value):
            return [but(node, op=other) for other in swapped(op)]
        case ast.Compare(ops=[op]):
            return [but(node, ops=[other]) for other in swapped(op)]
        case ast.BoolOp(op, values):
            left_out = [values[:k] + values[k + 1 :] for k in range(len(values))]
            fewer = [few[0] if len(few) == 1 else but(node, values=few) for few in left_out]
            return [but(node, op=other) for other in swapped(op)] + fewer
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            return [operand]
        case ast.If() | ast.While() | ast.IfExp():
            return [but(node, test=negated(node.test))]
        case ast.comprehension(ifs=[test]):
            return [but(node, ifs=[negated(test)])]
        case ast.Subscript():
            return list(shifted(node))
        case ast.Attribute(value=value, attr="T"):
            return [value]
        case ast.Call(func=func, args=args, keywords=keywords):
            found = []
            if (there := TURNED.get(name_of(node))) is not None:
                field = "attr" if isinstance(func, ast.Attribute) else "id"
                found.append(but(node, func=but(func, **{field: there})))
            if name_of(node) in BARE and len(args) == 1 and not keywords:
                found.append(args[0])
            return found
    return []


class Exchange(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self.new if node is self.old else self.generic_visit(node)


def changed_line(before: str, after: str) -> tuple[int, str, str] | None:
    """The number of the one line that differs, and both of it; None where none or more than one does."""
    lines, others = before.split("\n"), after.split("\n")
    differ = [k for k, pair in enumerate(zip(lines, others, strict=False)) if pair[0] != pair[1]]
    if len(lines) != len(others) or len(differ) != 1:
        return None
    (k,) = differ
    return k + 1, lines[k].strip(), others[k].strip()


def candidates(program: Path) -> dict[tuple[str, int], int]:
    """The lines of a program that compute, by file and number in the normal form, each with its number of changes."""
    found: dict[tuple[str, int], int] = defaultdict(int)
    for path in sorted(program.rglob("*.py")):
        file = path.relative_to(program).with_suffix("").as_posix()
        if file.partition("/")[0] not in LEFT_OUT:
            tree = ast.parse(ast.unparse(ast.parse(path.read_text(encoding="utf-8"))))
            for node in computing(tree):
                if changes := wrong(node):
                    found[file, line_of(node)] += len(changes)
    return dict(found)


def line_of(node: ast.AST) -> int:
    """Of a comprehension that of its condition, which has one."""
    return node.ifs[0].lineno if isinstance(node, ast.comprehension) else node.lineno


def made(program: Path, file: str, line: int, choose: random.Random) -> Drawn | None:
    """One of the changes of a line, None where layout keeps it from being one line."""
    normal = ast.unparse(ast.parse((program / f"{file}.py").read_text(encoding="utf-8")))
    tree = ast.parse(normal)
    pairs = [
        (node, new)
        for node in computing(tree)
        if wrong(node)
        for new in wrong(node)
        if line_of(node) == line
    ]
    node, new = choose.choice(pairs)
    source = ast.unparse(ast.fix_missing_locations(Exchange(node, new).visit(tree)))
    differs = changed_line(normal, source)
    return Drawn(file, *differs, source) if differs else None


def draw(program: Path, number: int, seed: int) -> list[Drawn]:
    """Wrong lines by lot, each of another line: the first of a longer draw with this seed."""
    choose = random.Random(seed)
    lines = sorted(candidates(program))
    choose.shuffle(lines)
    found: list[Drawn] = []
    for file, line in lines:
        if len(found) == number:
            break
        one = made(program, file, line, random.Random(f"{seed} {file} {line}"))
        found += [one] if one else []
    return found
