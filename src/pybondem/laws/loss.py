"""Findings on what a law does along paths: finite answers, damage, dissipation, unloading, closure."""

import numpy as np

from pybondem.check import Floats
from pybondem.laws import paths
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.invariance import first_place
from pybondem.laws.subject import Subject
from pybondem.laws.trial import ELEMENTS


def finite(s: Subject) -> Finding:
    """Loads, damage and memory are numbers along all paths, in large deformations and at exact zeros too."""
    name = "finite"
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            answers = (h.load, h.damages, h.memory, h.lost[:, None])  # lost: where a bond could not take what the law said
            sound = np.all([np.isfinite(a).all(axis=1) for a in answers], axis=0)
            if not sound.all():
                k, pair = first_place(~sound)
                sentence = f"The law returns a number that is not finite, on {path}: look for 0/0, a root or logarithm."
                return failed(name, sentence, in_words(h.local[k, :, pair], element))
    return passed(name, "Loads, damage and memory are finite on all paths, at large deformation and at exact zeros.")


def damage(s: Subject) -> Finding:
    """Damage stays between 0 and 1 and never heals."""
    name, tolerance, worst = "damage", 1e-12, 0.0
    if s.law.kind == "bond" and "damage" not in s.law.memory._fields:
        return skipped(name, "A bond law without a word of memory named damage has none.")
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            D = np.nan_to_num(h.damages)
            over = np.maximum(-D, D - 1.0).max(axis=1)
            healed = np.concatenate([np.zeros((1, D.shape[2])), (D[:-1] - D[1:]).max(axis=1)])
            for amount, sentence in (
                (over, f"Damage leaves the range from 0 to 1, on {path}."),
                (healed, f"Damage falls, on {path}: a bond heals. Keep the largest damage, or what drives it, in memory."),
            ):
                worst = max(worst, float(amount.max()))
                if worst > tolerance:
                    k, pair = first_place(amount > tolerance)
                    return failed(name, sentence, in_words(h.local[k, :, pair], element), float(amount[k, pair]), tolerance)
    return passed(name, "Damage stays between 0 and 1 and never falls.", worst, tolerance)


def dissipation(s: Subject) -> Finding:
    """No step of any path gives energy back, and no closed path yields work."""
    name = "dissipation"
    rough = 0.0 if s.law.kind == "damage" else 1e-3  # the trapezoid rule, where loads are not straight lines
    worst = 0.0
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            size = np.maximum(np.abs(h.work).max(axis=0), _energy_scale(s, element))
            given = np.concatenate([np.zeros((1, len(size))), (h.lost[:-1] - h.lost[1:]) / size])
            given, tolerance = np.nan_to_num(given), rough + 1e-12
            worst = max(worst, float(given.max()))
            if worst > tolerance:
                k, pair = first_place(given > tolerance)
                sentence = (
                    f"The energy that was lost falls in one step on {path}: the bond creates energy, here as a share of the "
                    "work done on it."
                )
                if s.law.kind == "bond" and s.law.potential is None:
                    sentence += " No potential is declared: energy is counted as stored that the loads hold elastically."
                return failed(name, sentence, in_words(h.local[k, :, pair], element), float(given[k, pair]), tolerance)
    return _closed_paths(s, name, worst)


def _closed_paths(s: Subject, name: str, worst: float) -> Finding:
    """Return the finding on dissipation from random paths that come back to their beginning."""
    tolerance, count = 2e-3, 16
    for element in ELEMENTS:
        path = paths.closed(s.sizes(element, count, seed=21), legs=3, steps=40, seed=22)
        h = s.trial(element, count, calm=True).follow(path, s.time_step(path))
        given = np.nan_to_num(-h.work[-1] / np.maximum(np.abs(h.work).max(axis=0), _energy_scale(s, element)))
        if float(given.max()) > tolerance:
            pair = int(np.argmax(given))
            sentence = "A closed path yields work: the bond creates energy, here as a share of the most work done on it."
            far = h.local[int(np.argmax(np.abs(h.work[:, pair]))), :, pair]
            return failed(name, sentence, in_words(far, element), float(given[pair]), tolerance)
        worst = max(worst, float(given.max()))
    return passed(name, "No step of any path and no closed path gives back more energy than was put in.", worst, tolerance)


def unloading(s: Subject) -> Finding:
    """A damaged bond unloads along its secant and comes back to the same load on the same way."""
    name, tolerance, worst, points = "unloading", 1e-9, 0.0, 8
    if s.law.kind == "bond":
        return skipped(name, "A bond law may unload as it likes: only damage laws unload along the secant.")
    if s.law.flows:
        return skipped(name, "The law depends on rates or time: where it unloads to depends on how fast.")
    for element in ELEMENTS:
        target = s.sizes(element, 24, seed=31) * (np.arange(6)[:, None] == np.arange(24) % 6)
        target = np.concatenate([target, s.sizes(element, 8, seed=32) * np.array([[1, 1, 1, 0, 0, 0]]).T], axis=1)
        path = paths.through([0.0 * target, target, 0.0 * target, target], points)
        h = s.trial(element, 32, calm=True).follow(path, s.time_step(path))
        peak = h.damages[points]
        for k in range(points + 1, len(path)):
            grown = np.nan_to_num(np.abs(h.damages[k] - peak).max(axis=0))
            worst = max(worst, float(grown.max()))
            if worst > tolerance:
                pair = int(np.argmax(grown))
                back = "unloading" if k <= 2 * points else "loading again, below the largest deformation so far"
                sentence = (
                    f"Damage changes in {back}: the bond does not unload along the secant to its origin, and comes back "
                    "to another load. What drives damage should be the largest value so far."
                )
                return failed(name, sentence, in_words(path[k, :, pair], element), float(grown[pair]), tolerance)
    return passed(name, "Unloading and loading again follow the secant to the origin.", worst, tolerance)


def closure(s: Subject) -> Finding:
    """A bond pulls back when opened and pushes when pressed together, as stiff as when it was new whatever its damage."""
    name, tolerance, worst = "closure", 1e-9, 0.0
    for element in ELEMENTS:
        found = _signs(s, name, element)
        if found is not None:
            return found
        if s.law.kind == "bond":
            continue
        kn = float(s.trial(element, 1).stiffness[0])
        for path, h in s.driven(element).items():
            n = h.local[:, 0]
            missing = np.where(n < 0.0, np.abs(h.load[:, 0] / (kn * np.where(n < 0.0, n, 1.0)) - 1.0), 0.0)
            missing = np.where(n < -1e-3 * s.reach[element].onset[0], np.nan_to_num(missing), 0.0)
            worst = max(worst, float(missing.max()))
            if worst > tolerance:
                k, pair = first_place(missing > tolerance)
                D = float(h.damage[k, pair])
                sentence = f"A closed bond of damage {D:.3g} does not push back with its full normal stiffness, on {path}."
                where = in_words(h.local[k, :, pair], element)
                return failed(name, sentence, where, float(missing[k, pair]), tolerance)
    return passed(name, "The bond pulls back when opened, and pushes when pressed together, damaged or not.", worst, tolerance)


def _signs(s: Subject, name: str, element: str) -> Finding | None:
    """Return the finding that a normal force has the wrong sign, or is lost in compression after it was torn."""
    sizes, steps = np.geomspace(0.1, 3.0, 12) * s.reach[element].end[0], 10
    pressed = paths.deformation(n=-sizes)
    new = s.trial(element, 12, calm=True).follow(paths.monotone(pressed, steps), s.duration / steps)
    pulled = s.trial(element, 12, calm=True).follow(paths.monotone(-pressed, steps), s.duration / steps)
    torn = s.trial(element, 12, calm=True)
    path = paths.through([0.0 * pressed, -pressed, 0.0 * pressed, pressed], steps)
    after = torn.follow(path, s.duration / len(path))
    scale = _elastic(s, element) * sizes
    for h, wrong, sentence in (
        (new, new.load[1:, 0] >= 0.0, "A bond that is pressed together does not push its particles apart."),
        (pulled, pulled.load[1:, 0] < -1e-9 * scale, "A bond that is opened pushes its particles further apart."),
        (pulled, pulled.load[1:2, 0] <= 0.0, "A new bond that is opened does not pull its particles together."),
    ):
        if wrong.any():
            k, pair = first_place(wrong)
            load = float(h.load[k + 1, 0, pair])
            return failed(name, sentence + f" Its force is {load:.3g} N.", in_words(h.local[k + 1, :, pair], element))
    kept = after.load[-1, 0] / np.where(new.load[-1, 0] < 0.0, new.load[-1, 0], -1.0)
    if float(kept.min()) < 0.99:
        pair = int(np.argmin(kept))
        sentence = (
            f"After it was opened by {sizes[pair]:.3g} m a bond that is pressed together pushes back with only "
            f"{float(kept[pair]):.3g} of the force that it did when new."
        )
        return failed(name, sentence, in_words(after.local[-1, :, pair], element), 1.0 - float(kept[pair]), 0.01)
    return None


# Parts ----------------------------------------------------------------------------------------------------------


def _elastic(s: Subject, element: str) -> float:
    """Return the normal stiffness of a law when new [N/m]."""
    r = s.reach[element]
    return float(r.load[0] / r.end[0])


def _energy_scale(s: Subject, element: str) -> float:
    """Return the elastic energy [J] of opening and slip where the law begins to soften or yield."""
    r = s.reach[element]
    stiffness = r.load / np.where(r.end > 0.0, r.end, 1.0)
    each: Floats = 0.5 * stiffness[:2] * r.onset[:2] ** 2
    return float(each[each > 0.0].min(initial=np.inf)) if (each > 0.0).any() else 1e-300


