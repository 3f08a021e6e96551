"""Findings on what a law does along paths: finite answers, damage, dissipation, unloading, closure."""

import numpy as np

from pybondem.check import Floats
from pybondem.laws import paths
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.invariance import first_place
from pybondem.laws.poses import motions
from pybondem.laws.steps import told
from pybondem.laws.subject import SIZES, Subject
from pybondem.laws.trial import ELEMENTS, History

ROUND_OFF = 1e-12
CYCLE = 2e-3  # share of the work that may come back, where it is integrated in steps
PRESSED = 1e-9  # damage of a bond that is only pressed together
FINER = 2  # how often steps are divided by four: what comes back only because of them falls by that, or more


def finite(s: Subject) -> Finding:
    """Loads, damage and memory are numbers along all paths, in large deformations and at exact zeros too."""
    name = "finite"
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            answers = (h.load, h.damages, h.memory, h.lost[:, None])  # a bond that cannot take an answer loses "nan"
            sound = np.all([np.isfinite(a).all(axis=1) for a in answers], axis=0)
            if not sound.all():
                sound |= np.maximum.accumulate(_out_of_range(_own_damages(s, h)) > ROUND_OFF, axis=0)
            if not sound.all():
                k, pair = first_place(~sound)
                sentence = f"The law returns a number that is not finite, on {path}: look for 0/0, a root or logarithm."
                return failed(name, sentence, in_words(h.local[k, :, pair], element))
        found = _in_no_time(s, name, element)
        if found is not None:
            return found
    sentence = (
        "Loads, damage and memory are finite on all paths, at large deformation and at exact zeros, and for dt = 0."
    )
    return passed(name, sentence)


def _in_no_time(s: Subject, name: str, element: str) -> Finding | None:
    """Return the finding that an answer for dt = 0 is not finite: new, moved at once, and on its way."""
    targets = s.sizes(element, 12, seed=15)
    trial = s.trial(element, 12)
    new, moved, further = (trial.pose(share * targets) for share in (0.0, 0.6, 1.0))
    step = s.duration / 10
    moving = motions(moved, further, step, None)
    for at, motion, dt, share in ((new, None, 0.0, 0.0), (moved, None, 0.0, 0.6), (further, moving, step, 1.0),
                                  (further, moving, 0.0, 1.0), (further, None, 0.0, 1.0)):  # fmt: skip
        a = trial.evaluate(at, motion, dt)
        told = (a.force_j, a.torque_j, a.damages, a.lost[None], *(word[None] for word in a.memory.values()))
        sound = np.all([np.isfinite(part).all(axis=0) for part in told], axis=0)
        if not sound.all():
            sentence = (
                "The law returns a number that is not finite for dt = 0, with which loads are evaluated when a "
                "simulation starts and after edits. Where it divides by dt to get a speed, let it read rate."
            )
            return failed(name, sentence, in_words(share * targets[:, int(np.argmin(sound))], element))
    return None


def damage(s: Subject) -> Finding:
    """Damage stays between 0 and 1 and never heals."""
    name, tolerance, worst = "damage", ROUND_OFF, 0.0
    if s.law.kind == "bond" and "damage" not in s.law.memory._fields:
        return skipped(name, "A bond law without a word of memory named damage has none.")
    for element in ELEMENTS:
        for path, h in s.driven(element).items():
            D = h.damages if np.isfinite(h.lost).all() else _own_damages(s, h)
            over, D = _out_of_range(D), np.nan_to_num(D)
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
    """No path gives back energy that was lost, and no closed path yields work.

    What a bond law holds at every moment is known by its potential only: without one closed paths alone are looked at.
    """
    name, worst = "dissipation", 0.0
    if s.heated:
        return skipped(name, s.heated)
    if s.law.kind == "bond" and s.law.potential is None:
        found = _closed_paths(s, name, worst)
        sentence = f"No closed path yields work{s.calmed}. Declare a potential to have each step looked at."
        return found if found.verdict == "failed" else skipped(name, sentence)
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
        h, given = _yield(s, element, path)
        if float(given.max()) > tolerance:  # if the trapezoid rule is to blame, it is less so in shorter steps
            (h, given), coarser = _yield(s, element, paths.finer(path, 4)), given
            given = np.where(given < 0.4 * coarser, 0.0, given)
        if float(given.max()) > tolerance:
            pair = int(np.argmax(given))
            sentence = "A closed path yields work: the bond creates energy, here as a share of the work done on it."
            far = h.local[int(np.argmax(np.abs(h.work[:, pair]))), :, pair]
            return failed(name, sentence, in_words(far, element), float(given[pair]), tolerance)
        worst = max(worst, float(given.max()))
    sentence = f"No path gives back what was lost, and no closed path yields work{s.calmed}."
    return passed(name, sentence, worst, tolerance)


def _yield(s: Subject, element: str, path: Floats) -> tuple[History, Floats]:
    """Return the answers along a closed path, and the work that it yields as a share of the most work done (count,)."""
    h = s.followed(element, path)
    given: Floats = np.nan_to_num(-h.work[-1] / np.maximum(np.abs(h.work).max(axis=0), _energy_scale(s, element)))
    return h, given


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
                if _tires(s, element, target[:, [pair]]):
                    sentence = (
                        "Damage goes on growing in equal cycles, as fatigue does: where such a bond unloads to changes "
                        "from cycle to cycle."
                    )
                    return skipped(name, sentence)
                back = "unloading" if k <= 2 * points else "loading again, below the largest deformation so far"
                sentence = (
                    f"Damage changes in {back}: the bond does not unload along the secant to its origin and come back "
                    "to the same load. What drives damage should be the largest value so far."
                )
                return failed(name, sentence, in_words(path[k, :, pair], element), float(grown[pair]), tolerance)
    return passed(name, "Unloading and loading again follow the secant to the origin.", worst, tolerance)


def _tires(s: Subject, element: str, target: Floats) -> bool:
    """Return whether damage at the peaks of equal cycles grows in every one, by smaller deformations if need be."""
    sizes = target * np.geomspace(0.03, 1.0, 12)
    path = paths.through([0.0 * sizes, *(corner for _ in range(5) for corner in (sizes, 0.0 * sizes))], 4)
    at_peaks = s.trial(element, 12, calm=True).follow(path, s.time_step(path)).damages[4::8]
    growth = np.diff(at_peaks, axis=0)[1:]  # the first growth may be that of a mistake in unloading
    return bool((growth > 1e-9).all(axis=0).any())


def closure(s: Subject) -> Finding:
    """A bond pulls back when opened and pushes when pressed together, whatever its damage as stiff as when new."""
    name, tolerance, worst = "closure", 1e-9, 0.0
    for element in ELEMENTS:
        found = None if s.heated else _signs(s, name, element)
        found = found or _pressed(s, name, element)
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
    sizes = np.geomspace(0.1, 3.0, 12) * s.reach[element].end[0]
    steps = 20 if s.law.flows else 10  # short enough for what is integrated forwards in time
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


def _pressed(s: Subject, name: str, element: str) -> Finding | None:
    """Return the finding that a new bond is damaged when it is only pressed together, more than it is by time."""
    sizes, steps = np.concatenate([[0.0], SIZES]) * s.length, 4
    path = paths.monotone(paths.deformation(n=-sizes), steps)
    h = s.trial(element, len(sizes), calm=True).follow(path, s.duration / steps)
    more = np.nan_to_num(h.damages - h.damages[:, :, :1]).max(axis=1)
    if not float(more.max()) > PRESSED:
        return None
    k, pair = first_place(more > PRESSED)
    sentence = (
        "A bond that is only pressed together is damaged: look for a wrong sign of the opening, negative in closure. "
        "What damages a closed bond is slip, twist or bending."
    )
    return failed(name, sentence, in_words(path[k, :, pair], element), float(more[k, pair]), PRESSED)


# Parts ----------------------------------------------------------------------------------------------------------


def _own_damages(s: Subject, h: History) -> Floats:
    """Return the damages (points, modes, count) as the law returns them: a bond does not take every one of them."""
    return told(s, h.local, s.time_step(h.local)).answer if s.law.kind == "damage" else h.damages


def _out_of_range(damages: Floats) -> Floats:
    """Return by how much damages (points, modes, count) are below 0 or above 1 (points, count), 0 for no number."""
    D = np.where(np.isfinite(damages), damages, 0.0)
    over: Floats = np.maximum(-D, D - 1.0).max(axis=1)
    return over


def _energy_scale(s: Subject, element: str) -> float:
    """Return the elastic energy [J] of opening or slip where the law begins to soften or yield, the smaller one."""
    normal_and_shear = s.trial(element, 1).stiffness[:2]
    return float((0.5 * normal_and_shear * s.reach[element].onset[:2] ** 2).min())
