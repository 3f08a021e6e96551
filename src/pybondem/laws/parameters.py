"""The parameters of a law: their declaration, and the values that a user gives them."""

import keyword
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pybondem.bonds import Value
from pybondem.check import finite_array, finite_number, nearest
from pybondem.errors import InputError, LawError
from pybondem.laws.units import dimension, scale
from pybondem.scatter import Scatter


class Parameter(NamedTuple):
    """One parameter of a law: unit, meaning, and which values it may take.

    above: values must exceed it; least, most: values must lie between them; default: its value where none is given;
    typical: a value to try the law with.
    """

    unit: str
    meaning: str = ""
    above: float = -np.inf
    least: float = -np.inf
    most: float = np.inf
    default: float | None = None
    typical: float | None = None

    def allows(self, values: ArrayLike) -> Any:
        """Return whether each value lies where it may."""
        a = np.asarray(values)
        return (a > self.above) & (a >= self.least) & (a <= self.most)

    @property
    def range(self) -> str:
        """What may be given, in words."""
        if self.above == 0.0 and not np.isfinite(self.most):
            return "positive"
        if np.isfinite(self.least) and np.isfinite(self.most):
            return f"between {self.least:g} and {self.most:g}"
        limits = ((self.above, "above"), (self.least, "at least"), (self.most, "at most"))
        said = [f"{word} {value:g}" for value, word in limits if np.isfinite(value)]
        return " and ".join(said) or "finite"


# What must hold between parameters, in words, and whether it does: {"end > peak": lambda p: p.end > p.peak}.
Needs = Mapping[str, Callable[[Any], Any]]


def declared(law: str, parameters: Mapping[str, str | Parameter]) -> dict[str, Parameter]:
    """Return the parameters of a law, declared by their unit or in full. Raises LawError for names it cannot have."""
    _check_words(law, "parameters", parameters)
    found = {name: Parameter(p) if isinstance(p, str) else p for name, p in parameters.items()}
    for name, parameter in found.items():
        if not isinstance(parameter, Parameter):
            raise LawError(f"parameter {name!r} of {law} is {parameter!r}; give its unit ('Pa') or a Parameter.")
        if name == "stiffness":
            raise LawError(f"{law} cannot have a parameter named 'stiffness': a Joint takes that of every law.")
        check_unit(f"parameter {name!r} of {law}", parameter.unit)
    return found


def remembered(law: str, memory: Mapping[str, str]) -> dict[str, str]:
    """Return the words of a law's memory with their units. Raises LawError for names and units it cannot have."""
    _check_words(law, "memory", memory)
    for word, unit in memory.items():
        check_unit(f"memory {word!r} of {law}", unit)
    return dict(memory)


def _check_words(law: str, what: str, words: Any) -> None:
    if not isinstance(words, Mapping):
        raise LawError(f"the {what} of {law} are {words!r}; give names and units, such as {{'rate': '1/m'}}.")
    for name in words:
        if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
            raise LawError(f"{name!r} cannot be a name among the {what} of {law}; take letters, as in 'strength'.")


def check_unit(what: str, unit: Any) -> None:
    """Raise LawError for a unit that is not known, or not one of the SI without a prefix: values are not converted."""
    if not isinstance(unit, str):
        raise LawError(f"{what} has the unit {unit!r}; give it in words, such as 'Pa', '1/m', '-'.")
    try:
        dimension(unit)
    except InputError as error:
        raise LawError(f"{what}: {error}") from None
    if scale(unit) != 1.0:
        raise LawError(
            f"{what} is declared in {unit!r}, but values are not converted; declare an SI unit without prefix."
        )


def given(
    law: str, parameters: Mapping[str, Parameter], positional: tuple[Any, ...], named: dict[str, Any]
) -> dict[str, Any]:
    """Return a value for each parameter: a number, one per bond (m,), or a Scatter.

    Raises InputError for a misspelt, missing, doubled or surplus value, and for one outside the parameter's range.
    """
    said = ", ".join(f"{name} [{p.unit}]" for name, p in parameters.items()) or "none"
    if len(positional) > len(parameters):
        raise InputError(f"{law} was given {len(positional)} values; its parameters are {said}.")
    for name in named:
        if name not in parameters:
            raise InputError(f"{law} has no parameter {name!r}{nearest(name, parameters)}; its parameters are {said}.")
    values = dict(zip(parameters, positional, strict=False))
    for name in values:
        if name in named:
            raise InputError(f"{law} was given {name} twice.")
    values |= named
    for name, parameter in parameters.items():
        if name not in values and parameter.default is None:
            raise InputError(f"{law} needs a value for {name} [{parameter.unit}]; its parameters are {said}.")
        values.setdefault(name, parameter.default)
    return {name: _value(f"{name} of {law}", values[name], p) for name, p in parameters.items()}


def check_values(law: str, parameters: Mapping[str, Parameter], needs: Needs, values: Any) -> None:
    """Raise InputError where values (a named tuple of numbers or arrays) are outside their range, or a need fails."""
    for name, value in values._asdict().items():
        if not isinstance(value, Scatter):
            _check_range(f"{name} of {law}", value, parameters[name])
    if any(isinstance(v, Scatter) for v in values):
        return  # looked at again when the bonds are known
    lengths = {name: np.size(v) for name, v in values._asdict().items() if np.ndim(v) == 1}
    if len(set(lengths.values())) > 1:
        said = " and ".join(f"{name} {count}" for name, count in lengths.items())
        raise InputError(f"the parameters of {law} have different numbers of values ({said}); give as many of each.")
    for need, holds in needs.items():
        fine = np.asarray(holds(values))
        if not np.all(fine):
            k = int(np.argmin(fine))
            which = f" of bond {k}" if fine.ndim else ""
            said = ", ".join(f"{n} = {v if np.ndim(v) == 0 else v[k]:g}" for n, v in values._asdict().items())
            raise InputError(f"{law} needs {need}; the values{which} are {said}.")


def _value(name: str, value: Any, parameter: Parameter) -> Value | Scatter:
    if isinstance(value, Scatter):
        return value
    if np.ndim(value) == 0:
        return finite_number(name, value, parameter.unit)
    return finite_array(name, value, (None,))


def _check_range(name: str, value: Value, parameter: Parameter) -> None:
    fine = np.asarray(parameter.allows(value))
    if not np.all(fine):
        k = int(np.argmin(fine))
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        first, which = (np.asarray(value)[k], f"[{k}]") if fine.ndim else (value, "")
        raise InputError(f"{name}{which} is {first:g}{unit}; it must be {parameter.range}.")
