"""Findings on what holds for every bond, whatever its law: rest, rigid motion, exchange of ends, axes, momenta."""

import numpy as np
from numpy.typing import NDArray

from pybondem.check import Floats
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.poses import Rigid, cross, random_axes, rotation
from pybondem.laws.subject import Subject
from pybondem.laws.trial import ELEMENTS, TILT, History

Ints = NDArray[np.int64]

ROUND_OFF = 1e-12
SMALL_STRAIN = 1e-4
TURN = 4.0 * np.pi  # two full turns
AXIS = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)  # no axis of the coordinates


def rest(s: Subject) -> Finding:
    """No force acts in an undeformed bond, wherever it is carried as a whole, and a new one is whole."""
    name, tolerance, worst = "rest", 1e-10, 0.0
    for element in ELEMENTS:
        trial = s.trial(element, 1, calm=True)
        damage = float(np.nan_to_num(trial.evaluate(trial.pose(np.zeros(6)), None, 0.0).damages).max())
        if damage > ROUND_OFF:
            sentence = "An undeformed new bond is damaged: damage must begin at 0."
            return failed(name, sentence, f"{element}: no deformation", damage, ROUND_OFF)
        if s.heated:
            return skipped(name, s.heated)
        still = np.zeros((9, 6))
        history = s.trial(element, 8, calm=True).follow(still, s.duration / 8, _turning(9, s.length, s.duration / 8))
        size = np.abs(history.load) / _load_scale(s, element)[:, None]
        worst = max(worst, float(np.nanmax(size, initial=0.0)))
        if not worst <= tolerance:
            where = f"{element}: no deformation"
            sentence = "An undeformed bond carries a load, here as a share of what a small strain makes it carry."
            return failed(name, sentence, where, worst, tolerance)
    sentence = f"An undeformed bond carries no load, wherever it is carried and turned{s.calmed}."
    return passed(name, sentence, worst, tolerance)


def rigid_motion(s: Subject) -> Finding:
    """The load of a deformed bond turns along with it, through two full turns, and nothing drifts."""
    name, tolerance, worst = "rigid motion", 1e-9, 0.0
    for element in ELEMENTS:
        load = s.wander(element, 12, legs=2, steps=6, seed=7)
        path = np.concatenate([load, np.repeat(load[-1:], 36, axis=0)])
        step = s.time_step(path)
        still = s.trial(element, 12).follow(path, step)
        turning = s.trial(element, 12).follow(path, step, _turning(len(path), s.length, step))
        differs = difference(still, turning, s.length)
        worst = max(worst, float(differs.max()))
        if not worst <= tolerance:
            k, pair = first_place(differs > tolerance)
            angle = 360.0 * TURN / (2.0 * np.pi) * k / (len(path) - 1)
            sentence = (
                f"The load changes when the bond is turned as a whole: after {angle:.0f} degrees about a skew axis it "
                "is not that of the bond left unturned. History must be kept in axes that turn with the bond."
            )
            return failed(name, sentence, in_words(path[k, :, pair], element), float(differs[k, pair]), tolerance)
    return passed(name, "The load turns with the bond through two full turns, without drift.", worst, tolerance)


def swap(s: Subject) -> Finding:
    """Which end of a bond comes first makes no difference."""
    name, tolerance, worst = "swap", ROUND_OFF, 0.0
    for element in ELEMENTS:
        path = s.wander(element, 24, seed=9)
        one = s.trial(element, 24).follow(path, s.time_step(path))
        other = s.trial(element, 24, exchanged=True).follow(path, s.time_step(path))
        differs = difference(one, other, s.length)
        worst = max(worst, float(differs.max()))
        if not worst <= tolerance:
            k, pair = first_place(differs > tolerance)
            sentence = "With its two particles exchanged the same bond answers another load: the law prefers one end."
            return failed(name, sentence, in_words(path[k, :, pair], element), float(differs[k, pair]), tolerance)
    return passed(name, "With the two particles exchanged forces and torques are the same.", worst, tolerance)


def frame(s: Subject) -> Finding:
    """The answer depends neither on where the pair points, nor on how the axes across it lie."""
    name, tolerance, worst, sizes, each = "frame", 1e-9, 0.0, 4, 15
    for element in ELEMENTS:
        tilt = TILT if element == "joint" else 0.0
        axes = np.concatenate([_all_axes(each)] * sizes, axis=2)
        path = np.repeat(s.wander(element, sizes, seed=11), each, axis=2)
        history = s.trial(element, sizes * each, axes=axes, tilt=tilt).follow(path, s.time_step(path))
        first = np.repeat(np.arange(sizes) * each, each)  # each is held against the first of its size
        differs = difference(_columns(history, first), history, s.length)
        worst = max(worst, float(differs.max()))
        if not worst <= tolerance:
            k, pair = first_place(differs > tolerance)
            around = differs.reshape(len(path), sizes, 3, each // 3)[:, :, 0].max() > tolerance
            sentence = (
                "The answer depends on the direction of slip or bending across the bond: the law is not isotropic. Let "
                "it depend on s*s + t*t, and its loads point along the slip."
                if around
                else "The answer depends on where the pair points in space, or is another one in a mirror image."
            )
            return failed(name, sentence, in_words(path[k, :, pair], element), float(differs[k, pair]), tolerance)
    return passed(name, "The answer does not depend on where the pair or its axes point.", worst, tolerance)


def momentum(s: Subject) -> Finding:
    """Forces are opposite, and forces and torques together have no moment."""
    name, tolerance, worst = "momentum", ROUND_OFF, 0.0
    for element in ELEMENTS:
        path, trial = s.wander(element, 24, seed=13), s.trial(element, 24)
        for local in path[1:]:
            at = trial.pose(local)
            a = trial.evaluate(at, None, s.time_step(path))
            size = np.abs(a.force_i).max() + np.abs(a.torque_i).max() / s.length
            lever = cross(at.x_j - at.x_i, a.force_j)
            moment = np.abs(a.torque_i + a.torque_j + lever).max(axis=0) / s.length
            force = np.abs(a.force_i + a.force_j).max(axis=0)
            for rest_of, what in (
                (force, "The forces on the two particles are not opposite: the bond pushes itself through space."),
                (moment, "The torques do not balance the forces: a free pair would begin to spin of itself."),
            ):
                share = rest_of / size if size > 0.0 else rest_of
                worst = max(worst, float(share.max()))
                if not worst <= tolerance:
                    pair = int(np.argmax(share))
                    return failed(name, what, in_words(local[:, pair], element), float(share[pair]), tolerance)
    sentence = "Forces are opposite and torques balance them, by construction: no law can change that."
    return passed(name, sentence, worst, tolerance)


# Parts ----------------------------------------------------------------------------------------------------------


def _load_scale(s: Subject, element: str) -> Floats:
    """Return the loads (6,) of the elastic bond at a small strain, or those at the end of the law's reach if larger."""
    kn, ks, kt, kb, _ = s.trial(element, 1).stiffness
    elastic = SMALL_STRAIN * np.array([kn, ks, ks, kt, kb, kb]) * np.repeat([s.length, 1.0], 3)
    elastic[3:] = np.maximum(elastic[3:], s.length * elastic[0])  # joints have no stiffness of their own in rotation
    load: Floats = np.maximum(np.nan_to_num(s.reach[element].stiffness * s.reach[element].end), elastic)
    return load


def _turning(points: int, length: float, dt: float) -> list[Rigid]:
    """Return a rigid motion for each point, dt [s] apart: about a skew axis, by TURN in all, while the pair travels."""
    step, far = TURN / (points - 1), length * np.array([1.0, -2.0, 0.5])
    return [Rigid(rotation(AXIS[:, None] * step * k)[:, 0], far * k / points, AXIS * step / dt) for k in range(points)]


def _all_axes(each: int) -> Floats:
    """Return triads (3, 3, each): one turned about its n, then random ones, then mirror images, a third of each."""
    third = each // 3
    axes = random_axes(2 * third + 1, seed=12)
    n, a, b = axes[:, :, :1]
    angle = 2.0 * np.pi * np.arange(third) / (third + 0.3)
    around = np.stack([n + 0.0 * angle, a * np.cos(angle) + b * np.sin(angle), b * np.cos(angle) - a * np.sin(angle)])
    mirrored = axes[:, :, third + 1 :].copy()
    mirrored[2] *= -1.0
    return np.concatenate([around, axes[:, :, 1 : third + 1], mirrored], axis=2)


def difference(a: History, b: History, length: float) -> Floats:
    """Return by how much two histories differ (points, count), relative to the greatest load of its kind, or in damage.

    Where neither is finite they do not differ: that is for another finding.
    """
    size = np.abs(a.load).max(axis=(0, 2))
    force = float(size[:3].max()) or 1.0
    size = np.maximum(size, force * np.repeat([1e-3, 1e-3 * length], 3))
    differs = (np.abs(a.load - b.load) / size[:, None]).max(axis=1)
    differs = np.maximum(differs, np.abs(a.damages - b.damages).max(axis=1))
    sound = np.isfinite(a.load).all(axis=1)
    return np.where(np.isfinite(differs), differs, np.where(sound, np.inf, 0.0))


def _columns(history: History, which: Ints) -> History:
    """Return a history with some of its pairs, in a new order."""
    return History(*(a[..., which] for a in history))


def first_place(broken: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first point, and a pair, where a rule is broken (points, count)."""
    point = int(np.argmax(broken.any(axis=1)))
    return point, int(np.argmax(broken[point]))
