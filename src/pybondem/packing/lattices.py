"""Regular packings of equal spheres that touch their neighbours.

The three lattices are rows in layers. In the frame (along the row, across it, along the axis), in diameters, site
(i, j, k) lies at

    ((i + (j + k) mod 2 / 2) a,  (j + (k mod 2) s) b,  k c)

with the steps a, b, c and the shift s of every other layer as listed in HCP, FCC and SC. Sites come layer by layer
along the axis, in a layer row by row, in a row along the row: the same arguments give the same bits in the same order.
"""

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import Axis, Floats, axis_vector, positive, vector, whole_number
from pybondem.errors import InputError
from pybondem.packing.particles import Particles
from pybondem.packing.shapes import TOLERANCE, Box, Shape

RUN = 8  # sites of a row that are kept or dropped at once before each is looked at
MOST_SITES = 10**8  # more than that is a slip of units, not a packing
COARSEST = 1e-6  # spacing of doubles, in diameters, above which positions are no longer those of a lattice
PARALLEL = 1e-6  # sine of the angle to the axis below which a row has no direction across it


class Lattice(NamedTuple):
    """Steps along the row, across it and along the axis, in diameters; whether rows alternate; shift of layers."""

    steps: tuple[float, float, float]
    staggered: bool
    shift: float


class Runs(NamedTuple):
    """Runs of sites: first and last indices (i, j, k), each (m, 3), both included."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]


HCP = Lattice((1.0, sqrt(3.0) / 2.0, sqrt(2.0 / 3.0)), True, 1.0 / 3.0)
FCC = Lattice((sqrt(2.0), 1.0 / sqrt(2.0), 1.0 / sqrt(2.0)), True, 0.0)
SC = Lattice((1.0, 1.0, 1.0), False, 0.0)


@dataclass(frozen=True)
class Grid:
    """A lattice at a place: diameter and origin [m], frame: rows are the unit vectors along the three steps."""

    lattice: Lattice
    diameter: float
    origin: Floats
    frame: Floats

    def local(self, sites: NDArray[np.int64]) -> Floats:
        """Return the places of sites (n, 3) in the frame, from the origin [m], (n, 3)."""
        i, j, k = sites.T
        a, b, c = (self.diameter * step for step in self.lattice.steps)
        stagger = 0.5 * ((j + k) % 2) if self.lattice.staggered else 0.0
        return np.stack([(i + stagger) * a, (j + self.lattice.shift * (k % 2)) * b, k * c], axis=1)

    def place(self, local: Floats) -> Floats:
        """Return places in space [m], (n, 3), term by term, so that the bits do not depend on the number of rows."""
        e, x = self.frame, local
        return self.origin + (x[:, 0:1] * e[0] + x[:, 1:2] * e[1] + x[:, 2:3] * e[2])


def hcp(
    diameter: float,
    inside: Shape,
    axis: Axis = "z",
    origin: ArrayLike = (0.0, 0.0, 0.0),
    row: Axis | None = None,
) -> Particles:
    """Return the hexagonal close packing of spheres whose centres a shape holds.

    diameter [m]; axis: the stacking (c) axis, normal to the close-packed layers; origin [m]: where a sphere is;
    row: direction of the close-packed rows, of which the part across the axis counts. By default rows run along the
    coordinate after the one nearest to the axis: x for "z", y for "x", z for "y". Layers are sqrt(2/3) d apart, every
    sphere touches 12 others, and the volume per sphere is d^3 / sqrt(2).

    Raises InputError for values out of range, a shape without end, and where no sphere is inside.
    """
    return _packing("hcp", HCP, diameter, inside, axis, origin, row)


def fcc(
    diameter: float,
    inside: Shape,
    axis: Axis = "z",
    origin: ArrayLike = (0.0, 0.0, 0.0),
    row: Axis | None = None,
) -> Particles:
    """Return the face-centred cubic packing of spheres whose centres a shape holds.

    axis: direction [001]; row: direction [100] (its part across the axis), so that by default the edges of the cube,
    of length sqrt(2) d, lie along x, y, z. Every sphere touches 12 others, and the volume per sphere is d^3 / sqrt(2).
    Arguments and errors otherwise as for `hcp`.
    """
    return _packing("fcc", FCC, diameter, inside, axis, origin, row)


def sc(
    diameter: float,
    inside: Shape,
    axis: Axis = "z",
    origin: ArrayLike = (0.0, 0.0, 0.0),
    row: Axis | None = None,
) -> Particles:
    """Return the simple cubic packing of spheres whose centres a shape holds.

    axis: direction [001]; row: direction [100] (its part across the axis). Every sphere touches 6 others, and the
    volume per sphere is d^3. Arguments and errors otherwise as for `hcp`.
    """
    return _packing("sc", SC, diameter, inside, axis, origin, row)


def line(
    count: int,
    spacing: float,
    direction: Axis = "x",
    start: ArrayLike = (0.0, 0.0, 0.0),
    diameter: float | None = None,
) -> Particles:
    """Return `count` equal spheres in a row: sphere k is at start + k spacing direction.

    spacing [m] between neighbours; start [m]: where the first sphere is; diameter [m]: the spacing by default, so that
    neighbours touch. Raises InputError for values out of range.
    """
    n = whole_number("count of line", count)
    step = positive("spacing of line", spacing, "m")
    size = step if diameter is None else positive("diameter of line", diameter, "m")
    along, first = axis_vector("direction of line", direction), vector("start of line", start)
    _check_resolution("spacing of line", step, np.max(np.abs(first)) + n * step)
    return Particles(first + np.outer(np.arange(n) * step, along), 0.5 * size)


def _packing(
    name: str, lattice: Lattice, diameter: float, inside: Shape, axis: Axis, origin: ArrayLike, row: Axis | None
) -> Particles:
    d = positive(f"diameter of {name}", diameter, "m")
    if not isinstance(inside, Shape):
        raise InputError(f"inside of {name} is {inside!r}; it must be a shape such as Box, Cylinder or Sphere.")
    grid = Grid(lattice, d, vector(f"origin of {name}", origin), _frame(name, axis, row))
    low, high = inside.bounds()
    empty = bool(np.any(low > high))
    for k in range(3):
        if not empty and not np.isfinite([low[k], high[k]]).all():
            raise InputError(f"inside of {name} has no end along {'xyz'[k]}; cut it with a Box that has limits there.")
    x = np.empty((0, 3)) if empty else _sites_inside(name, grid, inside)
    if len(x) == 0:
        raise InputError(
            f"{name} has no sphere of diameter {d:g} m centred inside {inside!r}; enlarge the shape or move the origin."
        )
    return Particles(x, 0.5 * d)


def _frame(name: str, axis: Axis, row: Axis | None) -> Floats:
    """Return the unit vectors (3, 3) along the row, across it and along the axis: right-handed."""
    c = axis_vector(f"axis of {name}", axis)
    a = np.eye(3)[(np.argmax(np.abs(c)) + 1) % 3] if row is None else axis_vector(f"row of {name}", row)
    a = a - np.dot(a, c) * c
    if np.linalg.norm(a) < PARALLEL:
        raise InputError(f"row of {name} is along the axis; it must have a part across it.")
    a = a / np.linalg.norm(a)
    a = a - np.dot(a, c) * c  # once more: what round-off has left along the axis
    a = a / np.linalg.norm(a)
    return np.stack([a, np.cross(c, a), c])


def _check_resolution(name: str, spacing: float, farthest: float) -> None:
    gap = float(np.spacing(farthest))
    if not gap <= COARSEST * spacing:
        raise InputError(
            f"{name} is {spacing:g} m, too small for coordinates up to {farthest:g} m, where doubles are {gap:.2g} m "
            "apart; move the packing to the origin or check the units."
        )


def _sites_inside(name: str, grid: Grid, inside: Shape) -> Floats:
    """Return the places of the sites that the shape holds [m], (n, 3), in order."""
    farthest = float(np.max(np.abs([*inside.bounds(), grid.origin])))
    _check_resolution(f"diameter of {name}", grid.diameter, farthest)
    slack = TOLERANCE * grid.diameter + 4.0 * float(np.spacing(farthest))
    runs = _runs_near(name, grid, inside, slack)
    kept = [np.empty((0, 3))]
    for start in range(0, len(runs.first), 2**14):
        first, last = runs.first[start : start + 2**14], runs.last[start : start + 2**14]
        lengths = last[:, 0] - first[:, 0] + 1
        sites = np.repeat(first, lengths, axis=0)
        sites[:, 0] += np.arange(len(sites)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        x = grid.place(grid.local(sites))
        kept.append(x[inside.contains(x, slack)])
    return np.concatenate(kept)


def _runs_near(name: str, grid: Grid, inside: Shape, slack: float) -> Runs:
    """Return short runs of sites that may be inside, in order: boxes of sites, halved again and again.

    A box is dropped as soon as the shape is farther from its middle than half its diagonal.
    """
    steps = grid.diameter * np.array(grid.lattice.steps)
    first, last = _index_box(grid, inside, slack, steps)
    found = Runs(*np.empty((2, 0, 3), dtype=np.int64))
    while len(first):
        ends = first * steps, (last + np.array([0.5, grid.lattice.shift, 0.0])) * steps
        half = 0.5 * np.linalg.norm(ends[1] - ends[0], axis=1)
        gap = inside.gap(grid.place(0.5 * (ends[0] + ends[1])))
        certain = np.sum(np.prod(last - first + 1.0, axis=1), where=gap <= -half)
        if certain + RUN * (len(first) + len(found.first)) > MOST_SITES:
            raise InputError(
                f"{name} would have more than {MOST_SITES:.0e} spheres of diameter {grid.diameter:g} m; check that the "
                "diameter and the shape are both in metres."
            )
        near = gap <= half * (1.0 + TOLERANCE) + slack
        first, last = first[near], last[near]
        sides = (last - first) * steps
        sides[last[:, 0] - first[:, 0] < RUN, 0] = 0.0
        whole = np.max(sides, axis=1, initial=0.0) == 0.0
        found = Runs(*(np.concatenate([a, b[whole]]) for a, b in zip(found, (first, last), strict=True)))
        first, last = _halved(first[~whole], last[~whole], np.argmax(sides[~whole], axis=1))
    order = np.lexsort(found.first.T)
    return Runs(found.first[order], found.last[order])


def _index_box(grid: Grid, inside: Shape, slack: float, steps: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and last indices, each (1, 3), of a box of sites that holds the shape; (0, 3) if it is empty."""
    low, high = inside.bounds()
    bounded = inside & Box(*zip(low.tolist(), high.tolist(), strict=True))  # the tighter of both in every direction
    extents = np.array([bounded.extent(e) for e in grid.frame]) - (grid.frame @ grid.origin)[:, None]
    extents += np.array([-slack, slack])
    first = np.floor(extents[:, 0] / steps).astype(np.int64)
    last = np.floor(extents[:, 1] / steps).astype(np.int64) + 1  # one to spare: the tolerance of a very large shape
    count = int(np.all(first <= last))
    return np.tile(first, (count, 1)), np.tile(last, (count, 1))


def _halved(
    first: NDArray[np.int64], last: NDArray[np.int64], side: NDArray[np.intp]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return boxes cut in two across the given side."""
    box = np.arange(len(first))
    middle = (first[box, side] + last[box, side]) // 2
    lower, upper = last.copy(), first.copy()
    lower[box, side], upper[box, side] = middle, middle + 1
    return np.concatenate([first, upper]), np.concatenate([lower, last])
