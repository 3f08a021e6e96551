"""Geometry of an interface: which pairs cross it, its normal at each, and the area that each pair stands for."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import axis_vector, positive, vector
from pybondem.errors import InputError
from pybondem.model import Model

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Interface(NamedTuple):
    """Pairs (m, 2) across an interface, the unit normals (m, 3) from the first to the second particle of each pair, and
    the areas (m,) [m2] that they stand for, as Model.join takes them; and heights along the axis (m,) [m]."""

    pairs: Ints
    normal: Floats
    area: Floats
    height: Floats


def cylindrical(model: Model, inner: str, outer: str, *, radius: float, length: float, axis: str | ArrayLike = "x",
                base: ArrayLike = (0.0, 0.0, 0.0), gap: float = 0.05) -> Interface:  # fmt: skip
    """Return the interface between a fibre (part `inner`) and the matrix around it (part `outer`).

    Normals are radial at mid-bond. The areas sum to 2 pi radius length exactly: each bond gets the stretch of the
    axis that is nearer to its height than to any other, clipped to the interface [0, length] from `base`, shared with
    the bonds at the same height. The height of a bond is that of its inner particle: a bond that leans across layers
    feels the displacement of the fibre there, and it is the fibre's that varies most along the interface.
    radius, length [m]; gap: see Model.touching. Raises InputError where no pair crosses, or a bond is on the axis.
    """
    radius, length = positive("radius of the interface", radius, "m"), positive("length of the interface", length, "m")
    if inner == outer:
        raise InputError(f"inner and outer part of an interface are both {inner!r}; it needs two parts.")
    along, origin = axis_vector("axis", axis), vector("base", base)
    pairs = model.touching(gap=gap, between=(inner, outer))
    middle = 0.5 * (model.x[pairs[:, 0]] + model.x[pairs[:, 1]]) - origin
    height = (model.x[pairs[:, 0]] - origin) @ along
    inside = (height > -1e-9 * length) & (height < length * (1.0 + 1e-9))
    pairs, middle, height = pairs[inside], middle[inside], height[inside]
    if len(pairs) == 0:
        raise InputError(f"no neighbours cross from part {inner!r} to part {outer!r} between 0 and {length:g} m.")
    radial = middle - (middle @ along)[:, None] * along
    distance = np.linalg.norm(radial, axis=1)
    if distance.min() < 1e-9 * radius:
        k = int(np.argmin(distance))
        raise InputError(f"the bond of particles {pairs[k].tolist()} lies on the axis; its normal has no direction.")
    area = 2.0 * np.pi * radius * stretches(height, length)
    return Interface(pairs, radial / distance[:, None], area, height)


def stretches(height: Floats, length: float) -> Floats:
    """Return the part (m,) [m] of [0, length] that is nearest to each height (m,) [m]; equal heights share it.

    The parts sum to length.
    """
    _, level, count = np.unique(np.round(height / length, 6), return_inverse=True, return_counts=True)
    at = np.clip(np.bincount(level, height) / count, 0.0, length)
    edges = np.concatenate([[0.0], 0.5 * (at[1:] + at[:-1]), [length]])
    return (np.diff(edges) / count)[level]
