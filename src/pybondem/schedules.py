"""How a prescribed velocity or force changes with time.

A schedule is a function of time with its exact integral, so that a driven particle is where the schedule says it is
to round-off, whatever the time step.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import finite_array, finite_number, positive
from pybondem.errors import InputError

Floats = NDArray[np.float64]


class Schedule(Protocol):
    """A value that changes with time [s]."""

    def value(self, t: Floats) -> Floats:
        """Return the value at the times t."""

    def integral(self, t: Floats) -> Floats:
        """Return the integral of the value from 0 to the times t."""


Prescribed = float | Schedule


@dataclass(frozen=True)
class Hold:
    """The same value always."""

    to: float

    def value(self, t: Floats) -> Floats:
        """Return the value at the times t."""
        return np.full_like(t, self.to)

    def integral(self, t: Floats) -> Floats:
        """Return the integral of the value from 0 to the times t."""
        return self.to * t


@dataclass(frozen=True)
class Smooth:
    """From 0 to a value along 3 s^2 - 2 s^3 with s = t / over, then held: no jump in acceleration."""

    to: float
    over: float

    def value(self, t: Floats) -> Floats:
        """Return the value at the times t."""
        s = np.clip(t / self.over, 0.0, 1.0)
        return self.to * s * s * (3.0 - 2.0 * s)

    def integral(self, t: Floats) -> Floats:
        """Return the integral of the value from 0 to the times t."""
        s = np.clip(t / self.over, 0.0, 1.0)
        return self.to * (self.over * s**3 * (1.0 - 0.5 * s) + np.maximum(t - self.over, 0.0))


@dataclass(frozen=True)
class Table:
    """Linear between given points, constant before the first and after the last."""

    times: Floats
    values: Floats

    def value(self, t: Floats) -> Floats:
        """Return the value at the times t."""
        return np.interp(t, self.times, self.values)

    def integral(self, t: Floats) -> Floats:
        """Return the integral of the value from 0 to the times t."""
        return self._from_first(t) - self._from_first(np.zeros(1))

    def _from_first(self, t: Floats) -> Floats:
        """Return the integral of the value from the first of the points to the times t."""
        steps = 0.5 * np.diff(self.times) * (self.values[1:] + self.values[:-1])
        at_points = np.concatenate([[0.0], np.cumsum(steps)])
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, None)
        inside = np.clip(t, self.times[0], self.times[-1])
        part = 0.5 * (inside - self.times[k]) * (self.values[k] + self.value(inside))
        before = np.minimum(t - self.times[0], 0.0) * self.values[0]
        after = np.maximum(t - self.times[-1], 0.0) * self.values[-1]
        return at_points[k] + np.where(t >= self.times[0], part, 0.0) + before + after


def hold(value: float) -> Hold:
    """Return the schedule that keeps `value` [m/s, rad/s, N or N m]."""
    return Hold(finite_number("value of hold", value))


def ramp(to: float, over: float) -> Table:
    """Return the schedule that rises linearly from 0 to `to` within `over` [s], then holds."""
    return Table(np.array([0.0, positive("over of ramp", over, "s")]), np.array([0.0, finite_number("to of ramp", to)]))


def smooth(to: float, over: float) -> Smooth:
    """Return the schedule that rises from 0 to `to` within `over` [s] with no jump in acceleration, then holds."""
    return Smooth(finite_number("to of smooth", to), positive("over of smooth", over, "s"))


def table(times: ArrayLike, values: ArrayLike) -> Table:
    """Return the schedule through the points (times [s], values), linear between, constant outside.

    Raises InputError unless both have the same length and the times increase.
    """
    t, v = finite_array("times of table", times, (None,)), finite_array("values of table", values, (None,))
    if len(t) != len(v) or len(t) < 1:
        raise InputError(f"table needs as many values as times; got {len(t)} times and {len(v)} values.")
    if np.any(np.diff(t) <= 0.0):
        k = int(np.argmax(np.diff(t) <= 0.0))
        raise InputError(f"times of table must increase; times[{k + 1}] = {t[k + 1]:g} s follows {t[k]:g} s.")
    return Table(t, v)


def as_schedule(name: str, value: object) -> Schedule:
    """Return a schedule for a number (held) or a schedule."""
    if hasattr(value, "value") and hasattr(value, "integral"):
        return value
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        return Hold(finite_number(name, float(value)))
    raise InputError(f"{name} is {value!r}; give a number or one of ramp, hold, smooth, table.")


def average(schedule: Schedule, times: Floats) -> Floats:
    """Return the mean over each interval between the given times: the velocity that keeps a drive on its path."""
    return np.diff(schedule.integral(times)) / np.diff(times)
