"""Dissipation control: the load follows so that each step dissipates the same energy.

Displacement and load of a softening structure may both turn back (snap-back); the energy dissipated never does. Each
step asks for the equilibrium at which damage has taken `energy` more:

    K(D) u = 0,   u = lambda at the end        linear at frozen damage D: one solve gives the shape s of all stretches
    lost(lambda s) = energy                    the law on the way from the last state to lambda s: gives lambda
    D = law(lambda s)                          once more from the top, until D stays

with Anderson's mixing of D (J. ACM 12, 547 (1965)), from damage that goes on to grow where it grew in the step before:
so the path stays on the branch that it has taken where bonds compete. Small displacements; continuous damage. The
idea of the constraint is that of Gutierrez, Commun. Numer. Methods Eng. 20, 19-29 (2004) and Verhoosel, Remmers &
Gutierrez, Int. J. Numer. Methods Eng. 77, 1290-1321 (2009), who put the energy of the whole model, (P1 u2 - P2 u1) / 2,
into Newton's method. Here it is summed over the bonds, so that no tangent is needed, however long a step is.
"""

import time as clocks
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from pybondem.check import finite_array, positive, whole_number
from pybondem.drivers.secant import Committed, Secant
from pybondem.errors import InputError
from pybondem.model import BondSet, Model, Selection
from pybondem.output.progress import Progress
from pybondem.simulation import Interrupted, session

Floats = NDArray[np.float64]
SETTLED = 1e-5  # change of damage at which an iteration ends
ITERATIONS, HALVINGS = 40, 6
JUMP = 1e-2  # of the energy asked for: by which a step may miss it
MOST_FORESEEN = 0.999  # damage that a step starts its iteration from
REMEMBERED = 5  # iterations that Anderson's mixing looks back on
ONSET = (1e-4, 1e-3, 1e-2, 1e-1)  # of the energy of the first step: dissipated first, to find the branch
NEAREST, FARTHEST = 1e-12, 1e2  # displacement over size of the model: where the first damage is looked for
BEYOND = 4.0  # times the displacement before: as far as more energy is looked for
MARCH = 0.02  # growth of the load between two looks at what has been lost
GONE = 1e-3  # of the largest load: below, the path has ended


class PathPoint(NamedTuple):
    """An equilibrium: displacement of the end [m], load on it [N], energy dissipated so far [J]."""

    displacement: float
    load: float
    dissipated: float


@dataclass
class EquilibriumPath:
    """Equilibria from the undeformed model on.

    displacement [m], load [N], dissipated [J]: (k,), the first zero; slip [m], shear [Pa]: (k, m) of the bonds that
    were watched, in the order of their pairs; ended: why there are no more, "steps", "until", "load gone" or
    "exhausted" (less was left to dissipate than a small part of a step); solves: linear solves in all; seconds: wall
    time.
    """

    points: list[PathPoint] = field(default_factory=lambda: [PathPoint(0.0, 0.0, 0.0)], repr=False)
    watched: list[tuple[Floats, Floats]] = field(default_factory=list, repr=False)
    ended: str = "steps"
    solves: int = 0
    seconds: float = 0.0

    @property
    def displacement(self) -> Floats:
        """Displacement of the end (k,) [m]."""
        return np.array([p.displacement for p in self.points])

    @property
    def load(self) -> Floats:
        """Load on the end (k,) [N]."""
        return np.array([p.load for p in self.points])

    @property
    def dissipated(self) -> Floats:
        """Energy dissipated so far (k,) [J]."""
        return np.array([p.dissipated for p in self.points])

    @property
    def slip(self) -> Floats:
        """Slip of the watched bonds (k, m) [m]."""
        return np.array([slip for slip, _ in self.watched])

    @property
    def shear(self) -> Floats:
        """Shear stress of the watched bonds (k, m) [Pa]."""
        return np.array([shear for _, shear in self.watched])

    def plot(self, path: str | Path) -> Path:
        """Draw load against displacement into a PNG (and SVG) file and return its path."""
        from pybondem.output.figures import line_figure

        labels, units = ("displacement of the end", "load"), ("m", "N")
        return line_figure(path, self.displacement, {"load": self.load}, labels=labels, units=units)


def dissipation_control(
    model: Model, end: Selection, axis: str, *, energy: ArrayLike, steps: int | None = None,
    until: Callable[[PathPoint], bool] | None = None, watch: BondSet | None = None, engine: str | None = None,
    threads: int | None = None, quiet: bool = False,
) -> EquilibriumPath:  # fmt: skip
    """Follow the equilibrium path of a model whose end is displaced along x, y or z, through snap-back.

    energy: dissipated in each step [J], one number or one for each step; the first step is taken in several, and any
    that finds no equilibrium in two of half as much; steps: at most so many, by default as many as there are;
    until(point): ends the path; watch: bonds whose slip and shear stress are kept. The path also ends where the load
    has fallen to a thousandth of its peak. What else is fixed or driven stays where it is; dashpots, gravity and the
    speed of drives mean nothing here. Bonds that are equal and equally loaded soften together, though their equilibrium
    may have branches where only some do: let them scatter. Ctrl-C raises Interrupted with the path so far as its
    `found`. Raises InputError where a law is no damage law of the deformation alone, has jumps, or never damages;
    LawError for a damage outside 0 to 1.
    """
    if until is not None and not callable(until):
        raise InputError(f"until of dissipation_control is {until!r}; give a function of a PathPoint.")
    first, rest = _energies(energy, steps)
    began, path = clocks.perf_counter(), EquilibriumPath()
    follow = _Follower(Secant(model, end, axis, engine, threads), path, watch)
    total = len(first) + len(rest) if isinstance(rest, list) else None
    with Progress("equilibrium path", total, len(model), quiet=quiet or session.quiet) as progress:
        try:
            for k, lost in enumerate(chain(first, rest), 1):
                exhausted = follow.step(lost)
                path.seconds = clocks.perf_counter() - began
                if progress.due():
                    progress.update(k)
                path.ended = _why(path, exhausted, until)
                if path.ended != "steps":
                    break
        except KeyboardInterrupt as stop:
            raise Interrupted(f"stopped by hand after {len(path.points) - 1} steps.", path) from stop
    return path


def _why(path: EquilibriumPath, exhausted: bool, until: Callable[[PathPoint], bool] | None) -> str:
    """Return why a path has ended, "steps" where it has not."""
    point = path.points[-1]
    if point.load <= GONE * path.load.max():
        return "load gone"
    if exhausted:
        return "exhausted"
    return "until" if until is not None and until(point) else "steps"


def _energies(energy: ArrayLike, steps: int | None) -> tuple[list[float], Iterable[float]]:
    """Return the energies of the parts of the first step, small ones first, and those of the others [J]."""
    others = None if steps is None else whole_number("steps of dissipation_control", steps) - 1
    rest: Iterable[float]
    if np.ndim(energy) == 0:
        one = positive("energy of dissipation_control", energy, "J")
        rest = repeat(one) if others is None else [one] * others
    else:
        one, *rest = finite_array("energy of dissipation_control", energy, (None,)).tolist() or [0.0]
        if min(one, *rest, np.inf) <= 0.0:
            raise InputError("energy of dissipation_control: give one positive number, or one for each step.")
        rest = rest[:others]
    return [*(share * one for share in ONSET), (1.0 - sum(ONSET)) * one], rest


class _Trial(NamedTuple):
    """A load that loses some energy: factor of the unit response, state of each set, energy lost [J]."""

    factor: float
    states: list[Committed]
    lost: float


class _Follower:
    """Takes one step after another along a path."""

    def __init__(self, secant: Secant, path: EquilibriumPath, watch: BondSet | None) -> None:
        self._secant, self._path = secant, path
        self._watched = next((soft for soft in secant.soft if soft.bonds is watch), None)
        if watch is not None and self._watched is None:
            raise InputError("watch of dissipation_control: these bonds are not of this model, or have no damage law.")
        size = float(np.ptp(secant.model.x, axis=0).max())
        self._factor, self._farthest = NEAREST * size, FARTHEST * size
        self._shapes = [soft.now.stretch for soft in secant.soft]
        self._growth, self._energy = np.zeros_like(self._damage()), 1.0  # of the damage in the step before; its energy
        self._look()

    def _damage(self) -> Floats:
        """Return the damage of all bonds in one row."""
        return np.concatenate([soft.now.damage.ravel() for soft in self._secant.soft])

    def step(self, energy: float, halvings: int = HALVINGS) -> bool:
        """Dissipate so much [J], in one step or, where it does not settle, in two of half as much, and so on.

        Returns whether there is nothing more to dissipate.
        """
        settled = self._settle(energy)
        if settled:
            return False
        if halvings == 0:
            return self._exhausted(settled is None, energy)
        return self.step(0.5 * energy, halvings - 1) or self.step(0.5 * energy, halvings - 1)

    def _exhausted(self, nothing_left: bool, energy: float) -> bool:
        """Return True where a path ends for want of energy; raises InputError where that is not the reason."""
        at = self._path.points[-1]
        if not nothing_left:
            far = f"{at.displacement:.6g} m"
            raise InputError(f"no equilibrium was found beyond a displacement of {far}, in steps of {energy:.3g} J.")
        if at.dissipated == 0.0:
            raise InputError(f"damage cannot even dissipate {energy:.3g} J; lower the energy of dissipation_control.")
        return True

    def _settle(self, energy: float) -> bool | None:
        """Iterate until damage stays, and take what has been found as the next point.

        Returns False where damage does not stay, None where there is not so much to dissipate.
        """
        mixing, change, committed = _Mixing(), 1.0, self._damage()
        foreseen = np.minimum(committed + energy / self._energy * self._growth, MOST_FORESEEN)
        damage = np.maximum(foreseen, committed)
        for _ in range(ITERATIONS):
            stiffness = self._respond(damage, float(np.clip(1e-2 * change, 1e-8, 1e-5)))
            trial = self._loaded(energy)
            if trial is None:
                return None
            now = np.concatenate([state.damage.ravel() for state in trial.states])
            change = float(np.abs(now - damage).max())
            if change < SETTLED:
                self._commit(trial, trial.factor * stiffness)
                return True
            damage = mixing.mixed(damage, now)
        return False

    def _respond(self, damage: Floats, tolerance: float) -> float:
        """Solve at a frozen damage of all sets; returns the load for a unit displacement [N/m]."""
        rows = 0
        for soft, shape in zip(self._secant.soft, self._shapes, strict=True):
            own = soft.now.damage
            soft.soften(damage[rows : rows + own.size].reshape(own.shape), shape)
            rows += own.size
        u, stiffness = self._secant.respond(tolerance)
        self._shapes = [soft.stretch(u) for soft in self._secant.soft]
        self._path.solves += 1
        return stiffness

    def _loaded(self, energy: float) -> _Trial | None:
        """Raise the load at the present shape until so much has been lost [J]; None where it cannot be."""
        begun = self._path.points[-1].dissipated > 0.0
        farthest = BEYOND * self._factor if begun else self._farthest
        committed = [soft.now for soft in self._secant.soft]
        factor, lost, growth = self._factor, energy, 1.0
        while lost >= energy:  # unloaded so far that less is lost
            factor *= 0.5
            states, lost = self._advanced(committed, factor)
        while factor < farthest:
            farther, more = self._advanced(states, (1.0 + growth) * factor)
            if more > 0.0 and growth > MARCH:
                growth = max(0.25 * growth, MARCH)
            elif lost + more >= energy:
                return self._exactly(states, factor, energy, lost)
            else:
                factor, states, lost = (1.0 + growth) * factor, farther, lost + more
                growth = growth if more > 0.0 else min(2.0 * growth, 1.0)
        if lost <= 0.0 and not begun:
            way = f"no bond is damaged at any displacement of the end along +{self._secant.axis}"
            raise InputError(f"{way}; look at the values of the laws, or at the direction.")
        return None

    def _exactly(self, states: list[Committed], factor: float, energy: float, lost: float) -> _Trial:
        """Return the load within one march from `factor` on at which so much has been lost, `lost` of it before."""

        def miss(at: float) -> float:
            return lost + self._advanced(states, at)[1] - energy

        found = float(brentq(miss, factor, (1.0 + MARCH) * factor, xtol=1e-12 * factor, rtol=1e-10))
        reached, more = self._advanced(states, found)
        if abs(lost + more - energy) > JUMP * energy:
            raise InputError(
                f"damage jumps at a displacement of {found:.6g} m, where {lost + more:.3g} J are lost at once and "
                f"{energy:.3g} J were asked for; dissipation control needs laws that soften, such as bilinear."
            )
        return _Trial(found, reached, energy)

    def _advanced(self, states: list[Committed], factor: float) -> tuple[list[Committed], float]:
        """Return what states come to at a multiple of the unit response, and the energy lost on the way [J]."""
        every = zip(self._secant.soft, states, self._shapes, strict=True)
        found = [soft.advanced(state, factor * shape) for soft, state, shape in every]
        return [state for state, _ in found], sum(lost for _, lost in found)

    def _commit(self, trial: _Trial, load: float) -> None:
        """Take what has been found as the next point of the path."""
        before = self._damage()
        for soft, state in zip(self._secant.soft, trial.states, strict=True):
            soft.now = state
        self._growth, self._energy = self._damage() - before, trial.lost
        self._factor = trial.factor
        self._path.points.append(PathPoint(trial.factor, load, self._path.points[-1].dissipated + trial.lost))
        self._look()

    def _look(self) -> None:
        if self._watched is not None:
            self._path.watched.append(self._watched.interface())


class _Mixing:
    """Anderson's mixing: the next trial from the last few, so that the linear part of the change vanishes."""

    def __init__(self) -> None:
        self._tried: list[Floats] = []
        self._changes: list[Floats] = []

    def mixed(self, tried: Floats, came_out: Floats) -> Floats:
        """Return the next damage to try."""
        self._tried = [*self._tried, tried][-REMEMBERED:]
        self._changes = [*self._changes, came_out - tried][-REMEMBERED:]
        if len(self._tried) == 1:
            return came_out
        steps, slopes = (np.diff(np.array(rows), axis=0).T for rows in (self._tried, self._changes))
        weights: Any = np.linalg.lstsq(slopes, self._changes[-1], rcond=1e-10)[0]
        return np.clip(came_out - (steps + slopes) @ weights, 0.0, 1.0)
