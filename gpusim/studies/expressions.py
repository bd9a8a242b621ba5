"""Short arithmetic expressions of parameters, over all points at once.

They are read as Python's syntax, of which numbers, names, arithmetic, comparisons and a few
functions are understood, and nothing else; nothing is ever called but what stands here.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, nearest_name

Values = npt.NDArray[Any]
FUNCTIONS: Mapping[str, Callable[..., Any] | float] = {
    "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tan": np.tan,
    "abs": np.abs, "round": np.round, "pi": np.pi,
    "min": lambda *values: reduce(np.minimum, values),
    "max": lambda *values: reduce(np.maximum, values),
}  # fmt: skip
"""What expressions may call, and pi."""
_OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
    ast.Pow: np.power, ast.USub: np.negative, ast.UAdd: np.positive,
    ast.Lt: np.less, ast.LtE: np.less_equal, ast.Gt: np.greater, ast.GtE: np.greater_equal,
    ast.Eq: np.equal, ast.NotEq: lambda a, b: (a < b) | (a > b),
    ast.And: np.logical_and, ast.Or: np.logical_or,
}  # fmt: skip
_OF_SEVERAL = "min", "max"
_EXPECTED = "numbers, names, + - * / ** ( ), comparisons, " + " ".join(FUNCTIONS)


def evaluated(text: str, columns: Mapping[str, Values], where: str) -> Values:
    """An expression's values, one for each row of the ``columns`` (or one for all).

    Numbers are float64; what has no value (a division by zero) is NaN or infinite. Raises
    InputError, which names ``where``, for anything that isn't such an expression, a name that no
    column has, and a column that holds no numbers.

    Examples
    --------
    >>> from gpusim.studies.expressions import evaluated
    >>> evaluated("2 * f + sqrt(4)", {"f": np.array([1.0, 2.0])}, "value")
    array([4., 6.])
    """
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        with np.errstate(all="ignore"):
            return np.asarray(_value(tree, columns, where))
    except (
        SyntaxError,
        ValueError,
        RecursionError,
        MemoryError,
        TypeError,
        OverflowError,
    ) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{where}: no expression; got {text!r}; expected {_EXPECTED}") from None


def _value(node: ast.AST, columns: Mapping[str, Values], where: str) -> Any:
    """Of a part of the syntax tree."""

    def inner(*nodes: ast.AST) -> list[Any]:
        return [_value(one, columns, where) for one in nodes]

    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name() | ast.Attribute():
            return _column(ast.unparse(node), columns, where)
        case ast.BinOp() if type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](*inner(node.left, node.right))
        case ast.UnaryOp(op=ast.Not()):  # nor does NaN pass what it fails
            inside = [one for one in ast.walk(node) if isinstance(one, ast.Compare)]
            sides = inner(*(side for one in inside for side in (one.left, *one.comparators)))
            known = [~np.isnan(one) for one in sides]
            return reduce(np.logical_and, known, np.logical_not(*inner(node.operand)))
        case ast.UnaryOp() if type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](*inner(node.operand))
        case ast.BoolOp():
            return reduce(_OPERATORS[type(node.op)], inner(*node.values))
        case ast.Compare() if all(type(one) in _OPERATORS for one in node.ops):
            sides = inner(node.left, *node.comparators)
            pairs = zip(node.ops, sides[:-1], sides[1:], strict=True)
            return reduce(np.logical_and, [_OPERATORS[type(op)](a, b) for op, a, b in pairs])
        case ast.Call(func=ast.Name(id=name), keywords=[], args=given) if callable(
            function := FUNCTIONS.get(name)
        ) and (len(given) == 1 or name in _OF_SEVERAL):
            return function(*inner(*given))
    raise InputError(f"{where}: not understood; got {ast.unparse(node)}; expected {_EXPECTED}")


def _column(name: str, columns: Mapping[str, Values], where: str) -> Values | float:
    if name in columns:
        if columns[name].dtype.kind not in "fiu":
            raise InputError(f"{where}: {name} is no number; expected a parameter of numbers")
        return columns[name].astype(np.float64)
    known = FUNCTIONS.get(name)
    if isinstance(known, float):
        return known
    names = [*columns, *FUNCTIONS]
    near = nearest_name(name, names)
    raise InputError(f"{where}: unknown name; got {name}; expected one of {', '.join(names)}{near}")
