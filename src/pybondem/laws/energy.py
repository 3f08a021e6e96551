"""Findings on energy: the fracture energy of full failure, and loads as the gradient of a declared potential."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pybondem.check import Floats
from pybondem.engines.reference import on_arrays
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.subject import FIRST, SIZES, Subject, first
from pybondem.laws.trial import ELEMENTS, History
from pybondem.physics.types import ComponentRates, Components, Stiffness

ENERGY_MODES = ("opening", "slip")
FAILED = 1e-5  # share of the greatest load below which a bond has failed
FINEST = 5e-5  # share of the work that one step may be uncertain by
ROUNDS, PARTS = 4, 12  # how often, and into how many, a step is divided that is too coarse


def toughness(s: Subject) -> Finding:
    """The work to full failure is what the bond books as lost, and what the law declares as fracture energy."""
    name, tolerance, worst, found = "toughness", 1e-3, 0.0, []
    declared = s.law.declared
    for mode in declared.toughness:
        if mode not in ENERGY_MODES:
            sentence = f"A fracture energy is declared in {mode!r}; it can be in {' or '.join(ENERGY_MODES)}."
            return failed(name, sentence)
    if s.heated:
        return skipped(name, s.heated)
    for element in ELEMENTS:
        for mode, component in zip(ENERGY_MODES, FIRST, strict=False):
            promised = declared.toughness.get(mode)
            h = _to_failure(s, element, component)
            if h is not None and not np.isfinite(h.lost).all():
                continue  # for another finding
            if h is None:
                if promised is not None:
                    sentence = f"A fracture energy in {mode} is declared, but the bond does not fail in {mode}."
                    return failed(name, sentence, in_words(_largest(s, component), element))
                continue
            trial = s.trial(element, 1, calm=True)
            area = float(trial.stiffness[4])
            per_area, booked = float(h.work[-1, 0]) / area, float(h.lost[-1, 0]) / area
            comparisons = [(booked, "is booked as lost")]
            if promised is not None:
                k = float(trial.stiffness[component]) / area
                comparisons.append((float(promised(s.calm.parameters, k)), "the law declares"))
            for other, words in comparisons:
                off = abs(per_area / other - 1.0) if other else np.inf
                worst = max(worst, off)
                if not off <= tolerance:
                    sentence = f"To fail in {mode} takes a work of {per_area:.5g} J/m2, and {other:.5g} J/m2 {words}."
                    return failed(name, sentence, in_words(h.local[-1, :, 0], element), off, tolerance)
            agreed = "" if promised is None else ", as declared"
            found.append(f"{per_area:.5g} J/m2 in {mode} of a {element}{agreed}")
    if not found:
        return skipped(name, "The bond does not fail, in opening or slip, so far as it was driven.")
    return passed(name, f"The work to failure is the energy lost: {'; '.join(found)}.", worst, tolerance)


def _largest(s: Subject, component: int) -> Floats:
    local = np.zeros(6)
    local[component] = SIZES[-1] * s.length
    return local


def _to_failure(s: Subject, element: str, component: int) -> History | None:
    """Return the answers of one pair driven to failure in one component, finely; None where it does not fail."""
    onset, end = s.reach[element].onset[component], 1.5 * s.reach[element].end[component]
    rise, fall = np.linspace(0.0, onset, 6), np.geomspace(onset, end, 50)
    coarse = np.concatenate([rise, fall[1:], np.geomspace(end, SIZES[-1] * s.length, 30)[1:]])
    h = _along(s, element, component, coarse)
    load = np.abs(h.load[:, component, 0])
    gone = np.flatnonzero(load > FAILED * load.max())
    if not load.max() > 0.0 or gone[-1] + 2 >= len(coarse):
        return None
    sizes = coarse[: gone[-1] + 3]
    for _ in range(ROUNDS):
        h = _along(s, element, component, sizes)
        unsure = _uncertainty(sizes, h.load[:, component, 0]) > FINEST * max(float(h.work[-1, 0]), 1e-300)
        if not unsure.any() or len(sizes) > 2000:
            break
        finer = [np.linspace(a, b, PARTS + 1)[1:-1] for a, b in zip(sizes[:-1][unsure], sizes[1:][unsure], strict=True)]
        sizes = np.sort(np.concatenate([sizes, *finer]))
    return h


def _uncertainty(size: Floats, load: Floats) -> Floats:
    """Return how wrong the trapezoid rule may be in each step [J]: where a step continues neither of its neighbours."""
    step, rise = np.diff(size), np.diff(load)
    slope = rise / step
    before, after = np.concatenate([slope[:1], slope[:-1]]), np.concatenate([slope[1:], slope[-1:]])
    bound: Floats = 0.5 * step * np.minimum(np.abs(rise - before * step), np.abs(rise - after * step))
    bound[0] = bound[-1] = 0.0  # one neighbour only: undeformed, and failed
    return bound


def _along(s: Subject, element: str, component: int, sizes: Floats) -> History:
    path = np.zeros((len(sizes), 6, 1))
    path[:, component, 0] = sizes
    return s.trial(element, 1, calm=True).follow(path, s.time_step(path))


def potential(s: Subject) -> Finding:
    """The loads of a bond law are the gradient of its declared potential at frozen memory."""
    name, tolerance, worst = "potential", 1e-6, 0.0
    if s.law.kind == "damage":
        return skipped(name, "The load of a damage law is the gradient of the elastic energy at frozen damage.")
    if s.law.potential is None:
        return skipped(name, "The law declares no potential.")
    law, energy = on_arrays(s.law.function), on_arrays(s.law.potential)
    trial = s.trial("bond", 1)
    k, area = Stiffness(*trial.stiffness[:4]), float(trial.stiffness[4])
    p, dt = _as_floats(s.law.parameters), s.duration / 60
    path = s.wander("bond", 4, legs=6, steps=4, seed=41)
    for pair in range(path.shape[2]):
        memory = s.law.memory(*np.zeros(len(s.law.memory._fields)))
        step, before = 1e-5 * np.abs(path[:, :, pair]).max(axis=0), np.zeros(6)
        for local in path[1:, :, pair]:
            n, slip_s, slip_t, twist, bend_s, bend_t = map(np.float64, local)
            at = Components(n, slip_s, slip_t, twist, bend_s, bend_t, s.length, area)
            rates = ComponentRates(*((local - before) / dt))
            for moving in (rates, ComponentRates(*np.zeros(6))):  # then at rest, where dashpots are silent
                loads, words = law(at, k, memory, p, moving, dt)
                memory = s.law.memory(*map(first, words))
            before, force = local, np.array([first(load) for load in loads])
            slope = _slope(partial(_held, energy, k, memory, p), at, step)
            off = np.abs(slope - force) * step / max(float((np.abs(force) * step).max()), 1e-300)
            worst = max(worst, float(off.max()))
            if not worst <= tolerance:
                c = int(np.argmax(off))
                sentence = (
                    f"The load {Components._fields[c]} is {force[c]:.6g}, but the slope of the declared potential at "
                    f"frozen memory is {slope[c]:.6g}."
                )
                return failed(name, sentence, in_words(local, "bond"), float(off[c]), tolerance)
    return passed(name, "The loads are the gradient of the declared potential.", worst, tolerance)


def _held(energy: Callable[..., Any], k: Stiffness, memory: Any, p: Any, d: Components) -> Any:
    """Return an energy at a deformation d, memory held."""
    return energy(d, k, memory, p)


def _slope(energy: Callable[[Components], Any], at: Components, step: Floats) -> Floats:
    """Return the derivatives of an energy by the six components, by central differences (6,)."""
    slopes = []
    for name, h in zip(Components._fields, step, strict=False):
        here = getattr(at, name)
        up, down = (first(energy(at._replace(**{name: here + x}))) for x in (h, -h))
        slopes.append((up - down) / (2.0 * h))
    return np.array(slopes)


def _as_floats(values: Any) -> Any:
    return type(values)(*(np.float64(v) for v in values))
