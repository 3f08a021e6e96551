"""Checks of what users give: each returns the value in the form the package works with, or raises InputError."""

import difflib
import numbers
import reprlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.errors import InputError

Floats = NDArray[np.float64]
Axis = str | ArrayLike
"""A direction: "x", "y", "z" or a vector of any length but zero."""

SMALLEST = float(np.finfo(np.float64).tiny)  # below it doubles are subnormal and lose digits
LARGEST_WHOLE = 2**53  # up to it every whole number is a double
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def finite_number(name: str, value: object, unit: str = "1") -> float:
    """Return `value` as a float; unit: of the value, "1" for none. Raises InputError unless it is a finite number."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and not isinstance(value, np.ma.MaskedArray):
        value = value[()]
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(f"{name} is {reprlib.repr(value)}; it must be a number{_in(unit)}.")
    try:
        number = float(value)
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        raise InputError(f"{name} is {number}{_of(unit)}; it must be finite.")
    return number


def positive(name: str, value: object, unit: str = "1") -> float:
    """Return `value` as a float. Raises InputError unless it is a finite number above zero that is not subnormal."""
    number = finite_number(name, value, unit)
    if number < SMALLEST:
        raise InputError(f"{name} is {number!r}{_of(unit)}; it must be positive{_subnormal(number)}.")
    return number


def nonnegative(name: str, value: object, unit: str = "1") -> float:
    """Return `value` as a float. Raises InputError unless it is a finite number of at least zero."""
    number = finite_number(name, value, unit)
    if number < 0.0:
        raise InputError(f"{name} is {number!r}{_of(unit)}; it must not be negative.")
    return number


def fraction(name: str, value: object, low: float = 0.0, high: float = 1.0) -> float:
    """Return `value` as a float. Raises InputError unless low <= value <= high."""
    number = finite_number(name, value)
    if not low <= number <= high:
        raise InputError(f"{name} is {number!r}; it must lie between {low:g} and {high:g}.")
    return number


def whole_number(name: str, value: object, least: int = 1) -> int:
    """Return `value` as an int. Raises InputError unless it is of an integer type and at least `least`."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise InputError(f"{name} is {reprlib.repr(value)}; it must be a whole number of at least {least}.")
    if value < least:
        raise InputError(f"{name} is {int(value)}; it must be at least {least}.")
    return int(value)


def choice(name: str, value: object, allowed: Iterable[str]) -> str:
    """Return `value` if it is one of `allowed`. Raises InputError that names the nearest one otherwise."""
    words = list(allowed)
    if isinstance(value, str) and value in words:
        return value
    listed = ", ".join(repr(word) for word in words)
    raise InputError(f"{name} is {reprlib.repr(value)}; it must be one of {listed}{nearest(value, words)}.")


def nearest(value: object, allowed: Iterable[str]) -> str:
    """Return " (did you mean ...?)" with the word of `allowed` nearest to `value`, or "" where none is near."""
    found = difflib.get_close_matches(value.lower(), list(allowed), n=1, cutoff=0.5) if isinstance(value, str) else []
    return f" (did you mean {found[0]!r}?)" if found else ""


def finite_array(name: str, value: object, shape: tuple[int | None, ...]) -> Floats:
    """Return a fresh C-ordered float64 copy of `value`; shape: what it must have, None where any length will do.

    Raises InputError for another shape, for values that are masked, not numbers, not finite (naming the first and how
    many), and for numbers that a double cannot hold exactly (integers beyond 2^53, extended precision).
    """
    if isinstance(value, np.ma.MaskedArray):
        raise InputError(f"{name} is a masked array; fill or drop its masked values first.")
    try:
        given = np.asarray(value)
    except ValueError:
        raise InputError(f"{name} has rows of different lengths; its shape must be {_text(shape)}.") from None
    if given.dtype.kind not in "fiu":
        raise InputError(
            f"{name} has dtype {given.dtype}; it must hold real numbers, for example np.asarray(values, dtype=float)."
        )
    if given.ndim != len(shape) or any(s not in (None, n) for s, n in zip(shape, given.shape, strict=True)):
        raise InputError(f"{name} has shape {_text(given.shape)}; it must be {_text(shape)}.")
    with np.errstate(over="ignore"):  # longer floats become inf and are refused below
        array = np.array(given, dtype=np.float64, order="C")
    _refuse(name, ~np.isfinite(array), array, "not finite")
    if given.dtype.kind in "iu":
        _refuse(name, (given > LARGEST_WHOLE) | (given < -LARGEST_WHOLE), given, "beyond 2^53, where doubles have gaps")
    elif given.dtype.itemsize > array.dtype.itemsize:
        _refuse(name, given != array, given, "more precise than a double; convert with np.float64")
    return array


def positive_array(name: str, value: object, shape: tuple[int | None, ...], unit: str = "1") -> Floats:
    """Return a fresh float64 copy. Raises InputError as `finite_array`, and where a value is not above zero."""
    array = finite_array(name, value, shape)
    bad = array < SMALLEST
    if np.any(bad):
        first = _first(bad)
        number = float(array[first])
        raise InputError(
            f"{name}{_index(first)} is {number!r}{_of(unit)}; it must be positive{_subnormal(number)}{_others(bad)}."
        )
    return array


def vector(name: str, value: object) -> Floats:
    """Return `value` as a (3,) float64 array. Raises InputError unless it holds three finite numbers."""
    return finite_array(name, value, (3,))


def axis_vector(name: str, value: object) -> Floats:
    """Return the (3,) unit vector along "x", "y", "z" or a vector. Raises InputError for all else, and for zero."""
    if isinstance(value, str):
        return np.array(AXES[choice(name, value, AXES)])
    along = vector(name, value)
    longest = np.max(np.abs(along))
    if longest < SMALLEST:
        raise InputError(f"{name} is the zero vector; it must have a direction, for example 'z' or (0, 0, 1).")
    along = along / longest  # first, so that no square under- or overflows
    return along / np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)


def _refuse(name: str, bad: NDArray[np.bool_], values: np.ndarray, what: str) -> None:
    if np.any(bad):
        first = _first(bad)
        raise InputError(f"{name}{_index(first)} is {values[first]}, {what}{_others(bad)}.")


def _first(bad: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(k) for k in np.unravel_index(np.argmax(bad), bad.shape))


def _index(index: tuple[int, ...]) -> str:
    return f"[{', '.join(str(k) for k in index)}]" if index else ""


def _others(bad: NDArray[np.bool_]) -> str:
    count = int(np.count_nonzero(bad))
    return f" ({count} such values in all)" if count > 1 else ""


def _text(shape: tuple[int | None, ...]) -> str:
    lengths = ["n" if s is None else str(s) for s in shape]
    return f"({lengths[0]},)" if len(lengths) == 1 else f"({', '.join(lengths)})"


def _in(unit: str) -> str:
    return "" if unit == "1" else f" in {unit}"


def _of(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _subnormal(number: float) -> str:
    return f" and at least {SMALLEST:.3g}, the smallest normal double" if number > 0.0 else ""
