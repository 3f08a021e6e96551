"""Units in words: "Pa/m", "J/m2", "N m/rad", "Pa m0.5", "-" -> powers of length, mass, time and temperature.

Angles have no dimension. What follows a stroke stands below it, so that "J/kg K" is J/(kg K).
"""

import re
from math import pi
from typing import NamedTuple

from pybondem.check import nearest
from pybondem.errors import InputError


class Dimension(NamedTuple):
    """Powers of length, mass, time and temperature."""

    length: float = 0.0
    mass: float = 0.0
    time: float = 0.0
    temperature: float = 0.0

    def times(self, other: "Dimension", power: float = 1.0) -> "Dimension":
        """Return this dimension times another one to a power."""
        return Dimension(*(a + power * b for a, b in zip(self, other, strict=True)))

    def scaled(self, factors: "Dimension") -> float:
        """Return by what a number of this dimension grows when the number of each base quantity grows by a factor."""
        size = 1.0
        for power, factor in zip(self, factors, strict=True):
            size *= float(factor) ** power
        return size


NONE = Dimension()
NAMES = {
    "m": Dimension(1.0), "kg": Dimension(0.0, 1.0), "s": Dimension(0.0, 0.0, 1.0), "K": Dimension(0.0, 0.0, 0.0, 1.0),
    "N": Dimension(1.0, 1.0, -2.0), "Pa": Dimension(-1.0, 1.0, -2.0), "J": Dimension(2.0, 1.0, -2.0),
    "W": Dimension(2.0, 1.0, -3.0), "Hz": Dimension(0.0, 0.0, -1.0), "g": Dimension(0.0, 1.0), "rad": NONE,
    "deg": NONE, "1": NONE, "-": NONE, "%": NONE,
}  # fmt: skip
PREFIXED = {"m", "g", "s", "N", "Pa", "J", "W", "Hz"}
PREFIXES = {"k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}
SIZES = {"g": 1e-3, "deg": pi / 180.0, "%": 1e-2}
COMMON = (
    "-", "m", "1/m", "m2", "m3", "s", "1/s", "m/s", "1/m2", "K", "1/K", "Pa", "1/Pa", "Pa/m", "Pa s", "Pa s/m", "N",
    "N/m", "N m", "N s/m", "N m s", "J/m2", "kg", "kg/m3", "Pa m0.5", "Pa/K", "m/K", "W/m2",
)  # fmt: skip
TOKEN = re.compile(r"(?P<name>[A-Za-z%µ]+|1|-)(?:\^|\*\*)?(?P<power>[+-]?\d+(?:\.\d+)?)?")


def scale(unit: str) -> float:
    """Return how many SI units without prefix one unit is: 1e6 for "MPa". Raises InputError for one not known."""
    size = 1.0
    for name, power in _words(unit):
        size *= _size(name) ** power
    return size


def dimension(unit: str) -> Dimension:
    """Return the dimension of a unit. Raises InputError for one that is not known."""
    total = NONE
    for name, power in _words(unit):
        total = total.times(_base(name) or NONE, power)
    return total


def _words(unit: str) -> list[tuple[str, float]]:
    """Return the units in a product or quotient, each with its power. Raises InputError for one that is not known."""
    above, _, below = unit.replace("(", " ").replace(")", " ").partition("/")
    found = []
    for text, sign in ((above, 1.0), (below.replace("/", " "), -1.0)):
        for word in re.sub(r"(?<!\*)\*(?!\*)|·", " ", text).split():
            match = TOKEN.fullmatch(word)
            base = None if match is None else _base(match["name"])
            if match is None or base is None:
                known = ", ".join(NAMES)
                raise InputError(
                    f"{word!r} in the unit {unit!r} is not known{nearest(word, NAMES)}; known are {known}."
                )
            found.append((match["name"], sign * float(match["power"] or 1.0)))
    return found


def in_units(wanted: Dimension) -> str:
    """Return a common unit of a dimension, or powers of the base units."""
    for unit in COMMON:
        if dimension(unit) == wanted:
            return unit
    parts = [f"{n}{'' if p == 1.0 else f'{p:g}'}" for n, p in zip(("m", "kg", "s", "K"), wanted, strict=True) if p]
    return " ".join(parts)


def _size(name: str) -> float:
    """Return how many SI units without prefix one unit is."""
    if name in NAMES:
        return SIZES.get(name, 1.0)
    return PREFIXES[name[0]] * SIZES.get(name[1:], 1.0)


def _base(name: str) -> Dimension | None:
    """Return the dimension of one unit, with or without a prefix, None where it is not known."""
    if name in NAMES:
        return NAMES[name]
    rest = name[1:]
    return NAMES[rest] if name[0] in PREFIXES and rest in PREFIXED else None
