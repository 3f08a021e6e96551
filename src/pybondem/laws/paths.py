"""Driven paths: how the ends of a bond are moved to try a law.

A path is an array (steps + 1, 6) of the components n, s, t [m], twist, bend_s, bend_t [rad] (see
`physics.types.Components`), or (steps + 1, 6, count) for many bonds at once. It starts undeformed, unless said.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from pybondem.check import Floats

COMPONENTS = ("n", "s", "t", "twist", "bend_s", "bend_t")


def deformation(n: ArrayLike = 0.0, s: ArrayLike = 0.0, t: ArrayLike = 0.0, twist: ArrayLike = 0.0,
                bend_s: ArrayLike = 0.0, bend_t: ArrayLike = 0.0) -> Floats:  # fmt: skip
    """Return the six components as one array (6,), or (6, count) where some are given for each of many bonds."""
    return np.stack(np.broadcast_arrays(*(np.asarray(c, float) for c in (n, s, t, twist, bend_s, bend_t))))


def through(points: Sequence[ArrayLike], steps: int) -> Floats:
    """Return the path along straight lines through points, each (6,) or (6, count), `steps` to every line."""
    corners = np.stack(np.broadcast_arrays(*(np.asarray(p, float) for p in points)))
    share = np.arange(1, steps + 1).reshape(-1, *(1,) * (corners.ndim - 1)) / steps
    lines = [a + share * (b - a) for a, b in pairwise(corners)]
    return np.concatenate([corners[:1], *lines])


def monotone(target: ArrayLike, steps: int = 100) -> Floats:
    """Return the straight path to a target."""
    return through([np.zeros_like(target, float), target], steps)


def cyclic(target: ArrayLike, cycles: int = 4, steps: int = 20, back: float = 0.0) -> Floats:
    """Return a path that loads and unloads with growing amplitude, in the last cycle to the target.

    steps: of each loading and of each unloading; back: the share of the amplitude to unload to: 0 for full unloading,
    0.5 for half the way, -1 for as much the other way. It ends unloaded.
    """
    far = np.asarray(target, float)
    peaks = [far * (c + 1) / cycles for c in range(cycles)]
    return through([np.zeros_like(far), *(point for peak in peaks for point in (peak, back * peak))], steps)


def reopened(target: ArrayLike, closed: float = 0.5, further: float = 1.5, steps: int = 25) -> Floats:
    """Return a path to a target, back to a closed bond, and out again.

    closed: how far it is pressed together on the way, as a share of the opening; its other components are zero there;
    further: where the path ends, as a multiple of the target.
    """
    far = np.asarray(target, float)
    pressed = np.zeros_like(far)
    pressed[0] = -closed * np.abs(far[0])
    return through([np.zeros_like(far), far, pressed, further * far], steps)


def mixed(angle: ArrayLike, size: ArrayLike, steps: int = 100, about: ArrayLike = 0.0) -> Floats:
    """Return the straight path of mixed mode: opening size cos(angle) [m] and slip size sin(angle) [m], angle in rad.

    about: the direction of the slip, an angle from s towards t [rad].
    """
    slip = np.asarray(size) * np.sin(angle)
    return monotone(deformation(np.asarray(size) * np.cos(angle), slip * np.cos(about), slip * np.sin(about)), steps)


def wandering(scale: ArrayLike, legs: int = 6, steps: int = 10, seed: int = 0) -> Floats:
    """Return a random, non-proportional path: straight lines between points drawn evenly between -scale and scale.

    scale: (6,) or (6, count), the largest size of each component. The same seed gives the same path.
    """
    size = np.asarray(scale, float)
    draw = np.random.default_rng(seed).uniform(-1.0, 1.0, (legs, *size.shape))
    return through([np.zeros_like(size), *(draw * size)], steps)


def closed(scale: ArrayLike, legs: int = 4, steps: int = 50, seed: int = 0) -> Floats:
    """Return a random path that comes back to where it began, undeformed."""
    out = wandering(scale, legs, steps, seed)
    return np.concatenate([out, through([out[-1], np.zeros_like(out[-1])], steps)[1:]])


def finer(path: Floats, parts: int) -> Floats:
    """Return a path with every step divided into equal parts."""
    return through(list(path), parts)
