"""A law under trial: how far it must be driven to be seen whole, and the answers to a set of paths."""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from pybondem.bonds import ValuedLaw
from pybondem.check import Floats
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError
from pybondem.laws import paths
from pybondem.laws.poses import motions
from pybondem.laws.reading import SAMPLES
from pybondem.laws.trial import ELEMENTS, LENGTH, NORMAL, SHEAR, Answer, History, Trial, single
from pybondem.laws.units import NONE, Dimension, dimension
from pybondem.physics.types import Stiffness

COMPONENTS_OF = ((0,), (1, 2), (3,), (4, 5))  # of opening, slip, twist, bending
FIRST = (0, 1, 3, 4)  # the component that stands for each
SIZES = np.geomspace(1e-7, 0.3, 131)  # of opening and slip over length, and of angles [rad]
LENGTHS = (LENGTH, 1.0, 100.0)  # of pairs, to begin with [m]
SMALL, LARGE = 0.01, 0.05  # of the length: where a law should do what it does, and may do it
TIME, TEMPERATURE = Dimension(time=1.0), Dimension(temperature=1.0)


class Reach(NamedTuple):
    """Deformation (6,) where a law begins to soften or yield, and where little is left; stiffness (6,) when new."""

    onset: Floats
    end: Floats
    stiffness: Floats


@dataclass(frozen=True)
class Subject:
    """One law with one value of each parameter.

    calm: the same without change of temperature; length: of the pairs to try it with [m]; reach: for each element;
    duration: of a path [s]; heated: why energy cannot be looked at, where a temperature loads the bond that cannot be
    set to 0, else ""; histories: what was found so far, by element.
    """

    law: ValuedLaw
    calm: ValuedLaw
    length: float
    duration: float
    reach: dict[str, Reach]
    heated: str = ""
    histories: dict[str, dict[str, History]] = field(default_factory=dict)

    @property
    def calmed(self) -> str:
        """Which temperatures were set to 0, in words to go on with."""
        pairs = zip(self.law.parameters._fields, self.law.parameters, self.calm.parameters, strict=True)
        said = [f"{name} = 0" for name, value, calm in pairs if value != calm]
        return f" (with {' and '.join(said)})" if said else ""

    def trial(self, element: str, count: int, calm: bool = False, **options: Any) -> Trial:
        """Return a trial of this law in pairs of its length."""
        return Trial(self.calm if calm else self.law, element, count=count, length=self.length, **options)

    def sizes(self, element: str, count: int, seed: int = 0) -> Floats:
        """Return sizes of deformation (6, count), spread from where the law begins to where little of it is left."""
        onset, end = self.reach[element][:2]
        share = np.random.default_rng(seed).uniform(0.0, 1.0, (6, count))
        spread: Floats = 0.5 * onset[:, None] * (2.4 * end / onset)[:, None] ** share
        return spread

    def wander(self, element: str, count: int, legs: int = 5, steps: int = 5, seed: int = 1) -> Floats:
        """Return a random path (points, 6, count) through all that the law does."""
        return paths.wandering(self.sizes(element, count, seed), legs, steps, seed)

    def time_step(self, path: Floats) -> float:
        """Return the time from point to point of a path [s]."""
        return self.duration / max(len(path) - 1, 1)

    def followed(self, element: str, path: Floats) -> History:
        """Return the answers along a path (points, 6, count), without change of temperature.

        Where the law reads rates every point is a point of rest too: across a sudden turn the trapezoid rule would book
        work of a velocity that is over.
        """
        if self.law.flows:
            path = np.repeat(path, 2, axis=0)
        return self.trial(element, path.shape[2], calm=True).follow(path, self.time_step(path))

    def driven(self, element: str) -> dict[str, History]:
        """Return the answers to paths that load, unload, close, open again, wander and go far, by name of the path."""
        if element not in self.histories:
            found = {}
            for name, path in _drives(self, element).items():
                found[name] = self.followed(element, path)
            self.histories[element] = found
        return self.histories[element]


def subject(law: ValuedLaw) -> Subject:
    """Return a law made ready for trial: with single values, its reach measured.

    Where the law brings no stiffness, the bonds are made so stiff that they reach the onset of softening with less
    energy than the law declares for the whole failure; no softer bond could keep that promise.
    """
    one = single(law)
    duration = _duration(one)
    for stiffer in (1.0, 10.0, 100.0, 1e3, 1e4) if one.stiffness is None else (1.0,):
        shear = one.stiffness if one.stiffness is not None else stiffer * SHEAR * NORMAL
        stiff = replace(one, stiffness=shear)
        calm = _calm(stiff)
        length, reach = _fitting(calm, duration)
        if _can_soften(calm, shear, reach):
            break
    return Subject(stiff, calm, length, duration, reach, _heated(calm, length, duration))


def _fitting(law: ValuedLaw, duration: float) -> tuple[float, dict[str, Reach]]:
    """Return a length of pairs [m] of which about 1 % matters to a law, and the reach of the law in such pairs."""
    for length in LENGTHS:
        found = {element: _reach(law, element, length, duration) for element in ELEMENTS}
        far = max((float(e) for r in found.values() for e in r.end[:2] if np.isfinite(e)), default=np.inf)
        if far < SIZES[-1] * length:  # else it goes on, or nothing happens: longer pairs can be driven further
            break
    else:
        length, far = LENGTH, SMALL * LENGTH
    if not 0.01 * LARGE < far / length <= LARGE:
        length = far / SMALL
    found = {element: _reach(law, element, length, duration) for element in ELEMENTS}
    return length, {element: _filled(r, far) for element, r in found.items()}


def _filled(r: Reach, far: float) -> Reach:
    """Return a reach with sizes also where a law does nothing; far: that of opening and slip [m]."""
    plain = np.repeat([far, SMALL], 3)
    onset, end = (np.where(np.isfinite(a), a, plain) for a in (r.onset, r.end))
    return Reach(onset, end, r.stiffness)


def _can_soften(law: ValuedLaw, shear: float, reach: dict[str, Reach]) -> bool:
    """Return whether the elastic energy at onset is within the declared fracture energies, in every element."""
    declared: Any = law.declared
    for mode, k, component in (("opening", shear / SHEAR, 0), ("slip", shear, 1)):
        if mode in declared.toughness:
            energy = declared.toughness[mode](law.parameters, k)
            if any(0.5 * k * r.onset[component] ** 2 > energy for r in reach.values()):
                return False
    return True


def units_of(law: ValuedLaw) -> tuple[dict[str, str], dict[str, str]]:
    """Return the declared units of a law's parameters and of the words of its memory."""
    declared: Any = law.declared
    return {name: p.unit for name, p in declared.parameters.items()}, dict(declared.memory)


def first(value: Any) -> float:
    """Return the number that a law answered, which comes in an array where it branches."""
    return float(np.ravel(value)[0])


def known_dimension(unit: str) -> Dimension:
    """Return the dimension of a unit, none where the unit is not known: that is for the finding on units to say."""
    try:
        return dimension(unit)
    except InputError:
        return NONE


def _calm(law: ValuedLaw) -> ValuedLaw:
    """Return the law without change of temperature: with all temperatures at 0, or all those that it divides by not."""
    declared: Any = law.declared
    names = [name for name in temperatures(law) if declared.parameters[name].allows(0.0)]
    calm = _with(law, names)
    if not names or _stands(calm, _stands(law, True)):
        return calm
    strict, calm = _stands(law, True), law
    for name in names:
        colder = _with(calm, [name])
        calm = colder if _stands(colder, strict) else calm
    return calm


def temperatures(law: ValuedLaw) -> list[str]:
    """Return the names of the parameters that are temperatures."""
    return [name for name, unit in units_of(law)[0].items() if known_dimension(unit) == TEMPERATURE]


def _with(law: ValuedLaw, zeros: list[str]) -> ValuedLaw:
    return replace(law, parameters=law.parameters._replace(**dict.fromkeys(zeros, 0.0)))


def _stands(law: ValuedLaw, strict: bool) -> bool:
    """Return whether a law answers a new bond with numbers; strict: and divides by zero nowhere on the way."""
    sample = SAMPLES[law.kind]
    d, rate = (type(x)(*map(np.float64, x)) for x in (sample["d"], sample["rate"]))
    memory = law.memory(*np.zeros(len(law.memory._fields)))
    how: Any = "raise" if strict else "ignore"
    try:
        with np.errstate(divide=how, invalid=how):
            k = Stiffness(1e6, 1e6, 1.0, 1.0)
            answer, kept = on_arrays(law.function)(d, k, memory, law.parameters, rate, np.float64(1e-6))
    except (ArithmeticError, ValueError):
        return False
    return all(np.isfinite(v).all() for v in (*(answer if isinstance(answer, tuple) else (answer,)), *kept))


def _heated(law: ValuedLaw, length: float, duration: float) -> str:
    """Return the sentence that a temperature which cannot be 0 loads an undeformed bond, "" where none does."""
    values = {name: getattr(law.parameters, name) for name in temperatures(law)}
    left = [f"{name} = {value:g}" for name, value in values.items() if value]
    if not left:
        return ""
    trial = Trial(law, "bond", length=length)
    load = trial.evaluate(trial.pose(np.zeros(6)), None, duration).force_j
    if not float(np.abs(load).max()) > 1e-9 * float(trial.stiffness[0]) * length:
        return ""
    return (
        f"The law cannot be tried without its temperature: {' and '.join(left)} cannot be set to 0, and loads the bond "
        "by itself."
    )


def _duration(law: ValuedLaw) -> float:
    """Return how long a path should last [s]: ten times the longest time among the parameters, 1 s without any."""
    times = [1.0]
    for name, unit in units_of(law)[0].items():
        value = abs(float(getattr(law.parameters, name)))
        if known_dimension(unit) == TIME and value > 0.0:
            times = [*times[1:], 10.0 * value]
    return max(times)


def _reach(law: ValuedLaw, element: str, length: float, duration: float) -> Reach:
    """Return the reach of a law in each component, nan where it does nothing, from pairs deformed at once."""
    count = len(SIZES)
    onset, end, new = np.zeros(6), np.zeros(6), np.zeros(6)
    for mode, component in enumerate(FIRST):
        scale = length if component < 3 else 1.0
        local = np.zeros((6, count))
        local[component] = SIZES * scale
        trial = Trial(law, element, count=count, length=length)
        path = np.stack([0.0 * local, local])
        at = [trial.pose(p) for p in path]
        trial.evaluate(at[0], None, duration)
        answer = trial.evaluate(at[1], motions(at[0], at[1], duration, None), duration)
        secant, stiffness = _secant(answer, mode, local[component], float(trial.stiffness[mode]))
        begins, ends = _knees(secant, local[component])
        for c in COMPONENTS_OF[mode]:
            onset[c], end[c], new[c] = begins, ends, stiffness
    return Reach(onset, end, new)


def _secant(answer: Answer, mode: int, size: Floats, stiffness: float) -> tuple[Floats, float]:
    """Return the share of its first secant stiffness that each pair has left in a mode (count,), and that stiffness."""
    if answer.own is None:
        left = 1.0 - answer.damages[min(mode, len(answer.damages) - 1)]
        return left / left[0] if left[0] > 0.0 else left, stiffness  # what is lost at once is not lost to deformation
    load = np.sqrt((answer.own[list(COMPONENTS_OF[mode])] ** 2).sum(axis=0)) / size
    first = float(load[0])
    return (load / first, first) if first > 0.0 else (np.ones_like(size), 0.0)


def _knees(secant: Floats, size: Floats) -> tuple[float, float]:
    """Return the sizes where the secant stiffness begins to fall and where little is left; nan if it does not."""
    lost = 1.0 - np.where(np.isfinite(secant), secant, 0.0)
    begins = np.flatnonzero(lost > 1e-3)
    if len(begins) == 0:
        return np.nan, np.nan
    first = float(size[max(begins[0] - 1, 0)])
    for share in (0.99, 0.5):
        ends = np.flatnonzero(lost > share)
        if len(ends):
            return first, float(size[ends[0]])
    return first, float(size[-1])


# Paths -----------------------------------------------------------------------------------------------------------


def _drives(s: Subject, element: str) -> dict[str, Floats]:
    """Return paths (points, 6, count) by name: every kind of motion, in single modes and mixed, to several sizes."""
    onset, end = s.reach[element][:2]
    singles = np.concatenate([np.diag(onset), np.diag(0.5 * (onset + end)), np.diag(1.2 * end)], axis=1)
    random = s.sizes(element, 16, seed=3) * np.random.default_rng(4).choice([-1.0, 1.0], (6, 16))
    targets = np.concatenate([singles, random], axis=1)
    pulled = targets.copy()
    pulled[0] = np.abs(pulled[0]) + 0.5 * onset[0]
    return {
        "loading and unloading": paths.cyclic(targets, cycles=4, steps=6),
        "loading to and fro": paths.cyclic(targets, cycles=3, steps=6, back=-1.0),
        "opening, closing, opening again": paths.reopened(pulled, steps=8),
        "a random path": s.wander(element, 32, legs=8, steps=5, seed=5),
        "large deformation": paths.through([np.zeros((6, 27)), *_large(s.length)], 1),
    }


def _large(length: float) -> list[Floats]:
    """Return large but sane deformations (6, 27): strains of 10 %, rotations of 0.3 rad, and exact zeros among them."""
    signs = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0])).reshape(3, -1)
    n, slip, turn = signs * np.array([[0.1 * length], [0.1 * length], [0.3]])
    return [
        paths.deformation(n, slip, 0.0, turn, 0.0, turn),
        paths.deformation(-n, 0.0, slip, -turn, turn, 0.0),
        np.zeros((6, 27)),
        paths.deformation(n, slip, slip, 0.0, 0.0, 0.0),
    ]
