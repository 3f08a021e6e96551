"""The finding on the time step: the same motion in shorter steps has the same answer, and no time does no damage."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pybondem.check import Floats
from pybondem.engines.reference import on_arrays
from pybondem.laws import paths
from pybondem.laws.findings import Finding, failed, in_words, passed, skipped
from pybondem.laws.scaling import seen
from pybondem.laws.subject import FIRST, Subject
from pybondem.physics.types import Damage, Loads, Stiffness

LEVELS = 5  # each in steps half as long as those of the one before
STEPS = 4  # of every leg of the path, in the longest steps
PACES = (1.0, 1e-3, 1e-6, 1e3)  # durations, as shares of that of other paths
EACH, MIXED = 6, 12  # motions in each mode alone, and in all at once
CLOSE, FALLS = 1e-2, 0.5  # mean difference that may be left, or its share of the first one: steps are 8 times shorter
FEW = 0.1  # share of motions that may not: a break that one step just reaches and another just does not
BLOWN_UP = 1e3  # growth of loads in shorter steps: an integration that is unstable so slowly driven
AGAIN = 1e-9  # damage from an evaluation in no time


class Told(NamedTuple):
    """What a law answered (points, numbers, count), and how far damage grew when it was asked again (points, count)."""

    answer: Floats
    grown: Floats


def time_step(s: Subject) -> Finding:
    """The same motion in shorter and shorter steps has one answer, and a second evaluation in no time changes none."""
    name, worst, settled = "time step", 0.0, False
    targets = _targets(s)
    for pace in PACES if s.law.flows else (1.0,):
        levels = [_path(targets, STEPS * 2**level) for level in range(LEVELS)]
        runs = [told(s, path, pace * s.time_step(path)) for path in levels]
        last, apart = _apart(s, runs, targets)
        settled = settled or bool(np.isfinite(last).any())
        worst = max(worst, float(np.nanmax(np.where(apart, 0.0, last), initial=0.0)))
        if np.count_nonzero(apart) > FEW * len(last):
            k = int(np.argmax(apart))  # in a single mode, if it is seen there
            sentence = (
                f"The same motion in steps of {_span(s, pace, LEVELS - 1)} and of {_span(s, pace, LEVELS - 2)} has "
                "different answers, which come no closer in shorter steps. What grows in time must grow by its rate "
                "times dt, and nothing may count evaluations."
            )
            return failed(name, sentence, in_words(targets[:, k], "bond"), float(last[k]), CLOSE)
        grown = runs[1].grown
        if float(grown.max(initial=0.0)) > AGAIN:
            at, k = map(int, np.unravel_index(int(np.argmax(grown)), grown.shape))
            sentence = (
                "Evaluated again at the same deformation, in no time (dt = 0), the bond is damaged further. Loads are "
                "evaluated so when a simulation starts and after edits."
            )
            where = in_words(levels[1][at, :, k], "bond")
            return failed(name, sentence, where, float(grown[at, k]), AGAIN)
    if not settled:
        return skipped(name, "The answers are not finite, or blow up in such steps: see the other findings.")
    return passed(name, "The same motion in shorter steps comes to the same answer, and no time does no damage.", worst)


def _span(s: Subject, pace: float, level: int) -> str:
    return f"{pace * s.duration / (5 * STEPS * 2**level):.2g} s"


def _targets(s: Subject) -> Floats:
    """Return deformations (6, count) in each mode and in all, from far below what matters to the law to beyond it."""
    end = 1.2 * s.reach["bond"].end
    alone = np.zeros((6, len(FIRST), EACH))
    for mode, component in enumerate(FIRST):
        alone[component, mode] = end[component] * np.geomspace(1e-3, 1.0, EACH)
    share = np.geomspace(1e-3, 1.0, MIXED) * np.random.default_rng(71).uniform(0.3, 1.0, (6, MIXED))
    return np.concatenate([alone.reshape(6, -1), end[:, None] * share], axis=1)


def _path(targets: Floats, steps: int) -> Floats:
    """Return out, a rest, back, the other way, and out again, (points, 6, count)."""
    return paths.through([0.0 * targets, targets, targets, 0.0 * targets, -0.7 * targets, targets], steps)


def told(s: Subject, path: Floats, dt: float) -> Told:
    """Return what the law itself tells along a path (points, 6, count), dt [s] from point to point.

    It is called without a bond around it, which would refuse some of its answers: first in no time, and twice at every
    point.
    """
    law, count = on_arrays(s.calm.function), path.shape[2]
    sizes = s.trial("bond", 1).stiffness
    k = Stiffness(*map(np.float64, sizes[:4]))
    p = type(s.calm.parameters)(*map(np.float64, s.calm.parameters))
    words = s.calm.memory._fields
    memory, still = s.calm.memory(*np.zeros((len(words), count))), 0.0 * path[0]
    answers, grown = [], []
    for n, local in enumerate(path):
        d, rate = seen(s, local, (local - path[n - 1]) / dt if n else still, sizes)
        with np.errstate(all="ignore"):
            answer, kept = law(d, k, memory, p, rate, np.float64(dt if n else 0.0))
            memory = s.calm.memory(*(np.broadcast_to(word, count) for word in kept))
            again, more = law(d, k, memory, p, rate, np.float64(0.0))
        answers.append(_numbers(answer, count))
        grown.append(_damage(again, more, words, count) - _damage(answer, kept, words, count))
    return Told(np.stack(answers), np.nan_to_num(np.stack(grown), posinf=0.0, neginf=0.0))


def _numbers(answer: Any, count: int) -> Floats:
    """Return the numbers of an answer (numbers, count)."""
    numbers = answer if isinstance(answer, Damage | Loads) else (answer,)
    return np.stack([np.broadcast_to(np.asarray(v, float), count) for v in numbers])


def _damage(answer: Any, kept: Any, words: tuple[str, ...], count: int) -> Floats:
    """Return the damage in an answer, or in the word of memory of that name, 0 where there is none (count,)."""
    if not isinstance(answer, Loads):
        return _numbers(answer, count).max(axis=0)
    return np.broadcast_to(np.asarray(kept[words.index("damage")] if "damage" in words else 0.0, float), (count,))


def _apart(s: Subject, runs: list[Told], targets: Floats) -> tuple[Floats, Any]:
    """Return the mean difference between the two finest runs (count,), nan where there is no telling, and whether it
    neither is small nor has fallen."""
    scale = _scale(s, runs, targets)
    off = []
    with np.errstate(all="ignore"):
        for coarse, fine in pairwise(runs):
            between = paths.through(list(coarse.answer), 2)  # straight from point to point
            off.append(np.nan_to_num((np.abs(fine.answer - between) / scale).mean(axis=0).max(axis=0), nan=np.inf))
        growth = np.abs(runs[-1].answer).max(axis=(0, 1)) / np.abs(runs[0].answer).max(axis=(0, 1))
    sound = np.isfinite(runs[-1].answer).all(axis=(0, 1)) & np.isfinite(off[-1]) & ~(growth > BLOWN_UP)
    last = np.where(sound, off[-1], np.nan)
    return last, sound & (off[-1] > CLOSE) & (off[-1] > FALLS * off[0])


def _scale(s: Subject, runs: list[Told], targets: Floats) -> Floats:
    """Return what differences are relative to (numbers, count): 1 for damage, the largest load of its kind."""
    if s.law.kind == "damage":
        return np.ones(runs[0].answer.shape[1:])
    normal = float(s.trial("bond", 1).stiffness[0])
    least = 1e-6 * normal * np.maximum(np.abs(targets[:3]).max(axis=0), s.length * np.abs(targets[3:]).max(axis=0))
    size = np.nan_to_num(np.max([np.abs(r.answer).max(axis=0) for r in runs[-2:]], axis=0))
    force = np.maximum(size[:3].max(axis=0), least)
    moment = np.maximum(size[3:].max(axis=0), 1e-3 * s.length * force)
    return np.repeat([force, moment], 3, axis=0)
