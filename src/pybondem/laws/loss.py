"""Findings on what a law does along paths: finite answers, damage, dissipation, unloading, closure."""

import numpy as np

from pybondem.check import Floats
from pybondem.laws import paths
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.invariance import first_place
from pybondem.laws.subject import Subject
from pybondem.laws.trial import ELEMENTS, History

CYCLE = 2e-3  # share of the work that may come back, where it is integrated in steps
FINER = 2  # how often steps are divided by four: what comes back only because of them falls by that, or more


def finite(s: Subject) -> Finding:
    """Loads, damage and memory are numbers along all paths, in large deformations and at exact zeros too."""
    name = "finite"
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            answers = (h.load, h.damages, h.memory, h.lost[:, None])  # a bond that cannot take an answer loses "nan"
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
                (
                    healed,
                    f"Damage falls, on {path}: a bond heals. Keep its largest value, or what drives it, in memory.",
                ),
            ):
                worst = max(worst, float(amount.max()))
                if worst > tolerance:
                    k, pair = first_place(amount > tolerance)
                    where = in_words(h.local[k, :, pair], element)
                    return failed(name, sentence, where, float(amount[k, pair]), tolerance)
    return passed(name, "Damage stays between 0 and 1 and never falls.", worst, tolerance)


def dissipation(s: Subject) -> Finding:
    """No path gives back energy that was lost, and no closed path yields work."""
    name, worst = "dissipation", 0.0
    tolerance = 1e-12 if s.law.kind == "damage" else CYCLE  # what a bond law loses is integrated by the trapezoid rule
    for element in ELEMENTS:
        for path, coarse in s.driven(element).items():
            h, given = coarse, _given_back(s, element, coarse)
            falls = False
            for _ in range(FINER if s.law.kind == "bond" else 0):
                if float(given.max()) <= tolerance:
                    break
                h = s.followed(element, paths.finer(h.local, 4))
                given, coarser = _given_back(s, element, h), given
                falls = float(given.max()) < 0.4 * float(coarser.max())
            if float(given.max()) > tolerance and not falls:
                pair = int(np.argmax(given.max(axis=0)))
                k = int(np.argmax(given[:, pair] > 0.5 * given[:, pair].max()))
                sentence = (
                    f"The energy lost falls on {path}: the bond creates energy, here as a share of the work done on it."
                )
                if s.law.kind == "bond" and s.law.potential is None:
                    sentence += " Without a declared potential the energy sum Q*Q/2k counts as stored."
                return failed(name, sentence, in_words(h.local[k, :, pair], element), float(given[k, pair]), tolerance)
            worst = max(worst, 0.0 if falls else float(given.max()))
    return _closed_paths(s, name, worst)


def _given_back(s: Subject, element: str, h: History) -> Floats:
    """Return the energy that was lost before and is no longer (points, count), as a share of the most work done."""
    lost = np.where(np.isfinite(h.lost), h.lost, np.inf)  # what is not finite is for another finding
    size = np.maximum(np.abs(np.nan_to_num(h.work)).max(axis=0), _energy_scale(s, element))
    given: Floats = np.nan_to_num(np.maximum.accumulate(lost, axis=0) - lost) / size
    return given


def _closed_paths(s: Subject, name: str, worst: float) -> Finding:
    """Return the finding on dissipation from random paths that come back to their beginning."""
    tolerance, count = CYCLE, 16
    for element in ELEMENTS:
        path = paths.closed(s.sizes(element, count, seed=21), legs=3, steps=40, seed=22)
        h = s.followed(element, path)
        given = np.nan_to_num(-h.work[-1] / np.maximum(np.abs(h.work).max(axis=0), _energy_scale(s, element)))
        if float(given.max()) > tolerance:
            pair = int(np.argmax(given))
            sentence = "A closed path yields work: the bond creates energy, here as a share of the work done on it."
            far = h.local[int(np.argmax(np.abs(h.work[:, pair]))), :, pair]
            return failed(name, sentence, in_words(far, element), float(given[pair]), tolerance)
        worst = max(worst, float(given.max()))
    sentence = f"No path gives back what was lost, and no closed path yields work{s.calmed}."
    return passed(name, sentence, worst, tolerance)


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
                    f"Damage changes in {back}: the bond does not unload along the secant to its origin and come back "
                    "to the same load. What drives damage should be the largest value so far."
                )
                return failed(name, sentence, in_words(path[k, :, pair], element), float(grown[pair]), tolerance)
    return passed(name, "Unloading and loading again follow the secant to the origin.", worst, tolerance)


def closure(s: Subject) -> Finding:
    """A bond pulls back when opened and pushes when pressed together, whatever its damage as stiff as when new."""
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
            missing = np.where(n < -1e-6 * s.length, np.nan_to_num(missing), 0.0)  # closer by, round-off
            worst = max(worst, float(missing.max()))
            if worst > tolerance:
                k, pair = first_place(missing > tolerance)
                D = float(h.damage[k, pair])
                sentence = f"A closed bond of damage {D:.3g} does not push with its full normal stiffness, on {path}."
                where = in_words(h.local[k, :, pair], element)
                return failed(name, sentence, where, float(missing[k, pair]), tolerance)
    return passed(
        name, "The bond pulls when opened and pushes when pressed together, damaged or not.", worst, tolerance
    )


def _signs(s: Subject, name: str, element: str) -> Finding | None:
    """Return the finding that a normal force has the wrong sign, or is lost in compression after it was torn."""
    sizes, steps = np.geomspace(0.1, 3.0, 12) * s.reach[element].end[0], 10
    pressed = paths.deformation(n=-sizes)
    new = s.trial(element, 12, calm=True).follow(paths.monotone(pressed, steps), s.duration / steps)
    pulled = s.trial(element, 12, calm=True).follow(paths.monotone(-pressed, steps), s.duration / steps)
    torn = s.trial(element, 12, calm=True)
    path = paths.through([0.0 * pressed, -pressed, 0.0 * pressed, pressed], steps)
    after = torn.follow(path, s.duration / len(path))
    scale = float(torn.stiffness[0]) * sizes
    for h, wrong, sentence in (
        (new, new.load[1:, 0] >= 0.0, "A bond that is pressed together does not push its particles apart."),
        (pulled, pulled.load[1:, 0] < -1e-9 * scale, "A bond that is opened pushes its particles further apart."),
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
            f"{max(0.0, float(kept[pair])):.3g} of the force that it did when new."
        )
        return failed(name, sentence, in_words(after.local[-1, :, pair], element), 1.0 - float(kept[pair]), 0.01)
    return None


# Parts ----------------------------------------------------------------------------------------------------------


def _energy_scale(s: Subject, element: str) -> float:
    """Return the elastic energy [J] of opening or slip where the law begins to soften or yield, the smaller one."""
    normal_and_shear = s.trial(element, 1).stiffness[:2]
    return float((0.5 * normal_and_shear * s.reach[element].onset[:2] ** 2).min())
