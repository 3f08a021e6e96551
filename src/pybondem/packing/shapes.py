"""Shapes to cut packings with: boxes, cylinders, spheres, and what unions, differences and intersections make of them.

    Cylinder(6.0, 35.0, axis="x") - Cylinder(1.0, 30.0, axis="x", base=(5.0, 0.0, 0.0))

**Points on the boundary.** A box, cylinder or sphere holds its faces, and what lies outside by no more than 1e-9 of its
largest finite dimension, so that a lattice point that falls on a face is inside whatever its round-off. `a - b` is the
part of `a` that `b` does not hold: `a & b` and `a - b` share no point and together are `a`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import Axis, Floats, axis_vector, finite_array, finite_number, positive, vector
from pybondem.errors import InputError

TOLERANCE = 1e-9  # of a shape's largest finite dimension: far above round-off, far below a particle
Side = tuple[float | None, float | None] | None
"""Lower and upper limit [m]; None where there is none."""


class Shape(ABC):
    """A region of space. A shape of one's own defines `gap` and `extent`, and is a frozen dataclass if it can be."""

    @abstractmethod
    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,): zero or less inside, never above the distance.

        It may grow no faster than the point moves (Lipschitz constant 1), so that the sphere of radius r about a
        point with a gap above r lies outside.
        """

    @abstractmethod
    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return the interval [m] that holds x . direction for every x inside; direction: (3,), of unit length.

        Exact or wider, but for the tolerance; infinite where the shape has no end, reversed (low > high) where it is
        known to be empty.
        """

    def contains(self, x: ArrayLike, slack: float | Floats = 0.0) -> NDArray[np.bool_]:
        """Return which of the points x (n, 3) [m] are inside, (n,).

        slack: how far outside a point may lie and still count as inside [m], on top of the tolerance of the shape; for
        callers who know a length of their own, such as a lattice spacing. Raises InputError unless x is finite (n, 3).
        """
        return self._holds(finite_array("x of contains", x, (None, 3)), slack)

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the lower and upper corner [m], each (3,), of a box along x, y, z that holds the shape."""
        low, high = np.transpose([self.extent(e) for e in np.eye(3)])
        return low, high

    def _holds(self, x: Floats, slack: float | Floats) -> NDArray[np.bool_]:
        return self.gap(x) <= slack

    def __or__(self, other: "Shape") -> "Union":
        return Union(self, other) if isinstance(other, Shape) else NotImplemented

    def __and__(self, other: "Shape") -> "Intersection":
        return Intersection(self, other) if isinstance(other, Shape) else NotImplemented

    def __sub__(self, other: "Shape") -> "Difference":
        return Difference(self, other) if isinstance(other, Shape) else NotImplemented


@dataclass(frozen=True)
class Box(Shape):
    """A box along x, y, z; x, y, z: (lower, upper) limits [m], None for no limit on that side or on both.

    Raises InputError for a limit that is not a finite number, and where the upper one is below the lower one. A box of
    no thickness is a plane: `Box(z=(0, 0))` holds one layer of a lattice.
    """

    x: Side = None
    y: Side = None
    z: Side = None

    def __post_init__(self) -> None:
        for name in "xyz":
            object.__setattr__(self, name, _side(name, getattr(self, name)))

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        low, high = self._corners()
        farthest = np.full(len(x), -np.inf)
        for k in range(3):
            np.maximum(farthest, np.maximum(low[k] - x[:, k], x[:, k] - high[k]), out=farthest)
        lengths = high - low
        return farthest - TOLERANCE * np.max(lengths, where=np.isfinite(lengths), initial=0.0)

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return the interval [m] of x . direction over the box."""
        along = direction != 0.0  # the others must not make 0 * inf
        a, b = (corner[along] * direction[along] for corner in self._corners())
        return float(np.sum(np.minimum(a, b))), float(np.sum(np.maximum(a, b)))

    def _corners(self) -> tuple[Floats, Floats]:
        sides = [side or (None, None) for side in (self.x, self.y, self.z)]
        low = [-np.inf if lo is None else lo for lo, _ in sides]
        high = [np.inf if hi is None else hi for _, hi in sides]
        return np.array(low), np.array(high)


@dataclass(frozen=True)
class Cylinder(Shape):
    """A round cylinder.

    radius, height [m]; height None: without ends in both directions. axis: "x", "y", "z" or a vector, from the lower
    face to the upper one. base: centre of the lower face [m], or any point of the axis where there are no ends.
    Raises InputError unless radius and height are positive, the axis has a direction and all numbers are finite.
    A tube is the difference of two cylinders.
    """

    radius: float
    height: float | None
    axis: Axis = "z"
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius of Cylinder", self.radius, "m"))
        if self.height is not None:
            object.__setattr__(self, "height", positive("height of Cylinder", self.height, "m"))
        object.__setattr__(self, "axis", tuple(axis_vector("axis of Cylinder", self.axis).tolist()))
        object.__setattr__(self, "base", tuple(vector("base of Cylinder", self.base).tolist()))

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        axis = np.asarray(self.axis, dtype=np.float64)
        arm = x - np.array(self.base)
        along = _dot(arm, axis)
        farthest = _length(arm - along[:, None] * axis) - self.radius
        size = 2.0 * self.radius
        if self.height is not None:
            farthest = np.maximum(farthest, np.maximum(-along, along - self.height))
            size = max(size, self.height)
        return farthest - TOLERANCE * size

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return the interval [m] of x . direction over the cylinder."""
        cosine = float(np.dot(self.axis, direction))
        across = self.radius * float(np.linalg.norm(direction - cosine * np.asarray(self.axis)))  # no cancellation
        foot = float(np.dot(self.base, direction))
        if self.height is None:
            ends = (-np.inf, np.inf) if cosine != 0.0 else (0.0, 0.0)
        else:
            ends = (min(0.0, cosine * self.height), max(0.0, cosine * self.height))
        return foot + ends[0] - across, foot + ends[1] + across


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball; radius, centre [m]. Raises InputError unless the radius is positive and all numbers are finite."""

    radius: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive("radius of Sphere", self.radius, "m"))
        object.__setattr__(self, "centre", tuple(vector("centre of Sphere", self.centre).tolist()))

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        return _length(x - np.array(self.centre)) - self.radius * (1.0 + 2.0 * TOLERANCE)

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return the interval [m] of x . direction over the ball."""
        middle = float(np.dot(self.centre, direction))
        return middle - self.radius, middle + self.radius


@dataclass(frozen=True)
class Union(Shape):
    """What one shape or the other holds: `first | second`."""

    first: Shape
    second: Shape

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        return np.minimum(self.first.gap(x), self.second.gap(x))

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return an interval [m] that holds x . direction for every x inside."""
        found = [e for e in (self.first.extent(direction), self.second.extent(direction)) if e[0] <= e[1]]
        return (min(e[0] for e in found), max(e[1] for e in found)) if found else (np.inf, -np.inf)

    def _holds(self, x: Floats, slack: float | Floats) -> NDArray[np.bool_]:
        return self.first._holds(x, slack) | self.second._holds(x, slack)


@dataclass(frozen=True)
class Intersection(Shape):
    """What both shapes hold: `first & second`."""

    first: Shape
    second: Shape

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        return np.maximum(self.first.gap(x), self.second.gap(x))

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return an interval [m] that holds x . direction for every x inside."""
        a, b = self.first.extent(direction), self.second.extent(direction)
        return max(a[0], b[0]), min(a[1], b[1])

    def _holds(self, x: Floats, slack: float | Floats) -> NDArray[np.bool_]:
        return self.first._holds(x, slack) & self.second._holds(x, slack)


@dataclass(frozen=True)
class Difference(Shape):
    """What the first shape holds and the second does not: `first - second`, without the surface of the second."""

    first: Shape
    second: Shape

    def gap(self, x: Floats) -> Floats:
        """Return how far outside the points x (n, 3) lie [m], (n,)."""
        return np.maximum(self.first.gap(x), -self.second.gap(x))

    def extent(self, direction: Floats) -> tuple[float, float]:
        """Return an interval [m] that holds x . direction for every x inside."""
        return self.first.extent(direction)

    def _holds(self, x: Floats, slack: float | Floats) -> NDArray[np.bool_]:
        return self.first._holds(x, slack) & ~self.second._holds(x, slack)


def _side(name: str, side: Any) -> Side:
    if side is None:
        return None
    if isinstance(side, str) or not hasattr(side, "__len__") or len(side) != 2:
        raise InputError(f"{name} of Box is {side!r}; it must be (lower, upper) in m, None for no limit.")
    low, high = (None if v is None else finite_number(f"{name} of Box", v, "m") for v in tuple(side))
    if low is not None and high is not None and high < low:
        raise InputError(
            f"{name} of Box runs from {low:g} m to {high:g} m; the upper limit must not be below the lower."
        )
    return low, high


def _dot(x: Floats, direction: Floats) -> Floats:
    """Return x . direction term by term: the same bits for any number of rows, which BLAS does not promise."""
    return x[:, 0] * direction[0] + x[:, 1] * direction[1] + x[:, 2] * direction[2]


def _length(x: Floats) -> Floats:
    return np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2 + x[:, 2] ** 2)
