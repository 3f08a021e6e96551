"""Spheres: where they are and how large."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pybondem.check import Axis, Floats, axis_vector, finite_array, finite_number, positive, positive_array, vector
from pybondem.errors import InputError
from pybondem.packing.shapes import TOLERANCE, Shape


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Particles:
    """Spheres in the order given; `a + b` lists those of b after those of a.

    x: centres [m], (n, 3); radius [m], (n,) or one number for all. Both are copied to read-only float64 arrays;
    narrower numbers are taken over exactly. Raises InputError for no particle, shapes that do not match, values that
    are masked, not numbers or not finite, and for a radius that is not positive (naming the particle).
    """

    x: Floats
    radius: Floats

    def __init__(self, x: ArrayLike, radius: ArrayLike) -> None:
        centres = finite_array("x of Particles", x, (None, 3))
        if len(centres) == 0:
            raise InputError("x of Particles is empty; give at least one particle.")
        if np.ndim(radius) == 0:
            radii = np.full(len(centres), positive("radius of Particles", radius, "m"))
        else:
            radii = positive_array("radius of Particles", radius, (None,), "m")
        if len(radii) != len(centres):
            raise InputError(f"Particles got {len(centres)} centres and {len(radii)} radii; give one radius each.")
        for name, array in (("x", centres), ("radius", radii)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.radius)

    def __add__(self, other: "Particles") -> "Particles":
        if not isinstance(other, Particles):
            return NotImplemented
        return Particles(np.concatenate([self.x, other.x]), np.concatenate([self.radius, other.radius]))

    def __repr__(self) -> str:
        low, high = np.min(self.radius), np.max(self.radius)
        radius = f"radius {low:g} m" if low == high else f"radius {low:g} to {high:g} m"
        return f"<Particles: {len(self)}, {radius}>"

    def cut(self, inside: Shape) -> "Particles":
        """Return the particles whose centres a shape holds (to 1e-9 of their diameter), in the same order.

        Raises InputError where there is none.
        """
        if not isinstance(inside, Shape):
            raise InputError(f"inside of cut is {inside!r}; it must be a shape such as Box, Cylinder or Sphere.")
        kept = inside.contains(self.x, slack=2.0 * TOLERANCE * self.radius)
        if not np.any(kept):
            raise InputError(f"No centre of the {len(self)} particles lies inside {inside!r}.")
        return Particles(self.x[kept], self.radius[kept])

    def moved(self, by: ArrayLike) -> "Particles":
        """Return the particles moved by a vector [m], (3,). Raises InputError unless it is finite."""
        return Particles(self.x + vector("by of moved", by), self.radius)

    def turned(self, axis: Axis, angle: float, about: ArrayLike = (0.0, 0.0, 0.0)) -> "Particles":
        """Return the particles turned right-handedly by `angle` [rad] about an axis through the point `about` [m].

        Raises InputError for an axis without direction and for values that are not finite.
        """
        k, centre = axis_vector("axis of turned", axis), vector("about of turned", about)
        angle = finite_number("angle of turned", angle, "rad")
        arm = self.x - centre
        along = np.outer(arm @ k, k)
        turned = along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(k, arm)  # formula of Rodrigues
        return Particles(centre + turned, self.radius)
