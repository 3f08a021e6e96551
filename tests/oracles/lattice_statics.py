"""Statics and highest frequency of bonded lattices by assembled matrices, written apart from the package.

A bond is the two-node Timoshenko beam element (Przemieniecki, Theory of Matrix Structural Analysis, 1968, section 5.6)
in its own axes, turned into the global ones by direction cosines. A joint is an interface element between two bodies:
stiff along its own normal and across it against u_j - u_i - (theta_i + theta_j)/2 x r0. Degrees of freedom are numbered
by particle: displacements along x, y, z [m], then rotations about x, y, z [rad].
"""

from collections.abc import Iterable
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigvalsh
from scipy.optimize import brentq
from scipy.sparse import coo_array, csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

Floats = NDArray[np.float64]
Ints = NDArray[np.integer[Any]]
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


# Elements -------------------------------------------------------------------------------------------------------


def beam_matrix(length: ArrayLike, kn: ArrayLike, ks: ArrayLike, kt: ArrayLike, kb: ArrayLike) -> Floats:
    """Return the stiffness (m, 12, 12) of beams along their own first axis.

    In the words of the textbook kn = EA/L, kt = GJ/L, kb = EI/L and ks = 12 EI/(L^3 (1 + Phi)), so that its other
    entries 6 EI/(L^2 (1 + Phi)), (4 + Phi) EI/(L (1 + Phi)) and (2 - Phi) EI/(L (1 + Phi)) are ks L/2, ks L^2/4 + kb
    and ks L^2/4 - kb.
    """
    given = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, float)) for a in (length, kn, ks, kt, kb)))
    L, axial, shear, twist, bending = given
    lever, near, far = shear * L / 2.0, shear * L**2 / 4.0 + bending, shear * L**2 / 4.0 - bending
    upper = {
        (0, 0): axial, (0, 6): -axial, (6, 6): axial,
        (3, 3): twist, (3, 9): -twist, (9, 9): twist,
        (1, 1): shear, (1, 5): lever, (1, 7): -shear, (1, 11): lever, (7, 7): shear, (7, 11): -lever,
        (5, 5): near, (5, 7): -lever, (5, 11): far, (11, 11): near,
        (2, 2): shear, (2, 4): -lever, (2, 8): -shear, (2, 10): -lever, (8, 8): shear, (8, 10): lever,
        (4, 4): near, (4, 8): lever, (4, 10): far, (10, 10): near,
    }  # fmt: skip
    K = np.zeros((len(L), 12, 12))
    for (row, column), value in upper.items():
        K[:, row, column] = K[:, column, row] = value
    return K


def bond_matrix(r0: Floats, kn: ArrayLike, ks: ArrayLike, kt: ArrayLike, kb: ArrayLike) -> Floats:
    """Return the stiffness (m, 12, 12) in global axes of beams along r0 (m, 3)."""
    length = np.linalg.norm(r0, axis=1)
    first = r0 / length[:, None]
    second = np.cross(np.eye(3)[np.argmin(np.abs(first), axis=1)], first)
    second /= np.linalg.norm(second, axis=1)[:, None]
    cosines = np.stack([first, second, np.cross(first, second)], axis=1)
    turn = np.zeros((len(r0), 12, 12))
    for k in range(0, 12, 3):
        turn[:, k : k + 3, k : k + 3] = cosines
    return np.asarray(np.swapaxes(turn, 1, 2) @ beam_matrix(length, kn, ks, kt, kb) @ turn)


def joint_matrix(r0: Floats, normal: Floats, kn: ArrayLike, ks: ArrayLike) -> Floats:
    """Return the stiffness (m, 12, 12) of joints across r0 (m, 3): kn along the unit normal (m, 3), ks across it."""
    m = len(r0)
    half_turn = np.zeros((m, 3, 3))  # half_turn @ theta = theta x r0 / 2
    for row, column, c, sign in ((0, 1, 2, 1), (0, 2, 1, -1), (1, 2, 0, 1), (1, 0, 2, -1), (2, 0, 1, 1), (2, 1, 0, -1)):
        half_turn[:, row, column] = 0.5 * sign * r0[:, c]
    unit = np.broadcast_to(np.eye(3), (m, 3, 3))
    relative = np.concatenate([-unit, -half_turn, unit, -half_turn], axis=2)
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    kn, ks = (np.broadcast_to(np.asarray(k, float), (m,))[:, None, None] for k in (kn, ks))
    return np.asarray(np.swapaxes(relative, 1, 2) @ (kn * (np.eye(3) - across) + ks * across) @ relative)


# Lattices -------------------------------------------------------------------------------------------------------


class Lattice:
    """Particles at x (n, 3) and what binds them."""

    def __init__(self, x: Floats) -> None:
        self.x = x
        self._dofs: list[Ints] = []
        self._elements: list[Floats] = []

    def bond(self, pairs: Ints, kn: ArrayLike, ks: ArrayLike, kt: ArrayLike = 0.0, kb: ArrayLike = 0.0) -> "Lattice":
        """Add bonds between the pairs (m, 2): axial and shear [N/m], twist and bending [N m/rad] stiffness."""
        return self._add(pairs, bond_matrix(self._span(pairs), kn, ks, kt, kb))

    def join(self, pairs: Ints, normal: Floats, kn: ArrayLike, ks: ArrayLike) -> "Lattice":
        """Add joints between the pairs (m, 2) with unit normals (m, 3): normal and slip stiffness [N/m]."""
        return self._add(pairs, joint_matrix(self._span(pairs), normal, kn, ks))

    def _span(self, pairs: Ints) -> Floats:
        return np.asarray(self.x[pairs[:, 1]] - self.x[pairs[:, 0]])

    def _add(self, pairs: Ints, elements: Floats) -> "Lattice":
        self._dofs.append((6 * pairs[:, :, None] + np.arange(6)).reshape(-1, 12))
        self._elements.append(elements)
        return self

    @property
    def stiffness(self) -> csc_array:
        """Stiffness (6n, 6n)."""
        dof, elements = np.concatenate(self._dofs), np.concatenate(self._elements)
        at = np.repeat(dof, 12, axis=1).ravel(), np.tile(dof, (1, 12)).ravel()
        return csc_array(coo_array((elements.ravel(), at), shape=(6 * len(self.x), 6 * len(self.x))))

    def solve(self, held: dict[int, float], load: Floats | None = None) -> tuple[Floats, Floats]:
        """Return displacements and rotations (n, 6), and the forces and torques (n, 6) that keep them there.

        held: value [m or rad] of each held degree of freedom (see `held`); load (n, 6): forces and torques on the
        others. Motions that cost nothing, a grain that can spin, are kept at rest by weak springs, whose effect
        iteration takes out again. Raises ArithmeticError where a load finds no resistance.
        """
        arm = np.linalg.norm(self._span(np.concatenate(self._dofs)[:1, ::6] // 6))  # to measure rotations by arcs
        arcs = np.tile([1.0, 1.0, 1.0, arm, arm, arm], len(self.x))
        K = csc_array(diags_array(1.0 / arcs) @ self.stiffness @ diags_array(1.0 / arcs))
        at = np.array(list(held), int)
        free = np.setdiff1d(np.arange(len(arcs)), at)
        u = np.zeros(len(arcs))
        u[at] = arcs[at] * np.array(list(held.values()))
        put = np.zeros(len(arcs)) if load is None else load.ravel() / arcs
        wanted, inner = (put - K @ u)[free], csc_array(K[free][:, free])
        weak = 1e-9 * K.diagonal().max() * eye_array(len(free), format="csc")
        factors = splu(csc_array(inner + weak))
        for _ in range(20):
            left = wanted - inner @ u[free]
            if np.linalg.norm(left) <= 1e-12 * np.linalg.norm(wanted):
                return (u / arcs).reshape(-1, 6), (arcs * (K @ u)).reshape(-1, 6)
            u[free] += factors.solve(left)
        raise ArithmeticError(f"{np.linalg.norm(left) / np.linalg.norm(wanted):.2g} of the load finds no resistance.")

    def critical_step(
        self, mass: Floats, inertia: Floats, fixed: Iterable[int] = (), dashpots: "Lattice | None" = None
    ) -> float:
        """Return the largest stable step [s] of velocity Verlet, by dense eigenvalue problems.

        mass [kg], inertia [kg m2] (n,); fixed: degrees of freedom that do not move; dashpots: a lattice whose stiffness
        is the damping matrix C, which acts on v(t) + dt a(t) at t + dt. The first motion to grow changes sign at every
        step, u(t) = (-1)^n U: its foreseen velocity is 4 u/dt, so that 4 M U/dt^2 = (K + 4 C/dt) U. For any U the
        other roots of this scalar equation of motion lie inside the unit circle, hence the bound is that of
        dt^2 K/4 + dt C < M; without dashpots dt = 2/omega_max.
        """
        body = np.repeat(np.stack([mass, inertia], axis=1), 3, axis=1).ravel()
        free = np.setdiff1d(np.arange(len(body)), np.array(list(fixed), int))
        scale = 1.0 / np.sqrt(np.outer(body[free], body[free]))

        def largest(A: Floats) -> float:
            return float(eigvalsh(A, subset_by_index=[len(free) - 1, len(free) - 1])[0])

        K = scale * self.stiffness[free][:, free].toarray()
        undamped = 2.0 / sqrt(largest(K))
        if dashpots is None:
            return undamped
        C = scale * dashpots.stiffness[free][:, free].toarray()
        return float(brentq(lambda dt: largest(dt**2 / 4.0 * K + dt * C) - 1.0, 0.0, undamped, rtol=1e-9, xtol=1e-30))


def dofs(particles: ArrayLike, components: str) -> list[int]:
    """Return the degrees of freedom of particles: dofs([0, 3], "x y rz")."""
    return [6 * int(p) + COMPONENTS.index(c) for p in np.atleast_1d(particles) for c in components.split()]


def held(particles: ArrayLike, components: str, to: float = 0.0) -> dict[int, float]:
    """Return what `Lattice.solve` holds: components of particles, all at the same value [m or rad]."""
    return dict.fromkeys(dofs(particles, components), to)


# Close packings -------------------------------------------------------------------------------------------------


def hexagonal_springs(E: float, nu: float, diameter: float) -> tuple[float, float]:
    """Return kn, ks [N/m] with which a hexagonal close packing has modulus E, Poisson ratio nu along its c axis.

    The inverse of `hexagonal_modulus` and nu_c = (kn - ks)/(5 kn + ks).
    """
    kn = E * diameter / (2.0 * sqrt(2.0) * (1.0 - 2.0 * nu))
    return kn, kn * (1.0 - 5.0 * nu) / (1.0 + nu)


def hexagonal_modulus(kn: float, ks: float, diameter: float) -> float:
    """Return Young's modulus [Pa] of an unbounded hexagonal close packing along its c axis.

    From C33, C13 and C11 + C12 of homogeneous strain: E_c = 6 sqrt2 kn (kn + ks)/(d (5 kn + ks)).
    """
    return 6.0 * sqrt(2.0) * kn * (kn + ks) / (diameter * (5.0 * kn + ks))
