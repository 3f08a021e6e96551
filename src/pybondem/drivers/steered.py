"""An end that is steered while the simulation runs: a schedule whose future is decided step by step."""

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pybondem.boundaries import Boundaries
from pybondem.check import choice
from pybondem.model import Model, Selection
from pybondem.schedules import Smooth

Floats = NDArray[np.float64]


class Steered:
    """A velocity that goes over from one value to another without a jump, whenever told to; 0 at first.

    It is a sum of smooth rises, so that displacements are exact integrals, however often it is steered.
    """

    def __init__(self) -> None:
        self._rises: list[tuple[float, Smooth]] = []

    def steer(self, at: float, to: float, over: float) -> None:
        """Go over to the velocity `to` [m/s] within `over` [s] from the time `at` [s] on."""
        self._rises.append((at, Smooth(to - self._last, over)))

    @property
    def _last(self) -> float:
        """The velocity [m/s] once all is over."""
        return sum(rise.to for _, rise in self._rises)

    def value(self, t: Floats) -> Floats:
        """Return the velocity at the times t [m/s]."""
        return sum((rise.value(t - at) for at, rise in self._rises), np.zeros_like(t))

    def integral(self, t: Floats) -> Floats:
        """Return the displacement at the times t [m]."""
        return sum((rise.integral(t - at) for at, rise in self._rises), np.zeros_like(t))


def steered(model: Model, end: Selection, axis: str) -> tuple[Model, Steered]:
    """Return a copy of a model whose end is steered along x, y or z, and what steers it.

    What else drives or holds these particles along this axis is left out; all other conditions stay.
    """
    c, indices = "xyz".index(choice("axis", axis, "xyz")), model.own(end)
    free, velocity = copy.copy(model), Steered()
    free.boundaries = Boundaries()
    for old in model.boundaries.conditions:
        others = {k: schedule for k, schedule in old.schedules.items() if k != c or old.kind == "push"}
        here, elsewhere = np.intersect1d(old.indices, indices), np.setdiff1d(old.indices, indices)
        if len(elsewhere):
            free.boundaries.add(replace(old, indices=elsewhere))
        if len(here) and others:
            free.boundaries.add(replace(old, indices=here, schedules=others))
    free.drive(end, **{f"v{axis}": velocity})
    return free, velocity
