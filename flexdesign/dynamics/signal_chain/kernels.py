"""Hooks of blocks as machine code: compiled one by one, called through their addresses.

A chain is an array of addresses, so that one put together at run time costs no compilation. Compiled code is kept on
disk by numba, keyed by the file that holds the hook; that is why a hook may call only `math` and functions of its own
file: after a change elsewhere the kept code would silently be that of yesterday.
"""

from __future__ import annotations

import dis
import math
import types
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import cfunc, njit
from numba import types as nb
from numba.extending import intrinsic
from numpy.typing import NDArray

_FLOATS = nb.CPointer(nb.float64)
_REAL = nb.float64
#: The C signature of each kind of hook.
SIGNATURES = {
    "move": nb.void(_FLOATS, _FLOATS, _FLOATS, _FLOATS),
    "flow": _REAL(_REAL, _REAL, _REAL, _FLOATS, _FLOATS, _FLOATS),
    "pull": _REAL(_REAL, _REAL, _FLOATS, _FLOATS),
    "tick": _REAL(_REAL, _FLOATS, _FLOATS),
    "control": _REAL(_REAL, _REAL, _REAL, _FLOATS, _FLOATS),
}
_PLAIN = (int, float, bool, types.BuiltinFunctionType, type)
#: Division by zero is inf, as in NumPy, and found as a divergence. A hook is one piece of code with what it calls: it
#: runs in some ten nanoseconds, of which calls were a third.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True}


@cache
def address(hook: Callable[..., Any], kind: str) -> int:
    """Return the address of a hook's machine code.

    Parameters
    ----------
    hook
        A plain function, see `flexdesign.core.model.Block`.
    kind
        ``"move"``, ``"flow"``, ``"pull"``, ``"tick"`` or ``"control"``.

    Raises
    ------
    TypeError
        If the hook is no plain function, or uses something that is neither a number, nor `math`, nor a function of
        its own file.
    """
    return int(_compile(hook, kind).address)


@cache
def _compile(hook: Callable[..., Any], kind: str) -> Any:
    function = _compilable(hook)
    try:
        return cfunc(SIGNATURES[kind], cache=True, **_OPTIONS)(function)
    except (OSError, EOFError, ValueError, AttributeError, ImportError):  # kept code that cannot be read or stored
        return cfunc(SIGNATURES[kind], **_OPTIONS)(function)


def _compilable(function: Callable[..., Any]) -> types.FunctionType:
    """Return the function with the functions it calls compiled in place."""
    if not isinstance(function, types.FunctionType) or function.__closure__:
        raise TypeError(f"{function!r} cannot be compiled: a hook is a function at the top level of its file")
    around = dict(function.__globals__)
    for name in _globals(function.__code__):
        value = around.get(name)
        if isinstance(value, types.FunctionType):
            if value.__code__.co_filename != function.__code__.co_filename:
                raise TypeError(f"{function.__name__} calls {name} of another file; copy it, or pass its result")
            if value is not function:
                around[name] = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(_compilable(value))
        elif name in around and value is not math and not isinstance(value, _PLAIN):
            raise TypeError(f"{function.__name__} uses {name}, which is neither a number nor math nor a function")
    made = types.FunctionType(function.__code__, around, function.__name__, function.__defaults__)
    made.__module__, made.__qualname__ = function.__module__, function.__qualname__
    return made


def _globals(code: types.CodeType) -> set[str]:
    return {i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL"}


# --- calls from compiled code -----------------------------------------------------------------------------------


def _caller(count_of_reals: int, count_of_pointers: int, returns: bool) -> Any:
    """Return a function of compiled code that calls an address with numbers, then pointers given as integers."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        from llvmlite import ir

        double, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
        result = double if returns else ir.VoidType()
        kind = ir.FunctionType(result, [double] * count_of_reals + [pointer] * count_of_pointers)
        target = builder.inttoptr(arguments[0], kind.as_pointer())
        pointers = [builder.inttoptr(a, pointer) for a in arguments[1 + count_of_reals :]]
        value = builder.call(target, [*arguments[1 : 1 + count_of_reals], *pointers])
        return value if returns else context.get_constant_generic(builder, nb.none, None)

    result = nb.float64 if returns else nb.none
    return result, [nb.int64, *[nb.float64] * count_of_reals, *[nb.int64] * count_of_pointers], codegen


@intrinsic
def call_move(typing: Any, hook: Any, path: Any, out: Any, state: Any, constants: Any) -> Any:
    """Call a `move` hook; all arguments are addresses."""
    result, arguments, codegen = _caller(0, 4, False)
    return result(*arguments), codegen


@intrinsic
def call_flow(
    typing: Any, hook: Any, drive: Any, position: Any, velocity: Any, state: Any, rates: Any, constants: Any
) -> Any:
    """Call a `flow` hook with drive, position and velocity, then addresses; return the force over the stiffness."""
    result, arguments, codegen = _caller(3, 3, True)
    return result(*arguments), codegen


@intrinsic
def call_pull(typing: Any, hook: Any, begin: Any, end: Any, state: Any, constants: Any) -> Any:
    """Call a `pull` hook with both ends of a stretch, then addresses; return the force over the stiffness."""
    result, arguments, codegen = _caller(2, 2, True)
    return result(*arguments), codegen


@intrinsic
def call_tick(typing: Any, hook: Any, value: Any, state: Any, constants: Any) -> Any:
    """Call a `tick` hook with a value, then addresses; return the new value."""
    result, arguments, codegen = _caller(1, 2, True)
    return result(*arguments), codegen


@intrinsic
def call_control(typing: Any, hook: Any, reference: Any, reading: Any, excess: Any, state: Any, constants: Any) -> Any:
    """Call a controller's `tick` with reference, reading and excess, then addresses; return its command."""
    result, arguments, codegen = _caller(3, 2, True)
    return result(*arguments), codegen


@intrinsic
def reals(typing: Any, address: Any) -> Any:
    """Turn an address into numbers that can be indexed."""
    return _FLOATS(nb.int64), _as_pointer


@intrinsic
def ints(typing: Any, address: Any) -> Any:
    """Turn an address into whole numbers that can be indexed."""
    return nb.CPointer(nb.int64)(nb.int64), _as_pointer


def _as_pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))


def run_ticks(hook: Callable[..., float], values: NDArray[np.float64], states: int, constants: Sequence[float]) -> Any:
    """Return a `tick` hook's values for a whole series, from rest."""
    state, numbers = np.zeros(max(states, 1)), np.array([*constants, 0.0])
    out = np.empty(len(values))
    series = np.ascontiguousarray(values, dtype=np.float64)
    _run_ticks(address(hook, "tick"), series, state.ctypes.data, numbers.ctypes.data, out)
    return out


@njit(cache=True, nogil=True)
def _run_ticks(hook: int, values: NDArray[np.float64], state: int, constants: int, out: NDArray[np.float64]) -> None:
    for i in range(len(values)):
        out[i] = call_tick(hook, values[i], state, constants)
