"""The model: what is there. Particles in named parts, bonds between them, and boundary conditions."""

import difflib
import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.bonds import Bond, Joint
from pybondem.boundaries import COMPONENTS, ZERO, Boundaries, Condition
from pybondem.check import finite_array, positive
from pybondem.errors import InputError, SelectionError
from pybondem.neighbours import pairs_within
from pybondem.packing import Particles
from pybondem.schedules import Schedule, as_schedule

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Selection:
    """Some particles of a model: `indices`, ascending. Combine with & (both), | (either), - (without)."""

    def __init__(self, indices: Ints, name: str) -> None:
        self.indices = indices
        self.name = name

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"<{self.name}: {len(self)} particles>"

    def __and__(self, other: "Selection") -> "Selection":
        return Selection(np.intersect1d(self.indices, other.indices), f"({self.name} & {other.name})")

    def __or__(self, other: "Selection") -> "Selection":
        return Selection(np.union1d(self.indices, other.indices), f"({self.name} | {other.name})")

    def __sub__(self, other: "Selection") -> "Selection":
        return Selection(np.setdiff1d(self.indices, other.indices), f"({self.name} - {other.name})")


class BondSet(NamedTuple):
    """One call of bond or join: pairs (m, 2), the bond, and for joints the unit normals (m, 3) and areas (m,) [m2]."""

    pairs: Ints
    bond: Bond | Joint
    normal: Floats | None = None
    area: Floats | None = None


class Model:
    """Particles, parts, bonds and boundary conditions.

    Model(particles, density) makes one part, "body"; Model() is empty and grows with `add`. Positions in metres,
    density in kg/m3. Raises InputError for bad values.
    """

    def __init__(self, particles: Particles | None = None, density: float | None = None, name: str = "body") -> None:
        self.x: Floats = np.empty((0, 3))
        self.radius: Floats = np.empty(0)
        self.density: Floats = np.empty(0)
        self.part_of: NDArray[np.int32] = np.empty(0, np.int32)
        self.parts: list[str] = []
        self.bonds: list[BondSet] = []
        self.boundaries = Boundaries()
        self._bonded: Ints = np.empty(0, np.int64)
        if particles is not None:
            if density is None:
                raise InputError("Model needs a density [kg/m3] for its particles: Model(particles, density=2500.0).")
            self.add(particles, name=name, density=density)

    def __len__(self) -> int:
        return len(self.x)

    # Particles --------------------------------------------------------------------------------------------------

    def add(self, particles: Particles, name: str, density: float) -> Selection:
        """Add a part: its particles, a new name, density [kg/m3]; returns its particles.

        Parts come before bonds: raises InputError for a name that is taken, a density that is not positive, or a
        particle at the very place of another.
        """
        if not isinstance(particles, Particles):
            raise InputError(f"part {name!r} needs Particles (see pybondem.packing), got {type(particles).__name__}.")
        if name in self.parts:
            raise InputError(f"part {name!r} is there already; give each part a name of its own.")
        density = positive(f"density of part {name!r}", density, "kg/m3")
        first = len(self)
        self.x = np.concatenate([self.x, particles.x])
        self.radius = np.concatenate([self.radius, particles.radius])
        self.density = np.concatenate([self.density, np.full(len(particles), density)])
        self.part_of = np.concatenate([self.part_of, np.full(len(particles), len(self.parts), np.int32)])
        self.parts.append(name)
        return Selection(np.arange(first, len(self)), name)

    @property
    def mass(self) -> Floats:
        """Mass of each particle (n,) [kg]."""
        return 4.0 / 3.0 * np.pi * self.radius**3 * self.density

    @property
    def inertia(self) -> Floats:
        """Moment of inertia of each particle (n,) [kg m2], that of a solid sphere."""
        return 0.4 * self.mass * self.radius**2

    def part(self, name: str) -> Selection:
        """Return the particles of a part; raises SelectionError with the nearest names where there is none."""
        if name not in self.parts:
            near = difflib.get_close_matches(str(name), self.parts, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(map(repr, self.parts)) or 'no parts'}."
            raise SelectionError(f"no part is named {name!r}; {hint}")
        return Selection(np.flatnonzero(self.part_of == self.parts.index(name)), name)

    def where(self, x: Any = None, y: Any = None, z: Any = None, part: str | None = None, inside: Any = None) -> Selection:
        """Return the particles whose centres lie within all the given ranges.

        x, y, z: (low, high) [m], None for no limit, ends included; part: name; inside: a shape. Raises SelectionError
        where no particle is found.
        """
        mask = np.ones(len(self), bool)
        said = []
        for axis, limits in enumerate((x, y, z)):
            if limits is None:
                continue
            low, high = _limits("xyz"[axis], limits)
            mask &= (self.x[:, axis] >= low) & (self.x[:, axis] <= high)
            said.append(f"{'xyz'[axis]} in ({low:g}, {high:g}) m")
        if part is not None:
            mask[np.setdiff1d(np.arange(len(self)), self.part(part).indices)] = False
            said.append(f"part {part!r}")
        if inside is not None:
            mask &= inside.contains(self.x)
            said.append("the shape")
        name = " and ".join(said) or "all"
        if not mask.any():
            span = ", ".join(f"{a} from {lo:g} to {hi:g} m" for a, lo, hi in zip("xyz", *self._span(), strict=False))
            raise SelectionError(f"no particle lies within {name}; the model spans {span}.")
        return Selection(np.flatnonzero(mask), name)

    def select(self, particles: ArrayLike) -> Selection:
        """Return the particles with the given indices, or where the given mask (n,) is true."""
        array = np.asarray(particles)
        indices = np.flatnonzero(array) if array.dtype == bool else _indices("selection", array, len(self))
        if array.dtype == bool and array.shape != (len(self),):
            raise InputError(f"the mask has shape {array.shape}; it must be ({len(self)},), one value per particle.")
        if len(indices) == 0:
            raise SelectionError("the selection is empty.")
        return Selection(np.unique(indices), "selection")

    def _span(self) -> tuple[Floats, Floats]:
        return (self.x.min(axis=0), self.x.max(axis=0)) if len(self) else (np.empty(0), np.empty(0))

    # Bonds ------------------------------------------------------------------------------------------------------

    def touching(self, gap: float = 0.05, part: str | None = None, between: tuple[str, str] | None = None) -> Ints:
        """Return the pairs (m, 2) of neighbours whose surfaces are at most gap * (Ri + Rj) apart.

        part: only within this part; between: only across these two parts, the first of each pair in the first. Raises InputError for a gap below zero or
        two particles at the same place, SelectionError for an unknown part.
        """
        if not np.isfinite(gap) or gap < 0.0:
            raise InputError(f"gap of touching is {gap}; it must be a number from 0 up (a fraction of Ri + Rj).")
        pairs = pairs_within(self.x, self.radius, float(gap))
        a, b = self.part_of[pairs[:, 0]], self.part_of[pairs[:, 1]]
        if part is not None:
            self.part(part)
            pairs = pairs[(a == self.parts.index(part)) & (b == self.parts.index(part))]
        if between is not None:
            first, second = (self.parts.index(p) for p in between if self.part(p) is not None)
            forth, back = (a == first) & (b == second), (a == second) & (b == first)
            pairs = np.where(back[:, None], pairs[:, ::-1], pairs)[forth | back]
        return pairs

    def bond(self, pairs: ArrayLike, bond: Bond) -> BondSet:
        """Bond the pairs (m, 2) of particles.

        Raises InputError for an index out of range, a particle bonded with itself or twice with another, and
        coincident centres; warns where there are no pairs, or bonds much longer than Ri + Rj.
        """
        if not isinstance(bond, Bond):
            raise InputError(f"bond needs a Bond, got {type(bond).__name__}; joints go to Model.join.")
        return self._add(BondSet(self._pairs(pairs), bond))

    def join(self, pairs: ArrayLike, joint: Joint, normal: ArrayLike, area: ArrayLike) -> BondSet:
        """Join the pairs (m, 2) across an interface.

        normal (m, 3): unit normals of the interface from the first to the second of each pair (brought to unit
        length); area (m,) or one number [m2]: the interface area that each joint stands for. Raises as `bond` does.
        """
        if not isinstance(joint, Joint):
            raise InputError(f"join needs a Joint, got {type(joint).__name__}; bonds go to Model.bond.")
        checked = self._pairs(pairs)
        m = len(checked)
        N = finite_array("normal of join", normal, (m, 3))
        size = np.linalg.norm(N, axis=1)
        if np.any(size == 0.0):
            raise InputError(f"normal[{int(np.argmin(size))}] of join is zero; it must have a direction.")
        A = finite_array("area of join", np.broadcast_to(np.asarray(area), (m,)) if np.ndim(area) == 0 else area, (m,))
        if np.any(A <= 0.0):
            k = int(np.argmax(A <= 0.0))
            raise InputError(f"area[{k}] of join is {A[k]:g} m2; it must be positive.")
        return self._add(BondSet(checked, joint, N / size[:, None], A))

    def _pairs(self, pairs: ArrayLike) -> Ints:
        array = np.asarray(pairs)
        if array.size == 0:
            return np.empty((0, 2), np.int64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise InputError(f"bond pairs have shape {array.shape}; it must be (m, 2), two particle indices per bond.")
        checked = _indices("bond", array, len(self))
        if np.any(checked[:, 0] == checked[:, 1]):
            k = int(np.argmax(checked[:, 0] == checked[:, 1]))
            raise InputError(f"bond {k} joins particle {checked[k, 0]} with itself; a bond needs two particles.")
        return checked

    def _add(self, new: BondSet) -> BondSet:
        if len(new.pairs) == 0:
            warnings.warn("no bonds were made: there are no pairs; a larger gap in touching finds more.", stacklevel=3)
            return new
        low_high = np.sort(new.pairs, axis=1)
        key = (low_high[:, 0] << 32) + low_high[:, 1]
        everything = np.concatenate([self._bonded, key])
        values, count = np.unique(everything, return_counts=True)
        if np.any(count > 1):
            i, j = divmod(int(values[np.argmax(count > 1)]), 1 << 32)
            raise InputError(f"particles {i} and {j} are bonded twice; a pair may have one bond.")
        distance = np.linalg.norm(self.x[new.pairs[:, 1]] - self.x[new.pairs[:, 0]], axis=1)
        touching = self.radius[new.pairs].sum(axis=1)
        if np.any(distance < 1e-9 * touching):
            k = int(np.argmin(distance / touching))
            raise InputError(f"bond {k} joins particles {new.pairs[k].tolist()} at the same place; its length is zero.")
        ratio = distance / touching
        if ratio.max() > 1.5 or ratio.min() < 0.5:
            k = int(np.argmax(np.abs(np.log(ratio))))
            warnings.warn(
                f"bond {k} is {ratio[k]:.3g} times as long as Ri + Rj of particles {new.pairs[k].tolist()}.", stacklevel=3
            )
        self._bonded = everything
        self.bonds.append(new)
        return new

    # Boundary conditions ----------------------------------------------------------------------------------------

    def fix(self, where: Selection, components: str | Iterable[str] = "x y z rx ry rz") -> None:
        """Hold components of the selected particles: displacements x, y, z and rotations rx, ry, rz ("x y z")."""
        names = components.split() if isinstance(components, str) else list(components)
        for name in names:
            if name not in COMPONENTS:
                raise InputError(f"fix knows no component {name!r}; choose among {', '.join(COMPONENTS)}.")
        self._condition("fix", where, {name: ZERO for name in names})

    def drive(self, where: Selection, *, vx: Any = None, vy: Any = None, vz: Any = None,
              wx: Any = None, wy: Any = None, wz: Any = None) -> None:  # fmt: skip
        """Prescribe velocities [m/s] and spins [rad/s] of the selected particles: numbers or schedules."""
        self._condition("drive", where, _given("drive", (vx, vy, vz, wx, wy, wz), ("vx", "vy", "vz", "wx", "wy", "wz")))

    def push(self, where: Selection, *, fx: Any = None, fy: Any = None, fz: Any = None,
             tx: Any = None, ty: Any = None, tz: Any = None) -> None:  # fmt: skip
        """Put a force [N] and torque [N m] on each of the selected particles: numbers or schedules."""
        self._condition("push", where, _given("push", (fx, fy, fz, tx, ty, tz), ("fx", "fy", "fz", "tx", "ty", "tz")))

    def _condition(self, kind: Any, where: Selection, schedules: dict[str, Schedule]) -> None:
        if not isinstance(where, Selection):
            raise InputError(f"{kind} needs a Selection (Model.where, part or select), got {type(where).__name__}.")
        if len(where) == 0:
            raise SelectionError(f"{kind} was given {where!r}; the selection is empty.")
        if not schedules:
            raise InputError(f"{kind} was given no component; name at least one.")
        by_index = {COMPONENTS.index(name): s for name, s in schedules.items()}
        self.boundaries.add(Condition(kind, where.indices, by_index))


def _given(kind: str, values: tuple[Any, ...], names: tuple[str, ...]) -> dict[str, Schedule]:
    """Return the schedules of the components that were given."""
    return {
        component: as_schedule(f"{name} of {kind}", value)
        for component, name, value in zip(COMPONENTS, names, values, strict=True)
        if value is not None
    }


def _limits(axis: str, limits: Any) -> tuple[float, float]:
    if not isinstance(limits, tuple | list) or len(limits) != 2:
        raise InputError(f"{axis} of where is {limits!r}; give (low, high) in metres, None for no limit.")
    low = -np.inf if limits[0] is None else float(limits[0])
    high = np.inf if limits[1] is None else float(limits[1])
    if not low <= high:
        raise InputError(f"{axis} of where is ({low:g}, {high:g}); low must not exceed high.")
    return low, high


def _indices(name: str, array: NDArray[Any], n: int) -> Ints:
    """Return particle indices as int64; raises InputError unless they are whole numbers from 0 to n - 1."""
    if array.size == 0:
        return np.empty(0, np.int64)
    if array.dtype.kind not in "iu":
        raise InputError(f"{name} indices have type {array.dtype}; they must be whole numbers.")
    bad = (array < 0) | (array >= n)
    if np.any(bad):
        k = np.argwhere(bad)[0]
        raise InputError(f"{name} {k[0]} names particle {array[tuple(k)]}; indices run from 0 to {n - 1}.")
    return array.astype(np.int64)


__all__ = ["BondSet", "Model", "Selection"]
