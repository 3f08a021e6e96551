"""The model: what is there. Particles in named parts, bonds between them, and boundary conditions."""

import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.bonds import Bond, Joint
from pybondem.boundaries import COMPONENTS, ZERO, Boundaries, Condition, Kind
from pybondem.check import choice, finite_array, nearest, nonnegative, positive, positive_array
from pybondem.errors import InputError, SelectionError
from pybondem.neighbours import pairs_within, same_place
from pybondem.packing import Particles, Shape
from pybondem.schedules import Prescribed, Schedule, as_schedule

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Limits = tuple[float | None, float | None]  # low and high, None for no limit


class Selection:
    """Some particles of a model: `indices`, ascending. Combine with & (both), | (either), - (without)."""

    def __init__(self, indices: Ints, name: str, owner: object) -> None:
        self.indices = indices
        self.name = name
        self.owner = owner  # the model's own mark: indices mean nothing in another model

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"<{self.name}: {len(self)} particles>"

    def _same_model(self, other: object) -> Ints:
        """Return the indices of the other selection; raises SelectionError unless it is one of the same model."""
        if not isinstance(other, Selection) or other.owner is not self.owner:
            raise SelectionError(f"{self!r} cannot be combined with {other!r}; give a selection of the same model.")
        return other.indices

    def __and__(self, other: "Selection") -> "Selection":
        return Selection(
            np.intersect1d(self.indices, self._same_model(other)), f"({self.name} & {other.name})", self.owner
        )

    def __or__(self, other: "Selection") -> "Selection":
        indices = np.union1d(self.indices, self._same_model(other))
        return Selection(indices, f"({self.name} | {other.name})", self.owner)

    def __sub__(self, other: "Selection") -> "Selection":
        return Selection(
            np.setdiff1d(self.indices, self._same_model(other)), f"({self.name} - {other.name})", self.owner
        )


class BondSet(NamedTuple):
    """One call of bond or join: pairs (m, 2), the bond, and for joints the unit normals (m, 3) and areas (m,) [m2]."""

    pairs: NDArray[np.int32]
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
        self._densities: list[float] = []
        self.part_of: NDArray[np.int32] = np.empty(0, np.int32)
        self.parts: list[str] = []
        self.bonds: list[BondSet] = []
        self.boundaries = Boundaries()
        self._mark = object()
        self.changes = 0  # how often the model has been changed; a Simulation is of the model as it was
        if particles is not None:
            if density is None:
                raise InputError("Model needs a density [kg/m3] for its particles: Model(particles, density=2500.0).")
            self.add(particles, name=name, density=density)

    def __len__(self) -> int:
        return len(self.x)

    # Particles --------------------------------------------------------------------------------------------------

    def add(self, particles: Particles, name: str, density: float) -> Selection:
        """Add a part: its particles, a new name, density [kg/m3]; returns its particles.

        Raises InputError for a name that is taken, a density that is not positive, a particle without finite mass, or
        one at the very place of another.
        """
        if not isinstance(particles, Particles):
            raise InputError(f"part {name!r} needs Particles (see pybondem.packing), got {type(particles).__name__}.")
        if name in self.parts:
            raise InputError(f"part {name!r} is there already; give each part a name of its own.")
        density = positive(f"density of part {name!r}", density, "kg/m3")
        check_mass(name, particles, density)
        first = len(self)
        everywhere = np.concatenate([self.x, particles.x])
        twins = same_place(everywhere, float(particles.radius.min(initial=np.inf)))
        if twins is not None:
            other = f"{twins[0] - first} of the same part" if twins[0] >= first else f"{twins[0]} of the model"
            raise InputError(f"particle {twins[1] - first} of part {name!r} is at the same place as particle {other}.")
        self.x = everywhere
        self.radius = np.concatenate([self.radius, particles.radius])
        self._densities.append(density)
        self.part_of = np.concatenate([self.part_of, np.full(len(particles), len(self.parts), np.int32)])
        self.parts.append(name)
        self.changes += 1
        return Selection(np.arange(first, len(self)), name, self._mark)

    @property
    def density(self) -> Floats:
        """Density of each particle (n,) [kg/m3]."""
        return np.array(self._densities)[self.part_of]

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
        return Selection(np.flatnonzero(self._is_of(name)), name, self._mark)

    def _is_of(self, part: str) -> NDArray[np.bool_]:
        """Return whether each particle is of a part (n,)."""
        if part not in self.parts:
            there_are = ", ".join(map(repr, self.parts)) or "none"
            raise SelectionError(f"no part is named {part!r}{nearest(part, self.parts)}; the parts are: {there_are}.")
        return self.part_of == self.parts.index(part)

    def where(self, x: Limits | None = None, y: Limits | None = None, z: Limits | None = None,
              part: str | None = None, inside: Shape | None = None) -> Selection:  # fmt: skip
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
            mask &= self._is_of(part)
            said.append(f"part {part!r}")
        if inside is not None:
            if not isinstance(inside, Shape):
                raise InputError(f"inside of where is {inside!r}; give a shape: Box, Cylinder, Sphere.")
            mask &= inside.contains(self.x)
            said.append("the shape")
        name = " and ".join(said) or "all"
        if not mask.any():
            span = ", ".join(f"{a} from {lo:g} to {hi:g} m" for a, lo, hi in zip("xyz", *self._span(), strict=False))
            raise SelectionError(f"no particle lies within {name}; the model spans {span}.")
        return Selection(np.flatnonzero(mask), name, self._mark)

    def select(self, particles: ArrayLike) -> Selection:
        """Return the particles with the given indices, or where the given mask (n,) is true.

        Raises InputError for another shape or an index out of range, SelectionError where nothing is selected.
        """
        array = _plain_array("selection", particles)
        if array.ndim != 1:
            raise InputError(f"the selection has shape {array.shape}; give a list of indices, or a mask.")
        indices = np.flatnonzero(array) if array.dtype == bool else _indices("selection", array, len(self))
        if array.dtype == bool and array.shape != (len(self),):
            raise InputError(f"the mask has shape {array.shape}; it must be ({len(self)},), one value per particle.")
        if len(indices) == 0:
            raise SelectionError("the selection is empty.")
        return Selection(np.unique(indices), "selection", self._mark)

    def _span(self) -> tuple[Floats, Floats]:
        return (self.x.min(axis=0), self.x.max(axis=0)) if len(self) else (np.empty(0), np.empty(0))

    # Bonds ------------------------------------------------------------------------------------------------------

    def touching(self, gap: float = 0.05, part: str | None = None, between: tuple[str, str] | None = None) -> Ints:
        """Return the pairs (m, 2) of neighbours whose surfaces are at most gap * (Ri + Rj) apart.

        part: only within this part; between: only across these two parts, the first of each pair in the first.
        Raises InputError for a gap below zero or both a part and two, SelectionError for an unknown part.
        """
        pairs = pairs_within(self.x, self.radius, nonnegative("gap of touching", gap))
        if part is not None and between is not None:
            raise InputError("touching was given part and between; give one of them.")
        if part is not None:
            return pairs[self._is_of(part)[pairs].all(axis=1)]
        if between is not None:
            first, second = (self._is_of(name)[pairs] for name in between)
            forth, back = first[:, 0] & second[:, 1], first[:, 1] & second[:, 0]
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
        each = np.full(m, positive("area of join", area, "m2")) if np.ndim(area) == 0 else area
        A = positive_array("area of join", each, (m,), "m2")
        return self._add(BondSet(checked, joint, N / size[:, None], A))

    def _pairs(self, pairs: ArrayLike) -> NDArray[np.int32]:
        array = _plain_array("bond pairs", pairs)
        if array.size == 0:
            return np.empty((0, 2), np.int32)
        if array.ndim != 2 or array.shape[1] != 2:
            raise InputError(f"bond pairs have shape {array.shape}; it must be (m, 2), two particle indices per bond.")
        checked = _indices("bond", array, len(self))
        if np.any(checked[:, 0] == checked[:, 1]):
            k = int(np.argmax(checked[:, 0] == checked[:, 1]))
            raise InputError(f"bond {k} joins particle {checked[k, 0]} with itself; a bond needs two particles.")
        return checked.astype(np.int32)

    def _add(self, new: BondSet) -> BondSet:
        if len(new.pairs) == 0:
            warnings.warn("no bonds were made: there are no pairs; a larger gap in touching finds more.", stacklevel=3)
            return new
        ends = np.sort(np.concatenate([bonds.pairs for bonds in (*self.bonds, new)]).astype(np.int64), axis=1)
        values, count = np.unique((ends[:, 0] << 32) + ends[:, 1], return_counts=True)
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
            said = f"bond {k} is {ratio[k]:.3g} times as long as Ri + Rj of particles {new.pairs[k].tolist()}."
            warnings.warn(said, stacklevel=3)
        self.bonds.append(new)
        self.changes += 1
        return new

    # Boundary conditions ----------------------------------------------------------------------------------------

    def fix(self, where: Selection, components: str | Iterable[str] = "x y z rx ry rz") -> None:
        """Hold components of the selected particles: displacements x, y, z and rotations rx, ry, rz ("x y z").

        Raises InputError for an unknown component, SelectionError where one is prescribed already (so do drive, push).
        """
        if not isinstance(components, Iterable):
            raise InputError(f"the components of fix are {components!r}; give names such as 'x y z'.")
        names = components.split() if isinstance(components, str) else list(components)
        self._condition("fix", where, {choice("component of fix", name, COMPONENTS): ZERO for name in names})

    def drive(self, where: Selection, *,
              vx: Prescribed | None = None, vy: Prescribed | None = None, vz: Prescribed | None = None,
              wx: Prescribed | None = None, wy: Prescribed | None = None,
              wz: Prescribed | None = None) -> None:  # fmt: skip
        """Prescribe velocities [m/s] and spins [rad/s] of the selected particles: numbers or schedules."""
        self._condition("drive", where, _given("drive", (vx, vy, vz, wx, wy, wz), ("vx", "vy", "vz", "wx", "wy", "wz")))

    def push(self, where: Selection, *,
             fx: Prescribed | None = None, fy: Prescribed | None = None, fz: Prescribed | None = None,
             tx: Prescribed | None = None, ty: Prescribed | None = None,
             tz: Prescribed | None = None) -> None:  # fmt: skip
        """Put a force [N] and torque [N m] on each of the selected particles: numbers or schedules."""
        self._condition("push", where, _given("push", (fx, fy, fz, tx, ty, tz), ("fx", "fy", "fz", "tx", "ty", "tz")))

    def own(self, where: Selection, what: str = "a measure") -> Ints:
        """Return the indices of a selection; raises SelectionError where it is of another model."""
        if where.owner is not self._mark:
            raise SelectionError(f"{what} was given {where!r} of another model: this one has {len(self)} particles.")
        return where.indices

    def _condition(self, kind: Kind, where: Selection, schedules: dict[str, Schedule]) -> None:
        if not isinstance(where, Selection):
            raise InputError(f"{kind} needs a Selection (Model.where, part or select), got {type(where).__name__}.")
        self.own(where, kind)
        if len(where) == 0:
            raise SelectionError(f"{kind} was given {where!r}; the selection is empty.")
        if not schedules:
            raise InputError(f"{kind} was given no component; name at least one.")
        by_index = {COMPONENTS.index(name): s for name, s in schedules.items()}
        self.changes += 1
        self.boundaries.add(Condition(kind, where.indices, by_index))


def _given(kind: Kind, values: tuple[Prescribed | None, ...], names: tuple[str, ...]) -> dict[str, Schedule]:
    """Return the schedules of the components that were given."""
    return {
        component: as_schedule(f"{name} of {kind}", value)
        for component, name, value in zip(COMPONENTS, names, values, strict=True)
        if value is not None
    }


def check_mass(name: str, particles: Particles, density: float) -> None:
    """Raise InputError where a particle has no mass or inertia, or no finite one; density [kg/m3]."""
    with np.errstate(over="ignore", under="ignore"):
        mass = 4.0 / 3.0 * np.pi * particles.radius**3 * density
        inertia = 0.4 * mass * particles.radius**2
    for what, values, unit in (("mass", mass, "kg"), ("inertia", inertia, "kg m2")):
        bad = ~(np.isfinite(values) & (values > 0.0))
        if np.any(bad):
            k = int(np.argmax(bad))
            raise InputError(
                f"particle {k} of part {name!r}, of radius {particles.radius[k]:g} m, has a {what} of {values[k]:g} "
                f"{unit}; it must be positive and finite."
            )


def _limits(axis: str, limits: Any) -> tuple[float, float]:
    if not isinstance(limits, tuple | list) or len(limits) != 2:
        raise InputError(f"{axis} of where is {limits!r}; give (low, high) in metres, None for no limit.")
    try:
        low = -np.inf if limits[0] is None else float(limits[0])
        high = np.inf if limits[1] is None else float(limits[1])
    except (TypeError, ValueError):
        raise InputError(f"{axis} of where is {limits!r}; give (low, high) in metres, None for no limit.") from None
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


def _plain_array(name: str, value: object) -> NDArray[Any]:
    """Return value as an array; raises InputError for masked arrays and rows of different lengths."""
    if isinstance(value, np.ma.MaskedArray):
        raise InputError(f"{name} is a masked array; fill or drop its masked values first.")
    try:
        return np.asarray(value)
    except ValueError:
        raise InputError(f"{name} has rows of different lengths.") from None
