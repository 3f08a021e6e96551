"""Boundary conditions: what is held, driven or pushed, and the tables that the engines read.

Particles under the same set of conditions form a group; group 0 is free.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pybondem.errors import SelectionError
from pybondem.schedules import Hold, Schedule, average
from pybondem.state import Arrays

Kind = Literal["fix", "drive", "push"]
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
ZERO = Hold(0.0)


@dataclass(frozen=True)
class Condition:
    """One call of fix, drive or push: particles, and a schedule for each component (0-2 along, 3-5 about x, y, z)."""

    kind: Kind
    indices: NDArray[np.int64]
    schedules: dict[int, Schedule]


@dataclass
class Boundaries:
    """All conditions of a model."""

    conditions: list[Condition] = field(default_factory=list)

    def add(self, new: Condition) -> None:
        """Add a condition; raises SelectionError where it contradicts one that is there."""
        for old in self.conditions:
            both = set(old.schedules) & set(new.schedules)
            if old.kind == new.kind == "push" or not both:
                continue
            shared = np.intersect1d(old.indices, new.indices)
            if len(shared):
                raise SelectionError(
                    f"{new.kind} contradicts {old.kind}: both set component {COMPONENTS[min(both)]} of particle "
                    f"{shared[0]} (and {len(shared) - 1} more); leave that component or those particles out of one."
                )
        self.conditions.append(new)

    def groups(self, n: int) -> tuple[NDArray[np.uint32], list[list[Condition]]]:
        """Return the group of each of n particles (n,), and the conditions of each group."""
        member = np.zeros((n, len(self.conditions)), bool)
        for k, condition in enumerate(self.conditions):
            member[condition.indices, k] = True
        free = np.zeros((1, len(self.conditions)), bool)
        keys, group = np.unique(np.concatenate([free, member]), axis=0, return_inverse=True)
        return group.reshape(-1)[1:].astype(np.uint32), [
            [c for c, on in zip(self.conditions, key, strict=True) if on] for key in keys
        ]


class GroupTables:
    """The tables of the groups: the schedules of each, and hold, turn_hold (3, groups), 1 where a component is held."""

    def __init__(self, groups: list[list[Condition]]) -> None:
        self._groups = groups
        held = np.zeros((6, len(groups)))
        for g, conditions in enumerate(groups):
            for condition in conditions:
                if condition.kind != "push":
                    held[list(condition.schedules), g] = 1.0
        self.hold, self.turn_hold = held[:3].copy(), held[3:].copy()

    def schedule(self, start: int, steps: int, dt: float, growing: bool = True) -> Arrays:
        """Return the scheduled fields for `steps` steps of dt [s] from step `start` on: (steps + 1, 3, groups) each.

        growing: whether damage may grow, (steps + 1,).
        """
        times = dt * np.arange(start, start + steps + 2, dtype=np.float64)
        moving, pushing = (np.zeros((steps + 1, 6, len(self._groups))) for _ in range(2))
        for g, conditions in enumerate(self._groups):
            for condition in conditions:
                for c, schedule in condition.schedules.items():
                    if condition.kind == "push":
                        pushing[:, c, g] += schedule.value(times[:-1])
                    elif schedule is not ZERO:
                        moving[:, c, g] = average(schedule, times)
        return {
            "velocity": np.ascontiguousarray(moving[:, :3]),
            "spin": np.ascontiguousarray(moving[:, 3:]),
            "push": np.ascontiguousarray(pushing[:, :3]),
            "push_torque": np.ascontiguousarray(pushing[:, 3:]),
            "growing": np.full(steps + 1, float(growing)),
        }
