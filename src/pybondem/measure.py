"""Named measures of a running simulation, taken between blocks of steps.

A `Measure` has columns with units and is evaluated on a simulation; `Simulation.record` keeps a table of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pybondem.check import choice, nearest, positive
from pybondem.energies import Energies
from pybondem.errors import InputError, SelectionError
from pybondem.model import BondSet, Model, Selection

Floats = NDArray[np.float64]


class Running(Protocol):
    """What the measures here read of a running simulation."""

    model: Model

    @property
    def time(self) -> float:
        """Simulated time [s]."""

    @property
    def broken(self) -> int:
        """Number of broken bonds."""

    @property
    def unbalanced(self) -> float:
        """Mean force on free components over the mean force in the bonds [-]."""

    @property
    def energies(self) -> Energies:
        """The energy book [J]."""

    def total(self, name: str, where: Selection) -> Floats:
        """Return the sum of a particle field over a selection (3,)."""

    def mean_displacement(self, where: Selection) -> Floats:
        """Return the mean displacement of a selection since the start (3,) [m]."""

    def interface(self, joints: BondSet) -> tuple[Floats, Floats]:
        """Return slip (m,) [m] and shear stress (m,) [Pa] of a set of joints."""


Evaluate = Callable[[Running], tuple[float, ...]]


@dataclass(frozen=True)
class Measure:
    """What is measured: column names (an empty name: that of the keyword it is recorded under) with units."""

    columns: dict[str, str]
    evaluate: Evaluate


def _axis(axis: str) -> int:
    return "xyz".index(choice("axis", axis, "xyz"))


def _some(name: str, where: Selection) -> Selection:
    if not isinstance(where, Selection):
        raise InputError(f"{name} needs a Selection (Model.where, part or select), got {type(where).__name__}.")
    if len(where) == 0:
        raise SelectionError(f"{name} was given {where!r}; the selection is empty.")
    return where


def reaction(where: Selection, axis: str) -> Measure:
    """Return the force [N] along x, y or z that the specimen puts on the selected particles, taken by their support."""
    _some("reaction", where)
    c = _axis(axis)
    return Measure({"": "N"}, lambda sim: (float(sim.total("force", where)[c]),))


def applied(where: Selection, axis: str) -> Measure:
    """Return the force [N] along x, y or z that the boundary puts on the selected particles: minus the reaction."""
    force = reaction(where, axis)
    return Measure({"": "N"}, lambda sim: (-force.evaluate(sim)[0],))


def displacement(where: Selection, axis: str) -> Measure:
    """Return the mean displacement [m] along x, y or z of the selected particles since the start."""
    _some("displacement", where)
    c = _axis(axis)
    return Measure({"": "m"}, lambda sim: (float(sim.mean_displacement(where)[c]),))


def strain(first: Selection, second: Selection, axis: str) -> Measure:
    """Return the engineering strain [-] between two selections: growth of the distance of their means over itself."""
    c = _axis(axis)
    for where in (first, second):
        _some("strain", where)

    def evaluate(sim: Running) -> tuple[float]:
        apart = sim.model.x[sim.model.own(second), c].mean() - sim.model.x[sim.model.own(first), c].mean()
        if apart == 0.0:
            raise InputError(f"strain along {axis} of {first!r} and {second!r}: their means are at the same {axis}.")
        return (float((sim.mean_displacement(second)[c] - sim.mean_displacement(first)[c]) / apart),)

    return Measure({"": "1"}, evaluate)


def stress(where: Selection, axis: str, area: float) -> Measure:
    """Return the reaction of the selected particles along x, y or z over the area [m2] of the specimen, in Pa."""
    area, force = positive("area of stress", area, "m2"), reaction(where, axis)
    return Measure({"": "Pa"}, lambda sim: (force.evaluate(sim)[0] / area,))


def broken() -> Measure:
    """Return the number of broken bonds (damage 1)."""
    return Measure({"": "1"}, lambda sim: (float(sim.broken),))


def unbalanced() -> Measure:
    """Return the mean force on free particles over the mean force in bonds [-]: 0 in equilibrium."""
    return Measure({"": "1"}, lambda sim: (sim.unbalanced,))


def energy() -> Measure:
    """Return the energy book [J], columns energy_kinetic ... energy_residual: see `Energies`; the residual is 0."""
    return Measure({f"energy_{name}": "J" for name in Energies._fields}, lambda sim: tuple(sim.energies))


def slip(joints: BondSet) -> Measure:
    """Return the mean slip [m] and the mean shear stress [Pa] of a set of joints."""

    def evaluate(sim: Running) -> tuple[float, float]:
        s, tau = sim.interface(joints)
        return float(np.average(s, weights=joints.area)), float(np.average(tau, weights=joints.area))

    return Measure({"slip": "m", "shear": "Pa"}, evaluate)


class Column:
    """One recorded quantity: its values so far, `last`, `max`, `min`, and its unit."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self._values: list[float] = []

    def append(self, value: float) -> None:
        """Add a value."""
        self._values.append(value)

    @property
    def values(self) -> Floats:
        """All values, (rows,)."""
        return np.array(self._values)

    @property
    def last(self) -> float:
        """The last value; nan before the first."""
        return self._values[-1] if self._values else float("nan")

    @property
    def max(self) -> float:
        """The largest value; nan before the first."""
        return max(self._values) if self._values else float("nan")

    @property
    def min(self) -> float:
        """The smallest value; nan before the first."""
        return min(self._values) if self._values else float("nan")


class Record:
    """A table that grows while a simulation runs: `time`, then a column for each measure, also as attributes."""

    time: Column

    def __init__(self, name: str, every: int, measures: dict[str, Measure]) -> None:
        self.name, self.every, self.measures = name, every, measures
        self.columns: dict[str, Column] = {"time": Column("s")}
        for key, measure in measures.items():
            for part, unit in measure.columns.items():
                self._add(part or key, unit)
        for column_name, column in self.columns.items():
            setattr(self, column_name, column)

    def _add(self, name: str, unit: str) -> None:
        if name in self.columns or not name.isidentifier() or hasattr(self, name):
            raise InputError(f"a record cannot have a second or reserved column {name!r}; choose another keyword.")
        self.columns[name] = Column(unit)

    def __getitem__(self, name: str) -> Column:
        if name not in self.columns:
            there_are = ", ".join(self.columns)
            raise InputError(f"{self.name} has no column {name!r}{nearest(name, self.columns)}; it has {there_are}.")
        return self.columns[name]

    def take(self, sim: Running) -> list[float]:
        """Measure now, append the row and return it."""
        row = [sim.time, *(value for m in self.measures.values() for value in m.evaluate(sim))]
        for column, value in zip(self.columns.values(), row, strict=True):
            column.append(value)
        return row

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {name: column.unit for name, column in self.columns.items()}

    def plot(self, x: str, *ys: str, path: str | None = None) -> str:
        """Draw columns ys against column x into a PNG (and SVG) file and return its path."""
        from pybondem.output.figures import line_figure

        path = path or f"{self.name}-{'-'.join(ys)}.png"
        labels, units = (x, ", ".join(ys)), (self[x].unit, self[ys[0]].unit)
        line_figure(path, self[x].values, {y: self[y].values for y in ys}, labels=labels, units=units)
        return path
