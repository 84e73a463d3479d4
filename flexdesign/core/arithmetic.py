"""Arithmetic between named quantities, as files write it: ``qg + pulse / (kv * kp)``, units checked.

A formula has numbers, names, ``+ - * / **``, parentheses, ``pi``, and the functions of `FUNCTIONS`. The file states
what a name means: in the map of an import a variable of the recording (``rig.u`` where it is a field of a structure) or
a constant, in a sketch a dimension. Nothing else is understood, and nothing of Python is run.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexdesign.core import units

#: A formula is a line; longer ones are no formulas.
LONGEST = 500
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: dict[type[ast.unaryop], Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos}


def _part(of: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that keeps the unit of its argument."""
    return lambda value: type(value)(of(value.magnitude), value.units)


def _angle(value: Any) -> Any:
    return units.quantity(np.angle(value.magnitude), "rad")


#: What a formula may call, each with one argument; sines and cosines take angles.
FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "abs": abs,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "sin": np.sin,
    "cos": np.cos,
    "real": _part(np.real),
    "imag": _part(np.imag),
    "conj": _part(np.conj),
    "angle": _angle,
}


@dataclass(frozen=True)
class Formula:
    """A formula that has been understood.

    Parameters
    ----------
    text
        As it is written.
    names
        What it asks for, in order.
    tree
        The expression.
    """

    text: str
    names: tuple[str, ...]
    tree: ast.expr

    def evaluate(self, known: Mapping[str, Any]) -> Any:
        """Return the value, a quantity of pint, from those of its names.

        Raises
        ------
        ValueError
            If units do not go together, or sizes do not; the message says which.
        """
        with np.errstate(all="ignore"):  # what comes out infinite is refused where the column is written
            return _value(self.tree, known)

    def number(self, known: Mapping[str, float]) -> float:
        """Return the value from plain numbers in SI, a hundred times sooner; `evaluate` has checked the units before.

        Raises
        ------
        ValueError
            If there is no finite real number.
        """
        try:
            value = _number(self.tree, known)
        except (ArithmeticError, ValueError):
            value = math.nan
        if isinstance(value, complex) or not math.isfinite(value):
            raise ValueError(f"gives no finite number in {self.text}")
        return value


def parse(text: str) -> Formula:
    """Read a formula.

    Raises
    ------
    ValueError
        If it is none, or has anything in it that a formula has not; the message says what.

    >>> parse("qg + pulse / (kv * kp)").names
    ('qg', 'pulse', 'kv', 'kp')
    """
    if len(text) > LONGEST:
        raise ValueError(f"is longer than {LONGEST} characters; name parts of it in [variables]")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"is no formula; write for example a + 2 * b, with {_known()}") from None
    return Formula(text, tuple(dict.fromkeys(_names(tree))), tree)


def _known() -> str:
    return f"+ - * / **, parentheses, pi, and {', '.join(FUNCTIONS)}"


def _names(node: ast.expr) -> Iterator[str]:
    """Yield the names in an expression, and refuse what a formula has not."""
    match node:
        case ast.Constant(value=bool() as value):
            raise ValueError(f"has {value} in it; a formula has numbers, names, {_known()}")
        case ast.Constant(value=int() | float() | complex()):
            return
        case ast.Name(id="pi"):
            return
        case ast.Name() | ast.Attribute():
            yield _dotted_name(node)
        case ast.UnaryOp(op=sign) if type(sign) in _SIGNS:
            yield from _names(node.operand)
        case ast.BinOp(op=sign) if type(sign) in _OPERATORS:
            yield from _names(node.left)
            yield from _names(node.right)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            yield from _names(argument)
        case _:
            raise ValueError(f"has {ast.unparse(node)[:40]!r} in it; a formula has numbers, names, {_known()}")


def _dotted_name(node: ast.expr) -> str:
    """Return a name, or the name of a field of a structure: ``rig.u``."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return f"{_dotted_name(node.value)}.{node.attr}"
    raise ValueError(f"has {ast.unparse(node)[:40]!r} in it; a formula has numbers, names, {_known()}")


def _value(node: ast.expr, known: Mapping[str, Any]) -> Any:
    match node:
        case ast.Constant(value=int() | float() | complex() as number):
            return units.quantity(number if isinstance(number, complex) else float(number), "1")
        case ast.Name(id="pi"):
            return units.quantity(np.pi, "1")
        case ast.Name() | ast.Attribute():
            return known[_dotted_name(node)]
        case ast.UnaryOp():
            return _SIGNS[type(node.op)](_value(node.operand, known))
        case ast.BinOp():
            left, right = _value(node.left, known), _value(node.right, known)
            return _evaluate(node, lambda: _OPERATORS[type(node.op)](left, right), left, right)
        case ast.Call(func=ast.Name(id=name)):
            argument = _value(node.args[0], known)
            return _evaluate(node, lambda: FUNCTIONS[name](argument), argument)
    raise AssertionError("a formula was parsed and not understood")  # `_names` refuses it


def _number(node: ast.expr, known: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="pi"):
            return math.pi
        case ast.Name() | ast.Attribute():
            return known[_dotted_name(node)]
        case ast.UnaryOp():
            return float(_SIGNS[type(node.op)](_number(node.operand, known)))
        case ast.BinOp():
            return _OPERATORS[type(node.op)](_number(node.left, known), _number(node.right, known))
        case ast.Call(func=ast.Name(id=name)) if hasattr(math, name) or name == "abs":
            argument = _number(node.args[0], known)
            return abs(argument) if name == "abs" else float(getattr(math, name)(argument))
    raise ValueError("is no formula of real numbers")


def _evaluate(node: ast.expr, apply: Callable[[], Any], *operands: Any) -> Any:
    """Return what an operator or a function gives, or say why it cannot."""
    import pint

    message = ast.unparse(node)[:60]
    in_units = " and ".join(f"[{value.units:~C}]" if f"{value.units:~C}" else "a pure number" for value in operands)
    try:
        return apply()
    except pint.DimensionalityError:
        raise ValueError(f"cannot take {message} of {in_units}; units must go together") from None
    except ValueError as error:
        sizes = " and ".join(" x ".join(map(str, np.shape(value.magnitude))) or "1" for value in operands)
        raise ValueError(f"cannot take {message} of {sizes} numbers: {error}") from None
    except (OverflowError, ZeroDivisionError):
        raise ValueError(f"gives no finite number in {message}") from None
