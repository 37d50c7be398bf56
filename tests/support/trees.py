"""The syntax trees of the program, parsed once for all tests that read them."""

import ast
import functools
import gc
from collections.abc import Iterator
from pathlib import Path

PROGRAM = Path(__file__).resolve().parents[2] / "ddmpi"


@functools.cache
def texts() -> dict[str, str]:
    """The text of each module, by its name below ddmpi/ without its ending."""
    return {
        path.relative_to(PROGRAM).with_suffix("").as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(PROGRAM.rglob("*.py"))
    }


@functools.cache
def trees() -> dict[str, ast.Module]:
    """The syntax tree of each module, which stays as it is. Nobody looks for garbage in them, neither meanwhile nor later."""
    gc.disable()
    try:
        return {module: ast.parse(text) for module, text in texts().items()}
    finally:
        gc.freeze()
        gc.enable()


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """All statements below a node, without their expressions."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield child
            yield from statements(child)
