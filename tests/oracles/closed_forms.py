"""Closed forms of spheres joined by short beams: what the verification problems must give.

Derived from the equations of motion of two rigid spheres and one massless bond, and from textbooks; nothing here comes
from the package. A bond of length l has an axial stiffness kn, a shear stiffness ks, a twist stiffness kt and a bending
stiffness kb. Its shear force V = ks (w2 - w1 - l (th1 + th2)/2) acts at mid-length, so that each sphere also gets the
moment V l/2. SI units throughout.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, cos, exp, pi, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
EARTH = 9.81  # m/s2


@dataclass(frozen=True)
class Spheres:
    """Equal spheres with round beams between their centres: kn = EA/l, ks = GA/l, kb = EI/l, kt = GJ/l."""

    radius: float
    density: float
    length: float
    bond_radius: float
    E: float
    G: float

    @property
    def mass(self) -> float:
        """Mass of a sphere [kg]."""
        return 4.0 / 3.0 * pi * self.radius**3 * self.density

    @property
    def inertia(self) -> float:
        """Moment of inertia of a sphere, 2 m R^2/5 [kg m2]."""
        return 2.0 / 5.0 * self.mass * self.radius**2

    @property
    def area(self) -> float:
        """Cross-section of a bond [m2]."""
        return pi * self.bond_radius**2

    @property
    def bending_area(self) -> float:
        """Second moment of area I of a bond [m4]; its polar moment is J = 2I."""
        return pi * self.bond_radius**4 / 4.0

    @property
    def kn(self) -> float:
        """Axial stiffness [N/m]."""
        return self.E * self.area / self.length

    @property
    def ks(self) -> float:
        """Shear stiffness [N/m]."""
        return self.G * self.area / self.length

    @property
    def kb(self) -> float:
        """Bending stiffness [N m/rad]."""
        return self.E * self.bending_area / self.length

    @property
    def kt(self) -> float:
        """Twist stiffness [N m/rad]."""
        return self.G * 2.0 * self.bending_area / self.length


DP0 = Spheres(radius=5e-3, density=2500.0, length=1e-2, bond_radius=4e-3, E=1e9, G=0.45e9)


# Directions, rotations and the reading of signals ---------------------------------------------------------------


def frame(direction: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return unit vectors n along the direction, t across it, and b = n x t, about which a turn takes n towards t."""
    n = np.asarray(direction, float) / np.linalg.norm(direction)
    t = np.cross(n, np.eye(3)[np.argmin(np.abs(n))] + 0.3 * np.ones(3))
    t /= np.linalg.norm(t)
    return n, t, np.cross(n, t)


def quaternion(rotation: ArrayLike) -> Floats:
    """Return the unit quaternion (scalar first) of a rotation vector [rad]."""
    vector = np.asarray(rotation, float)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0.0 else vector
    return np.concatenate([[cos(0.5 * angle)], sin(0.5 * angle) * axis])


def quaternion_product(p: ArrayLike, q: ArrayLike) -> Floats:
    """Return p q: first the rotation q, then p; q may be (n, 4)."""
    p, q = np.asarray(p, float), np.asarray(q, float)
    scalar = p[0] * q[..., :1] - np.sum(p[1:] * q[..., 1:], axis=-1, keepdims=True)
    return np.concatenate([scalar, p[0] * q[..., 1:] + q[..., :1] * p[1:] + np.cross(p[1:], q[..., 1:])], axis=-1)


def rotation_matrix(rotation: ArrayLike) -> Floats:
    """Return the matrix of a rotation vector [rad], by Rodrigues' formula."""
    vector = np.asarray(rotation, float)
    angle = float(np.linalg.norm(vector))
    k = vector / angle
    across = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    return np.eye(3) + sin(angle) * across + (1.0 - cos(angle)) * across @ across


def tone(samples: ArrayLike, spacing: float) -> tuple[float, float]:
    """Return circular frequency [rad/s] and decay rate [1/s] of equally spaced samples of A exp(-st) cos(wt + phase).

    Such samples obey u[k+1] = 2 r c u[k] - r^2 u[k-1] with r = exp(-s spacing), c = cos(w spacing): Prony's method
    (1795), here by least squares. Raises ValueError where the samples are not such a tone, to 1e-4 of their size.
    """
    u = np.asarray(samples, float)
    before, now, after = u[:-2], u[1:-1], u[2:]
    (first, second), *_ = np.linalg.lstsq(np.stack([now, before], axis=1), after, rcond=None)
    if not np.abs(after - first * now - second * before).max() <= 1e-4 * np.abs(u).max():
        raise ValueError(f"these {len(u)} samples are not one tone.")
    r = sqrt(-second)
    return float(np.arccos(first / (2.0 * r))) / spacing, -float(np.log(r)) / spacing


def period(samples: ArrayLike, spacing: float) -> float:
    """Return the period [s] of equally spaced samples of one undamped tone."""
    return 2.0 * pi / tone(samples, spacing)[0]


def verlet_period(true: float, dt: float) -> float:
    """Return the period that velocity Verlet (or leapfrog) shows for an oscillator: pi dt/asin(w dt/2).

    Its discrete motion is exactly harmonic, with sin(W dt/2) = w dt/2 (Hairer, Lubich & Wanner, Acta Numerica 2003).
    """
    return pi * dt / asin(pi * dt / true)


# Two spheres, one bond ------------------------------------------------------------------------------------------


def axial_period(s: Spheres) -> float:
    """Return the period of a free pair along its axis: w^2 = kn/(m/2)."""
    return 2.0 * pi / sqrt(2.0 * s.kn / s.mass)


def twist_period(s: Spheres) -> float:
    """Return the period of opposite spins along the axis: w^2 = kt/(I/2)."""
    return 2.0 * pi * sqrt(s.inertia / (2.0 * s.kt))


def bending_period(s: Spheres) -> float:
    """Return the period of opposite spins across the axis: w^2 = kb/(I/2). No shear, so the centres rest."""
    return 2.0 * pi * sqrt(s.inertia / (2.0 * s.kb))


def shear_period(s: Spheres) -> float:
    """Return the period of the shear mode: V = ks (w2 - w1 - l (th1 + th2)/2), m w'' = -+V, I th'' = V l/2 on each.

    Two derivatives of V give w^2 = ks (2/m + l^2/(2I)), 7 ks/m for touching spheres.
    """
    return 2.0 * pi / sqrt(s.ks * (2.0 / s.mass + s.length**2 / (2.0 * s.inertia)))


def shear_spin(s: Spheres) -> float:
    """Return the spin of both spheres, about n x t, per speed of the second along t (the first moves back) [1/m]."""
    return -s.mass * s.length / (2.0 * s.inertia)


def shifted_force(s: Spheres, shift: float) -> float:
    """Return the force along t on a sphere whose neighbour is shifted by `shift` along t, rotations blocked.

    The bond has then turned by a with tan a = shift/l: U = kn (l/cos a - l)^2/2 + ks (l sin a)^2/2, and the force is
    dU/dshift = ks shift - (2 ks - kn/2) shift (shift/l)^2 + ...
    """
    a = np.arctan2(shift, s.length)
    stretched = s.length * (1.0 / cos(a) - 1.0)
    dU_da = s.kn * stretched * s.length * sin(a) / cos(a) ** 2 + s.ks * s.length**2 * sin(a) * cos(a)
    return float(dU_da * cos(a) ** 2 / s.length)


def dashpot(zeta: float, k: float, effective_mass: float) -> float:
    """Return the dashpot c that gives an oscillator (k, effective mass) the damping ratio zeta."""
    return 2.0 * zeta * sqrt(k * effective_mass)


def peak_ratio(zeta: float) -> float:
    """Return the ratio of successive peaks on the same side: exp(-2 pi zeta/sqrt(1 - zeta^2))."""
    return exp(-2.0 * pi * zeta / sqrt(1.0 - zeta**2))


def shear_damping(s: Spheres, zeta: float) -> float:
    """Return the damping ratio of the shear mode where cs is that of zeta on two masses: zeta w/sqrt(2 ks/m)."""
    return zeta * (2.0 * pi / shear_period(s)) / sqrt(2.0 * s.ks / s.mass)


def rupture_loads(s: Spheres, tension: float, shear: float) -> dict[str, float]:
    """Return the loads that bring the outer fibre of a bond to its strength [Pa], each load alone.

    sigma = F/A or M rb/I, tau = V/A or T rb/J (Potyondy & Cundall 2004).
    """
    modulus = s.bending_area / s.bond_radius
    return {
        "tension": tension * s.area,
        "shear": shear * s.area,
        "moment": tension * modulus,
        "twist": shear * 2.0 * modulus,
    }


@dataclass(frozen=True)
class Softening:
    """Bilinear softening: stiffness k up to the slip d0, a straight line down to nothing at df, unloading to 0."""

    k: float
    d0: float
    df: float

    def envelope(self, d: float) -> float:
        """Return the force at the slip d on first loading [N]."""
        return self.k * d if d <= self.d0 else max(self.k * self.d0 * (self.df - d) / (self.df - self.d0), 0.0)

    def secant(self, largest: float) -> float:
        """Return the stiffness left after the slip `largest` [N/m]."""
        return self.envelope(largest) / largest

    def dissipated(self, largest: float) -> float:
        """Return the area between the envelope and the unloading line [J]."""
        d = min(largest, self.df)
        under = 0.5 * (self.k * self.d0**2 + (self.k * self.d0 + self.envelope(d)) * (d - self.d0))
        return under - 0.5 * self.envelope(d) * d


# Chains ---------------------------------------------------------------------------------------------------------


def cantilever_force(s: Spheres, bonds: int, P: float) -> tuple[float, float]:
    """Return deflection [m] and rotation [rad] of the last sphere under a force P across; the first is clamped.

    Bond k (from 0) lies between k l and (k+1) l and carries V = P and, at its middle, M = P (N - k - 1/2) l; it turns
    its end by M/kb and shifts it by P/ks. With the lever (N - k - 1/2) l each, and the sums of odd numbers and squares.
    """
    N, arm = bonds, s.length
    return N * P / s.ks + P * arm**2 * N * (4 * N * N - 1) / (12.0 * s.kb), P * arm * N**2 / (2.0 * s.kb)


def cantilever_couple(s: Spheres, bonds: int, C: float) -> tuple[float, float]:
    """Return deflection [m] and rotation [rad] of the last sphere under a couple C: M = C everywhere."""
    return C * s.length * bonds**2 / (2.0 * s.kb), bonds * C / s.kb


def timoshenko_deflection(s: Spheres, bonds: int, P: float) -> float:
    """Return the tip deflection of the continuous beam, P L^3/(3EI) + P L/(GA), shear factor 1."""
    L = bonds * s.length
    return P * L**3 / (3.0 * s.E * s.bending_area) + P * L / (s.G * s.area)


def cantilever_frequency(s: Spheres, bonds: int) -> float:
    """Return the first bending frequency [rad/s], 1.8751^2 sqrt(EI/mu)/L^2 with L = (N + 1/2) l: a guide, to 1 %."""
    return 1.875104**2 * sqrt(s.E * s.bending_area * s.length / s.mass) / ((bonds + 0.5) * s.length) ** 2


def fixed_free_frequency(k: float, m: float, bonds: int) -> float:
    """Return the lowest frequency [rad/s] of N equal bodies in a row, one end held, the other free.

    u_i = sin(q i) with m w^2 = 4k sin^2(q/2), and no force beyond the last: cos(q (N + 1/2)) = 0, so q = pi/(2N + 1).
    """
    return 2.0 * sqrt(k / m) * sin(0.5 * pi / (2 * bonds + 1))


def fixed_free_shape(bonds: int) -> Floats:
    """Return the lowest mode sin(pi i/(2N + 1)) of bodies i = 0 (held) to N."""
    return np.sin(pi * np.arange(bonds + 1) / (2 * bonds + 1))


def fixed_fixed_frequency(k: float, m: float, movable: int, mode: int) -> float:
    """Return a frequency [rad/s] of equal bodies between held ends: u_i = sin(j pi i/(n + 1))."""
    return 2.0 * sqrt(k / m) * sin(0.5 * mode * pi / (movable + 1))


def fixed_fixed_shape(movable: int, mode: int) -> Floats:
    """Return the mode sin(j pi i/(n + 1)) of bodies i = 0 (held) to n + 1 (held)."""
    return np.sin(mode * pi * np.arange(movable + 2) / (movable + 1))


def hanging_end(s: Spheres, hanging: int, g: float) -> float:
    """Return how far the last of N hanging spheres sinks: bond k from below carries k m g, sum k = N(N + 1)/2."""
    return s.mass * g * hanging * (hanging + 1) / (2.0 * s.kn)


def dispersion(s: Spheres, qa: float) -> float:
    """Return the frequency [rad/s] of the infinite chain, 2 sqrt(kn/m) |sin(qa/2)| (Brillouin 1946)."""
    return 2.0 * sqrt(s.kn / s.mass) * abs(sin(0.5 * qa))


def group_velocity(s: Spheres, qa: float) -> float:
    """Return dw/dq [m/s] of the infinite chain, a sqrt(kn/m) cos(qa/2); at qa = 0 the speed of sound."""
    return s.length * sqrt(s.kn / s.mass) * cos(0.5 * qa)


# Lattices -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lattice:
    """Half of the bonds of a site (the other half are opposite), which of them span a cell, and volume per site.

    Bonds are unit vectors, so lengths are in l; the volume of the plane net is an area.
    """

    bonds: Floats
    cell: tuple[int, ...]
    volume: float

    def sites(self, half_width: float) -> Floats:
        """Return the sites with all coordinates within +-half_width, in l, from the middle outwards."""
        steps = np.arange(-9, 10)
        grid = np.stack(np.meshgrid(*[steps] * len(self.cell), indexing="ij"), axis=-1).reshape(-1, len(self.cell))
        x = grid @ self.bonds[list(self.cell)]
        x = x[np.abs(x).max(axis=1) <= half_width]
        return x[np.argsort(np.round(np.linalg.norm(x, axis=1), 6), kind="stable")]


def _unit(*vectors: Sequence[float]) -> Floats:
    return np.array([np.array(v) / np.linalg.norm(v) for v in vectors])


FCC_BONDS = _unit((1, 1, 0), (1, 0, 1), (0, 1, 1), (1, -1, 0), (1, 0, -1), (0, 1, -1))
LATTICES = {
    "sc": Lattice(np.eye(3), (0, 1, 2), 1.0),
    "fcc": Lattice(FCC_BONDS, (0, 1, 2), 1.0 / sqrt(2.0)),
    "bcc": Lattice(_unit((1, 1, -1), (1, -1, 1), (-1, 1, 1), (1, 1, 1)), (0, 1, 2), 4.0 / (3.0 * sqrt(3.0))),
    "triangular": Lattice(_unit((1, 0, 0), (1, sqrt(3.0), 0), (1, -sqrt(3.0), 0)), (0, 1), sqrt(0.75)),
}


def lattice_constants(kind: str, kn: float, ks: float, length: float) -> dict[str, float]:
    """Return C11, C12, C44 [Pa] (plane net: [N/m]) of a lattice whose spheres are free to turn; x along cube edges."""
    sc = {"C11": kn, "C12": 0.0, "C44": ks / 2.0}
    fcc = {"C11": sqrt(2.0) * (kn + ks), "C12": (kn - ks) / sqrt(2.0), "C44": (kn + ks) / sqrt(2.0)}
    bcc = {"C11": (4 * kn + 8 * ks) / 9.0, "C12": 4.0 * (kn - ks) / 9.0, "C44": (4 * kn + 2 * ks) / 9.0}
    if kind == "triangular":
        nu, E = plane_net(kn, ks)
        return {"C11": E / (1.0 - nu**2), "C12": nu * E / (1.0 - nu**2), "C44": 0.5 * E / (1.0 + nu)}
    chosen = {"sc": sc, "fcc": fcc, "bcc": {n: 0.75 * sqrt(3.0) * c for n, c in bcc.items()}}[kind]
    return {name: value / length for name, value in chosen.items()}


def plane_net(kn: float, ks: float) -> tuple[float, float]:
    """Return Poisson's ratio and Young's modulus [N/m] of the triangular plane net.

    From C11 = sqrt3/4 (3 kn + ks) and C12 = sqrt3/4 (kn - ks). At ks = 0: 1/3 and 2 kn/sqrt3.
    """
    return (kn - ks) / (3.0 * kn + ks), 2.0 * sqrt(3.0) * kn * (kn + ks) / (3.0 * kn + ks)


def young_100(C11: float, C12: float) -> float:
    """Return Young's modulus along a cube edge, C11 - 2 C12^2/(C11 + C12)."""
    return C11 - 2.0 * C12**2 / (C11 + C12)


STRAINS = {
    "pulled": np.diag([1.0, 0.0, 0.0]),
    "pulled twice": np.diag([1.0, 1.0, 0.0]),
    "sheared": np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]),
}


def cubic_invariants(strain: Floats) -> Floats:
    """Return the factors of C11, C12 and C44 in twice the energy per volume at a strain (3, 3), axes along the cube."""
    e = np.diag(strain)
    across = strain[0, 1] ** 2 + strain[1, 2] ** 2 + strain[0, 2] ** 2
    return np.array([np.sum(e**2), np.sum(e) ** 2 - np.sum(e**2), 4.0 * across])


def periodic_constants(kind: str, kn: float, ks: float, length: float) -> dict[str, float]:
    """Return C11, C12, C44 by minimising the energy of one cell of the infinite lattice over the turn of its sphere.

    With one site per cell every sphere moves with the strain e and turns alike, so that twist and bending rest; then
    2U/V = sum over the bonds of a site of kn (n.en)^2 + ks |en - (n.en) n - turn x n|^2, times l^2/V.
    """
    lattice = LATTICES[kind]
    normals, volume = lattice.bonds, lattice.volume * length ** (2 if kind == "triangular" else 3)
    energies = []
    for strain in STRAINS.values():
        along = np.einsum("bi,ij,bj->b", normals, strain, normals)
        across = (normals @ strain - along[:, None] * normals).ravel()
        turning = np.concatenate([np.cross(np.eye(3), n).T for n in normals])
        turn, *_ = np.linalg.lstsq(turning, across, rcond=None)
        squares = kn * np.sum(along**2) + ks * np.sum((across - turning @ turn) ** 2)
        energies.append(squares * length**2 / volume)
    factors = np.array([cubic_invariants(strain) for strain in STRAINS.values()])
    return dict(zip(("C11", "C12", "C44"), np.linalg.solve(factors, energies), strict=True))
