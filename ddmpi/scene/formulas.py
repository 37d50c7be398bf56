"""Formulas in the coordinates, such as ``-6e7 * (1 + x/3)``: an interpreter of numbers, operators and functions."""

import ast
import functools
import operator
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ddmpi.scene.values import AffineScalar, AffineVector

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "log10": np.log10,
    "sqrt": np.sqrt,
    "hypot": np.hypot,
    "abs": np.absolute,
    "min": np.minimum,
    "max": np.maximum,
    "where": np.where,
}
"""The functions that a formula may call; angles are in radians."""

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: lambda a, b: 1.0 * (a < b),
    ast.LtE: lambda a, b: 1.0 * (a <= b),
    ast.Gt: lambda a, b: 1.0 * (a > b),
    ast.GtE: lambda a, b: 1.0 * (a >= b),
}


FORMULAS = (
    "x",
    "y",
    "z",
    "normal",
    "along",
    "value",
    "pressure",
    "volume_force",
    "gap",
    "temperature",
    "coefficient",
    "slip_bound",
)
"""Keys whose values may be formulas."""

DEEPEST = 200
"""Deepest nesting of brackets, signs and terms of a formula, a little below Python's own limit."""


@functools.lru_cache
def _parse(formula: str) -> ast.expr:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python's advice on its own style
        return ast.parse(formula.strip(), mode="eval").body


def _value(node: ast.AST, places: Mapping[str, Any], depth: int = 0) -> Any:
    """The value of a part of a formula. Raises ValueError unless it consists of numbers, `places` and functions."""
    known = f"known are {', '.join([*places, *FUNCTIONS])}"
    function: Callable[..., Any] | None
    if depth == DEEPEST:
        raise ValueError("it is nested too deeply")
    match node:
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{value!r} is not a number")
            return np.float64(value)
        case ast.Name(id=name):
            if name not in places:
                raise ValueError(f"{name!r} is not known; {known}")
            return places[name]
        case ast.Call(func=ast.Name(id=name), args=inside, keywords=named):
            if name not in FUNCTIONS:
                raise ValueError(f"the function {name!r} is not known; {known}")
            function = FUNCTIONS[name]
            count = getattr(function, "nin", 3)  # more are places for numpy's results
            starred = any(isinstance(argument, ast.Starred) for argument in inside)
            if named or starred or len(inside) != count:
                raise ValueError(
                    f"{name} takes {count} value{'s' * (count > 1)}, as in "
                    f"{name}({', '.join('xyz'[:count])})"
                )
        case ast.UnaryOp(op=sign, operand=one):
            function = _OPERATORS.get(type(sign))
            inside = [one]
        case (
            ast.BinOp(left=one, op=sign, right=other)
            | ast.Compare(left=one, ops=[sign], comparators=[other])
        ):
            function = _OPERATORS.get(type(sign))
            inside = [one, other]
        case ast.Compare():
            raise ValueError("a chain of comparisons; write (0 < x) * (x < 1)")
        case _:
            raise ValueError(
                f"it must be made of numbers, + - * / **, comparisons, brackets and functions; {known}"
            )
    if function is None:
        raise ValueError(
            "a power is written **, not ^"
            if isinstance(sign, ast.BitXor)
            else f"formulas do not have this operator ({type(sign).__name__}), only + - * / ** < <= > >="
        )
    return function(*[_value(argument, places, depth + 1) for argument in inside])


def _compute(formula: str, *x: np.ndarray) -> np.ndarray:
    """The values of a formula at points, in their shape. Raises ValueError, with the formula, if it is invalid."""
    try:
        with np.errstate(all="ignore"):
            values = _value(
                _parse(formula), dict(zip("xyz", x, strict=False)) | {"pi": np.float64(np.pi)}
            )
        return np.array(np.broadcast_to(np.asarray(values, float), np.shape(x[0])))
    except SyntaxError as error:
        reason = f"it is not a formula: {error.msg}"
    except (ValueError, TypeError, ArithmeticError, MemoryError, RecursionError) as error:
        reason = str(error) or type(error).__name__
    raise ValueError(f'the formula "{formula}" cannot be evaluated: {reason}')


def varies(value: Any, coordinates: str = "xyz") -> bool:
    """Whether a value is, or contains, a formula with one of the coordinates."""
    if isinstance(value, tuple):
        return any(varies(part, coordinates) for part in value)
    return isinstance(value, str) and any(
        isinstance(node, ast.Name) and node.id in tuple(coordinates)
        for node in ast.walk(_parse(value))
    )


def formulas_of(table: Any) -> Iterator[tuple[str, Any]]:
    """The keys of a table whose values may be formulas, with these; `along` of a profile is a coordinate."""
    for name in FORMULAS:
        value = getattr(table, name, None)
        if name != "along" or isinstance(value, tuple):
            yield name, value


def check_formulas(key: str, value: Any) -> None:
    """Raise ValueError, naming `key`, if `value` is, or contains, a formula that cannot be evaluated."""
    for formula in (
        part for part in (value if isinstance(value, tuple) else (value,)) if isinstance(part, str)
    ):
        try:
            values = _compute(
                formula, np.array([0.25, 0.75]), np.array([0.5, 0.125]), np.array([0.375, 0.625])
            )
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from None
        if not varies(formula) and not np.isfinite(values).all():
            raise ValueError(
                f'{key}: the formula "{formula}" is {values[0]}, which is not a finite number'
            )


def evaluate(value: Any, *x: np.ndarray) -> np.ndarray:
    """A number, a formula, a tuple of these, or an affine value, at points with d coordinates (m) of the same shape.

    An array of that shape for a scalar, ``(d, *shape)`` for a vector; units of `value`. Formulas may give inf and nan.
    """
    if isinstance(value, str):
        return _compute(value, *x)
    if isinstance(value, tuple):
        return np.stack([evaluate(part, *x) for part in value])
    if not isinstance(value, AffineVector | AffineScalar):
        return np.full(np.shape(x[0]), value, float)
    none = 0.0 if isinstance(value, AffineScalar) else np.zeros(len(x))
    parts = zip(
        (value.constant, value.x_slope, value.y_slope, value.z_slope),
        (np.ones_like(x[0]), *x),
        strict=False,
    )
    return np.sum(
        [np.multiply.outer(none if factor is None else factor, of) for factor, of in parts], axis=0
    )
