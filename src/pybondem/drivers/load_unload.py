"""Loading and unloading in turns: the path of a softening structure in explicit dynamics, snap-back included.

Load slowly until damage has grown by a set amount; freeze damage and unload to the start; load again. With damage
frozen a model is elastic, so each reload is straight up to the load at which damage grows on: a point of the path,
wherever the path has turned to. It is the strategy of Dressler & Wilke 2021 (section 3.2). Here the end never jumps
from one velocity to another, damage is frozen by the laws' own answers in the same compiled step, the end comes back to
the very pose from which it started, and what still moves there is measured.
"""

import time as clocks
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.assembly import Drag
from pybondem.check import fraction, positive, whole_number
from pybondem.damping import Kinetic, local
from pybondem.drivers.steered import Steered, steered
from pybondem.errors import InputError
from pybondem.measure import applied, displacement
from pybondem.model import Model, Selection
from pybondem.output.progress import Progress
from pybondem.simulation import Interrupted, Simulation, session

Floats = NDArray[np.float64]
LOOKS = 50  # at load and damage while the velocity of the end goes over from one value to another
BACK = 3.0  # speed of unloading over that of loading
BEGINS = 0.02  # of the growth of a cycle: from here on damage counts as growing again
GONE = 1e-2  # of the largest load: below, the path has ended


class Cycle(NamedTuple):
    """One loading: displacement [m], load [N] and damage measure (k,) of it; k of the envelope point; what was left.

    onset: where damage began to grow; residual: largest displacement left at the start of the next loading [m].
    """

    displacement: Floats
    load: Floats
    measure: Floats
    onset: int
    residual: float


@dataclass
class Envelope:
    """Cycles of loading and unloading, and what they cost: steps, and wall time in seconds."""

    cycles: list[Cycle] = field(default_factory=list)
    steps: int = 0
    seconds: float = 0.0

    @property
    def displacement(self) -> Floats:
        """Displacement of the end at which damage began to grow in each cycle (cycles,) [m]."""
        return np.array([c.displacement[c.onset] for c in self.cycles])

    @property
    def load(self) -> Floats:
        """Load on the end there (cycles,) [N]."""
        return np.array([c.load[c.onset] for c in self.cycles])

    def plot(self, path: str | Path) -> Path:
        """Draw all loadings, and where damage began to grow in each, into a PNG (and SVG) file and return its path."""
        from pybondem.output.figures import INK, PALETTE, axis_label, styled_figure
        from pybondem.output.readable import si_scale

        x, y = (si_scale(float(v.max()), unit)[0] for v, unit in ((self.displacement, "m"), (self.load, "N")))
        with styled_figure(path) as figure:
            axes = figure.add_subplot()
            for cycle in self.cycles:
                axes.plot(x * cycle.displacement, y * cycle.load, color=PALETTE[5], linewidth=0.8)
            axes.plot(x * self.displacement, y * self.load, "o-", color=INK, linewidth=1.4, markersize=5)
            axes.set_xlabel(axis_label("displacement of the end", "m", x))
            axes.set_ylabel(axis_label("load", "N", y))
        return Path(path)


def load_unload(
    model: Model, end: Selection, axis: str, *, growth: float, speed: float, over: float, farthest: float,
    cycles: int = 1000, measure: Callable[[Simulation], float] | None = None, damping: Drag | Kinetic | None = None,
    safety: float = 0.5, engine: str | None = None, threads: int | None = None, quiet: bool = False,
) -> Envelope:  # fmt: skip
    """Trace the load-displacement path of a model by loading and unloading its end along x, y or z.

    growth: of the measure, by which each cycle lets damage grow; measure(simulation): the energy dissipated by damage
    [J] by default, any that never falls; speed: of loading [m/s], unloading is three times as fast; over: time within
    which the end goes over from one velocity to another [s], some transits of a wave through the model; farthest:
    displacement at which loading is given up [m]; cycles: at most so many; damping: local(0.5) by default. What drives
    the end along the axis in the model is left out here. The path ends where a load has fallen to a hundredth of the
    largest, or where damage has not grown so much before `farthest`. Ctrl-C raises Interrupted with what there is as
    its `found`. Raises InputError for bad values, and for bond laws, which cannot be frozen.
    """
    for name, value, unit in (("growth", growth, "1"), ("speed", speed, "m/s"), ("over", over, "s"),
                              ("farthest", farthest, "m")):  # fmt: skip
        positive(f"{name} of load_unload", value, unit)
    whole_number("cycles of load_unload", cycles)
    if measure is not None and not callable(measure):
        raise InputError(f"measure of load_unload is {measure!r}; give a function of the simulation.")
    fraction("safety", safety, 1e-6, 1.0)
    pulled, velocity = steered(model, end, axis)
    sim = Simulation(pulled, damping=damping or local(0.5), safety=safety, engine=engine, threads=threads)
    sim.damage_grows = True  # raises where it cannot be otherwise
    rig = _Rig(sim, velocity, end, axis, measure or dissipated, over)
    began, envelope = clocks.perf_counter(), Envelope()
    with Progress("loading and unloading", None, len(model), quiet=quiet or session.quiet) as progress:
        try:
            for number in range(cycles):
                done = rig.load(speed, growth, farthest)
                rig.unload(BACK * speed)
                if done is not None:
                    envelope.cycles.append(done._replace(residual=rig.residual()))
                envelope.steps, envelope.seconds = sim.step, clocks.perf_counter() - began
                if progress.due():
                    progress.update(number + 1, time=sim.time)
                if done is None or done.load[done.onset] < GONE * envelope.load.max():
                    break
        except KeyboardInterrupt as stop:
            raise Interrupted(f"stopped by hand after {len(envelope.cycles)} cycles.", envelope) from stop
    if not envelope.cycles:
        raise InputError(
            f"damage grew by {rig.grew:.3g} up to a displacement of {farthest:g} m, where {growth:.3g} was asked for; "
            f"raise farthest or lower growth of load_unload."
        )
    return envelope


def dissipated(sim: Simulation) -> float:
    """Return the energy dissipated by damage so far [J]."""
    return float(sum(bonds.total("lost") for bonds in sim.state.bonds.values() if "lost" in bonds))


class _Rig:
    """The machine that pulls: its simulation, and the end that it steers."""

    def __init__(self, sim: Simulation, velocity: Steered, end: Selection, axis: str,
                 measure: Callable[[Simulation], float], over: float) -> None:  # fmt: skip
        self._sim, self._velocity, self._measure = sim, velocity, measure
        self._over = sim.dt * max(LOOKS, round(over / sim.dt))
        self._load, self._displacement = applied(end, axis), displacement(end, axis)
        self._look = round(self._over / sim.dt / LOOKS)
        self._steady = 0.0  # time from which on the velocity of the end is what it was told [s]
        self.grew = 0.0  # the measure, in the last loading

    def _rows(self) -> tuple[float, float, float]:
        sim = self._sim
        return self._displacement.evaluate(sim)[0], self._load.evaluate(sim)[0], self._measure(sim)

    def load(self, speed: float, growth: float, farthest: float) -> Cycle | None:
        """Load until the measure has grown; returns None where it has not at the farthest displacement."""
        sim = self._sim
        sim.damage_grows = True
        rows = [self._rows()]
        before = rows[0][2]
        self._velocity.steer(sim.time, speed, self._over)
        self._steady = sim.time + self._over
        while rows[-1][2] < before + growth:
            self.grew = rows[-1][2] - before
            if rows[-1][0] >= farthest:
                return None
            sim.run(steps=self._look, quiet=True)
            rows.append(self._rows())
        u, load, measure = np.array(rows).T
        onset = int(np.argmax(measure > before + BEGINS * growth))
        return Cycle(u, load, measure, onset, 0.0)

    def unload(self, speed: float) -> None:
        """Go back to the start at frozen damage, without a jump of velocity, and wait for what still moves."""
        sim, over = self._sim, self._over
        sim.damage_grows = False
        if sim.time < self._steady:  # it first comes to the speed that it was told
            sim.run(time=self._steady - sim.time, quiet=True)
        now, forward = sim.time, float(self._velocity.value(np.array([sim.time]))[0])
        away = float(self._velocity.integral(np.array([now]))[0]) + 0.5 * forward * over
        speed = min(speed, away / over)  # so that the two smooth turns have room
        cruise = away / speed - over
        self._velocity.steer(now, -speed, over)
        self._velocity.steer(now + over + cruise, 0.0, over)
        sim.run(time=cruise + 3.0 * over, quiet=True)

    def residual(self) -> float:
        """Return the largest distance of a particle from where it started [m]."""
        p = self._sim.state.particles
        return float(np.sqrt(((p["x"] - p["start"]) ** 2).sum(axis=0).max()))
