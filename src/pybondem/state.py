"""THE TABLE: every field of a running model once. Allocation, docs, files and engines read it from here.

Arrays are component-first, (components, n), or (n,) for one component; double precision unless said. A field that is
the same for all items and does not change may stand as one number.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


class Field(NamedTuple):
    """One field: name, number of components, dtype, unit, meaning."""

    name: str
    components: int
    dtype: type
    unit: str
    meaning: str


PARTICLE_FIELDS = (
    Field("x", 3, np.float64, "m", "position of the centre"),
    Field("start", 3, np.float64, "m", "position when the bonds were made"),
    Field("q", 4, np.float64, "-", "orientation, unit quaternion (scalar first), body to global"),
    Field("v", 3, np.float64, "m/s", "velocity"),
    Field("w", 3, np.float64, "rad/s", "spin, global axes"),
    Field("v_ahead", 3, np.float64, "m/s", "velocity foreseen for the end of the step, which dashpots act on"),
    Field("w_ahead", 3, np.float64, "rad/s", "spin foreseen for the end of the step"),
    Field("force", 3, np.float64, "N", "sum of bonds, pushes and gravity"),
    Field("torque", 3, np.float64, "N m", "sum of bonds and pushes"),
    Field("drag", 3, np.float64, "N", "force of local or global damping"),
    Field("drag_torque", 3, np.float64, "N m", "torque of local or global damping"),
    Field("mass", 1, np.float64, "kg", "mass"),
    Field("inertia", 1, np.float64, "kg m2", "moment of inertia of the sphere"),
    Field("group", 1, np.uint32, "-", "which set of boundary conditions the particle obeys"),
    Field("work", 1, np.float64, "J", "work done by drives and pushes on the particle"),
    Field("dragged", 1, np.float64, "J", "energy taken by local or global damping"),
)

# A law adds its own: p_NAME for each of its parameters, m_NAME for each word of its memory.
BOND_FIELDS = (
    Field("i", 1, np.uint32, "-", "first end"),
    Field("j", 1, np.uint32, "-", "second end"),
    Field("normal", 3, np.float64, "-", "unit normal of the interface (joints)"),
    Field("kn", 1, np.float64, "N/m", "normal stiffness"),
    Field("ks", 1, np.float64, "N/m", "shear stiffness"),
    Field("kt", 1, np.float64, "N m/rad", "twist stiffness"),
    Field("kb", 1, np.float64, "N m/rad", "bending stiffness"),
    Field("cn", 1, np.float64, "N s/m", "normal dashpot"),
    Field("cs", 1, np.float64, "N s/m", "shear dashpot"),
    Field("ct", 1, np.float64, "N m s/rad", "twist dashpot"),
    Field("cb", 1, np.float64, "N m s/rad", "bending dashpot"),
    Field("area", 1, np.float64, "m2", "cross-section"),
    Field("modulus", 1, np.float64, "m3", "bending modulus I/Rb of the cross-section"),
    Field("power", 1, np.float64, "W", "power that the dashpots of the bond take"),
    Field("damped", 1, np.float64, "J", "energy that the dashpots of the bond have taken"),
    Field("damage", 1, np.float64, "-", "damage D, 0 whole to 1 broken; of modes: normal or shear, the larger"),
    Field("damages", 4, np.float64, "-", "damage of each mode: normal, shear, twist, bending"),
    Field("potential", 1, np.float64, "J", "energy open to damage, as if undamaged; energy stored under a bond law"),
    Field("potentials", 4, np.float64, "J", "energy open to damage of each mode, as if undamaged"),
    Field("lost", 1, np.float64, "J", "energy that the law has dissipated"),
    Field("before", 6, np.float64, "m, rad", "components of deformation that a bond law last saw"),
    Field("answer", 6, np.float64, "N, N m", "loads that a bond law last answered"),
)

CHORD = "r0"  # chord from i to j when the bond was made [m]: not stored, read as start.j - start.i

# One row for each bond of every block, in the order of the blocks: force on i, torque on i, torque on j.
LOAD = Field("load", 9, np.float64, "N, N m", "force on i (3), torque on i (3), torque on j (3)")
ENERGY = Field("energy", 1, np.float64, "J", "elastic energy of the bond")

GROUP_FIELDS = (
    Field("hold", 3, np.float64, "-", "1 where a displacement component is prescribed"),
    Field("turn_hold", 3, np.float64, "-", "1 where a rotation component is prescribed"),
)

# (steps + 1, components, groups): one row for each step of an engine call, and the row after the last.
SCHEDULED_FIELDS = (
    Field("velocity", 3, np.float64, "m/s", "prescribed velocity over the step"),
    Field("spin", 3, np.float64, "rad/s", "prescribed spin over the step"),
    Field("push", 3, np.float64, "N", "force put on the particle"),
    Field("push_torque", 3, np.float64, "N m", "torque put on the particle"),
)

# (steps + 1,): the same for all bonds.
GROWING = Field("growing", 1, np.float64, "-", "1 where damage may grow in the step, 0 where it is frozen")


class Holder(Protocol):
    """Who holds newer versions of host arrays: an engine with memory of its own."""

    def fetch(self, array: NDArray[Any]) -> None:
        """Bring a host array up to date."""

    def changed(self, array: NDArray[Any]) -> None:
        """Take note that the host has written into an array."""

    def total(self, array: NDArray[Any]) -> float:
        """Return the sum of all items of an array as they are now, which need not come to the host for it."""

    def picked(self, array: NDArray[Any], at: NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Return some items (the last index) of an array as they are now; the others need not come to the host."""


class Fields(dict[str, Any]):
    """Arrays and numbers by name. Where an engine holds newer versions, an array is fetched when it is looked at."""

    source: Holder | None = None

    def __getitem__(self, name: str) -> Any:
        return self._fresh(super().__getitem__(name))

    def get(self, name: str, default: Any = None) -> Any:
        """Return a field, or the default where there is none."""
        return self._fresh(super().get(name, default))

    def items(self) -> Any:
        """Return names and fields."""
        return [(name, self[name]) for name in self]

    def changed(self, name: str) -> None:
        """Say that a field was written into."""
        if self.source is not None:
            self.source.changed(super().__getitem__(name))

    def total(self, name: str) -> float:
        """Return the sum of all items of a field."""
        array = super().__getitem__(name)
        return float(array.sum()) if self.source is None else self.source.total(array)

    def picked(self, name: str, at: NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Return some items of a field (components, m): only they are fetched."""
        array = super().__getitem__(name)
        found: NDArray[Any] = array[..., at] if self.source is None else self.source.picked(array, at)
        return found

    def _fresh(self, value: Any) -> Any:
        if self.source is not None and isinstance(value, np.ndarray):
            self.source.fetch(value)
        return value


def allocate(fields: tuple[Field, ...], names: set[str], n: int) -> Arrays:
    """Return zeroed arrays for the named fields of n items."""
    return {f.name: np.zeros(n if f.components == 1 else (f.components, n), f.dtype) for f in fields if f.name in names}
