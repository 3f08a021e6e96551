"""The finding on units: a law gives the same answer whatever the units of length, mass, time and temperature."""

from typing import Any, NamedTuple

import numpy as np

from pybondem.check import Floats
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError
from pybondem.laws import paths
from pybondem.laws.findings import Finding, failed, in_words, passed
from pybondem.laws.subject import Subject, first, units_of
from pybondem.laws.units import NONE, Dimension, dimension, in_units
from pybondem.physics.types import ComponentRates, Components, Damage, Deformation, Loads, Rate, Stiffness

FACTOR = 1024.0  # of the number of one base quantity: a power of two, so that no digit changes
TOLERANCE = 1e-9  # of an answer in other units, relative
BASES = ("length", "mass", "time", "temperature")
POWERS = (0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 0.5, -0.5, 1.5, -1.5, 4.0, -4.0)  # that units may have
SECTION = 0.25  # bending modulus of a circle over its area and radius

SI = Dimension(1.0, 1.0, 1.0, 1.0)  # factors

DEFORMATION = [dimension(u) for u in ("m", "m", "-", "-", "m", "m2", "Pa", "Pa", "Pa", "Pa", "Pa/m", "Pa/m")]
RATE = [dimension(u) for u in ("m/s", "m/s", "1/s", "1/s")]
COMPONENTS = [dimension(u) for u in ("m", "m", "m", "-", "-", "-", "m", "m2")]
COMPONENT_RATES = [dimension(u) for u in ("m/s", "m/s", "m/s", "1/s", "1/s", "1/s")]
STIFFNESS = [dimension(u) for u in ("N/m", "N/m", "N m", "N m")]
LOADS = [dimension(u) for u in ("N", "N", "N", "N m", "N m", "N m")]


class Dimensions(NamedTuple):
    """Dimensions of the parameters and of the words of memory, by name."""

    parameters: dict[str, Dimension]
    memory: dict[str, Dimension]


class Run(NamedTuple):
    """What a law answered along a path (points, numbers), and its memory (points, words)."""

    answer: Floats
    memory: Floats


def units(s: Subject) -> Finding:
    """The law is the same law in other units: it is dimensionally what its declared units say."""
    name, tolerance = "units", TOLERANCE
    declared = Dimensions({}, {})
    for kind, given, found in zip(("parameter", "word of memory"), units_of(s.law), declared, strict=True):
        for quantity, unit in given.items():
            try:
                found[quantity] = dimension(unit)
            except InputError as error:
                return failed(name, f"The unit of the {kind} {quantity} cannot be read: {error}")
    path = _growing(s)
    base = _run(s, path, NONE, declared)
    worst = 0.0
    for quantity in BASES:
        off = _mismatch(s, path, base, declared, quantity)
        worst = max(worst, float(off.max()))
        if not worst <= tolerance:
            where = in_words(path[int(np.argmax(off > tolerance))], "bond")
            sentence = _blame(s, path, base, declared) or _memory_blame(s, path, base, declared, quantity)
            return failed(name, sentence, where, float(off.max()), tolerance)
    return passed(name, "The answer is the same in any units of length, mass, time and temperature.", worst, tolerance)


def _growing(s: Subject) -> Floats:
    """Return a random path (points, 6) from where the law does nothing yet to where it has done all."""
    onset, end = s.reach["bond"][:2]
    sizes = [0.5 * onset * (2.4 * end / onset) ** share for share in (0.0, 0.4, 0.7, 1.0)]
    return np.concatenate([paths.wandering(size, 4, 4, seed) for seed, size in enumerate(sizes, 51)])


def _mismatch(s: Subject, path: Floats, base: Run, declared: Dimensions, quantity: str) -> Floats:
    """Return by how much the answers differ in another unit of one quantity (points,), relative to their size."""
    other = _run(s, path, NONE._replace(**{quantity: 1.0}), declared)
    off = [_difference(base.answer, other.answer)]
    if base.memory.shape[1]:
        off.append(_difference(base.memory, other.memory))
    return np.max(off, axis=0)


def _difference(a: Floats, b: Floats) -> Floats:
    size = np.nan_to_num(np.abs(a)).max(axis=0)
    off = np.abs(a - b) / np.where(size > 0.0, size, 1.0)
    same = np.isnan(a) & np.isnan(b)
    worst: Floats = np.where(same, 0.0, np.nan_to_num(off, nan=np.inf)).max(axis=1)
    return worst


def _blame(s: Subject, path: Floats, base: Run, declared: Dimensions) -> str:
    """Return the sentence that names one parameter in another unit with which all is well, "" where there is none."""
    for parameter, given in declared.parameters.items():
        right = given
        for quantity in BASES:
            for power in sorted(POWERS, key=lambda p: abs(p - getattr(given, quantity))):
                changed = declared.parameters | {parameter: given._replace(**{quantity: power})}
                trial = declared._replace(parameters=changed)
                if _mismatch(s, path, base, trial, quantity).max() <= TOLERANCE:
                    right = right._replace(**{quantity: power})
                    break
            else:
                break
        else:
            wanted, said = in_units(right), units_of(s.law)[0][parameter]
            return f"The parameter {parameter} is declared in {said}, but the law uses it as if it were in {wanted}."
    return ""


def _memory_blame(s: Subject, path: Floats, base: Run, declared: Dimensions, quantity: str) -> str:
    """Return the sentence that names the word of memory with a wrong unit, or says that a number in the law has one."""
    others = [_run(s, path, NONE._replace(**{q: 1.0}), declared) for q in BASES]
    if max(float(_difference(base.answer, other.answer).max()) for other in others) <= TOLERANCE:
        for c, word in enumerate(s.law.memory._fields):
            k = int(np.argmax(np.nan_to_num(np.abs(base.memory[:, c]))))
            grown = [abs(other.memory[k, c] / base.memory[k, c]) for other in others]
            right = declared.memory[word].times(Dimension(*np.round(2.0 * np.log(grown) / np.log(FACTOR)) / 2.0))
            if right != declared.memory[word]:
                return (
                    f"The word of memory {word} is declared in {units_of(s.law)[1][word]}, but what the law keeps in "
                    f"it is in {in_units(right)}."
                )
    return (
        f"The answer changes with the unit of {quantity}, and no single parameter explains it: a number written in the "
        "law has a unit (make it a parameter), or unlike quantities are added or compared."
    )


# One run in units of one's choice ---------------------------------------------------------------------------------


def _run(s: Subject, path: Floats, powers: Dimension, declared: Dimensions) -> Run:
    """Return the answers along a path in units in which the number of a base quantity is FACTOR to a power larger.

    Answers and memory are turned back into SI units by the dimensions that they should have.
    """
    factors = Dimension(*(FACTOR**p for p in powers))
    law = on_arrays(s.law.function)
    given = s.law.parameters._asdict()
    p = type(s.law.parameters)(*_scaled(given.values(), declared.parameters.values(), factors))
    sizes = s.trial("bond", 1).stiffness
    k = Stiffness(*_scaled(sizes[:4], STIFFNESS, factors))
    memory = s.law.memory(*np.zeros(len(s.law.memory._fields)))
    dt = s.time_step(path)
    step = np.float64(dt * factors.time)
    answers, words, kinds = [], [], declared.memory.values()
    for before, local in zip(np.concatenate([path[:1], path[:-1]]), path, strict=True):
        d, rate = seen(s, local, (local - before) / dt, sizes, factors)
        with np.errstate(all="ignore"):
            answer, kept = law(d, k, memory, p, rate, step)
        memory = s.law.memory(*map(first, kept))
        numbers = [*answer] if isinstance(answer, Damage | Loads) else [answer]
        dims = LOADS if isinstance(answer, Loads) else [NONE] * len(numbers)
        answers.append([first(v) / x.scaled(factors) for v, x in zip(numbers, dims, strict=True)])
        words.append([first(v) / x.scaled(factors) for v, x in zip(memory, kinds, strict=True)])
    return Run(np.array(answers), np.array(words).reshape(len(path), len(memory)))


def seen(s: Subject, local: Floats, rates: Floats, sizes: Floats, factors: Dimension = SI) -> tuple[Any, Any]:
    """Return what the law sees of a deformation (6,) or (6, count) and its rates, in the units of the factors.

    sizes: stiffness and cross-section of the bond (see `Trial.stiffness`).
    """
    area = float(sizes[4])
    if s.law.kind == "bond":
        d = _scaled([*local, s.length, area], COMPONENTS, factors)
        return Components(*d), ComponentRates(*_scaled(rates, COMPONENT_RATES, factors))
    kn, ks, kt, kb = sizes[:4]
    modulus = SECTION * area * float(np.sqrt(area / np.pi))
    n, slip, twist, bending = local[0], np.hypot(*local[1:3]), abs(local[3]), np.hypot(*local[4:])
    values = (n, slip, twist, bending, s.length, area, kn * n / area, ks * slip / area, kb * bending / modulus,
              0.5 * kt * twist / modulus, kn / area, ks / area)  # fmt: skip
    moving = (rates[0], np.hypot(*rates[1:3]), abs(rates[3]), np.hypot(*rates[4:]))
    return Deformation(*_scaled(values, DEFORMATION, factors)), Rate(*_scaled(moving, RATE, factors))


def _scaled(values: Any, dims: Any, factors: Dimension) -> list[Any]:
    return [np.float64(v) * x.scaled(factors) for v, x in zip(values, dims, strict=True)]
