"""Elastic constants of the three regular sphere lattices, from their bonds and back.

Equal spheres of diameter d touch; every touching pair has a normal stiffness kn and a shear stiffness ks [N/m], which
acts on u2 - u1 - (d/2)(th1 + th2) x n. The constants below are exact for the infinite lattice, spheres free to rotate:

    sc    C11 = kn/d                  C12 = 0                      C44 = ks/(2d)                 axes along the bonds
    fcc   C11 = sqrt2 (kn + ks)/d     C12 = (kn - ks)/(sqrt2 d)    C44 = (kn + ks)/(sqrt2 d)     axes of the cube
    hcp   C33 = 2 sqrt2 (2kn + ks)/(3d)      C13 = sqrt2 (kn - ks)/(3d)      C44 = sqrt2 (kn + 2ks)/(3d)
          C11 = sqrt2 (29kn^2 + 170 kn ks + 89ks^2)/(24 d (kn + 5ks))
          C12 = sqrt2 (kn - ks)(11kn + 49ks)/(24 d (kn + 5ks))             x3 along the stacking axis c

All but C66 = (C11 - C12)/2 of hcp follow from affine displacements alone (Born; Voigt); in hcp the two sublattices
also shift against each other, by (kn - ks) d |e11 - e22|/(2 sqrt3 (kn + 5ks)). At ks = 0 hcp has the ratios
C11:C12:C13:C33:C44 = 29:11:8:32:8. Bending and twisting stiffness of the bonds has no part in these constants, because
a uniform strain turns no sphere against its neighbour. Each lattice is elastically isotropic at ks = kn only (nu = 0).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pybondem.check import axis_vector, choice, finite_number, nonnegative, positive
from pybondem.errors import InputError

Lattice = Literal["sc", "fcc", "hcp"]
Floats = NDArray[np.float64]

SQRT2 = math.sqrt(2.0)

_DIRECTIONS: dict[str, dict[str, tuple[float, float, float]]] = {
    "sc": {"100": (1, 0, 0), "110": (1, 1, 0), "111": (1, 1, 1)},
    "fcc": {"100": (1, 0, 0), "110": (1, 1, 0), "111": (1, 1, 1), "row": (1, 1, 0)},
    "hcp": {"c": (0, 0, 1), "row": (1, 0, 0)},
}
_MAIN_DIRECTION = {"sc": "100", "fcc": "100", "hcp": "c"}
_LARGEST_NU = {"fcc": 1 / 3, "hcp": 1 / 5}  # reached at ks = 0


class Stiffnesses(NamedTuple):
    """Stiffnesses of one bond."""

    kn: float  # normal [N/m]
    ks: float  # shear [N/m]


@dataclass(frozen=True)
class ElasticConstants:
    """Stiffnesses Cij [Pa] of a lattice, x3 along c for hcp and along cube edges for sc and fcc."""

    lattice: Lattice
    C11: float
    C12: float
    C13: float
    C33: float
    C44: float
    C66: float

    @property
    def stiffness(self) -> Floats:
        """The matrix C (6, 6) [Pa] in Voigt's order 11, 22, 33, 23, 13, 12 with shear strains 2 e_ij."""
        C = np.diag([self.C11, self.C11, self.C33, self.C44, self.C44, self.C66])
        C[0, 1] = C[1, 0] = self.C12
        C[:2, 2] = C[2, :2] = self.C13
        return C

    @property
    def bulk(self) -> float:
        """Bulk modulus [Pa]: pressure per volume strain. 2 sqrt2 kn/(3d) for fcc and hcp alike."""
        return float(1.0 / np.linalg.inv(self.stiffness[:3, :3]).sum())

    def young(self, along: str | Sequence[float] | None = None) -> float:
        """Return Young's modulus [Pa] along a direction: 1/E = S_ijkl n_i n_j n_k n_l.

        `along` is "100", "110" or "111" (sc, fcc), "row" for a close-packed row (fcc, hcp), "c" (hcp), or any vector;
        without it "100" or "c". In closed form

            hcp c, fcc 111   6 sqrt2 kn (kn + ks)/(d (5kn + ks))
            fcc 100          2 sqrt2 kn (kn + 3ks)/(d (3kn + ks))
            fcc 110          2 sqrt2 kn (kn + ks)(kn + 3ks)/(d (2kn^2 + 5kn ks + ks^2))
            hcp row          6 sqrt2 kn (kn + ks) Q/(d D),   Q = 3kn^2 + 22kn ks + 23ks^2,
                             D = 18kn^3 + 119kn^2 ks + 128kn ks^2 + 23ks^3

        Raises
        ------
        InputError : an unknown direction, or a lattice without shear stiffness (sc with ks = 0).
        """
        pull = _dyad(self._unit(along))
        return float(1.0 / (pull @ self._compliance() @ pull))

    def poisson(self, along: str | Sequence[float] | None = None, across: str | Sequence[float] | None = None) -> float:
        """Return Poisson's ratio for a pull along one direction, seen across it: -E S_ijkl n_i n_j m_k m_l.

        Directions as in `young`. Without `across`, the mean over all directions across, which is the ratio itself
        wherever the lattice looks the same all round: along c, 100 and 111. In closed form

            hcp c, fcc 111   (kn - ks)/(5kn + ks)
            fcc 100          (kn - ks)/(3kn + ks)
            hcp row          (kn - ks)(6kn^2 + 31kn ks + 23ks^2)/D in the layer, (kn - ks) Q/D along c

        Raises
        ------
        InputError : as `young`, or the two directions are not at right angles.
        """
        n = self._unit(along)
        pull, S = _dyad(n), self._compliance()
        if across is None:
            round_about = 0.5 * (np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) - pull)
        else:
            m = self._unit(across)
            if abs(n @ m) > 1e-9:
                raise InputError(f"across {across!r} is not at right angles to along {along!r}.")
            round_about = _dyad(m)
        return float(-(round_about @ S @ pull) / (pull @ S @ pull))

    def _compliance(self) -> Floats:
        if self.C44 == 0.0:
            raise InputError("an sc lattice with ks = 0 is a mechanism without moduli; give ks > 0 [N/m].")
        return np.asarray(np.linalg.inv(self.stiffness), dtype=np.float64)

    def _unit(self, direction: str | Sequence[float] | None) -> Floats:
        if direction is None:
            direction = _MAIN_DIRECTION[self.lattice]
        if isinstance(direction, str):
            named = _DIRECTIONS[self.lattice]
            direction = named[choice(f"direction in {self.lattice!r}", direction, named)]
        return axis_vector("direction", direction)


def elastic_constants(lattice: Lattice, kn: float, ks: float, diameter: float) -> ElasticConstants:
    """Return the exact elastic constants of a lattice of bonds kn > 0, ks >= 0 [N/m] between spheres d [m] that touch.

    Raises
    ------
    InputError : an unknown lattice, or a number that is not finite or out of range.
    """
    choice("lattice", lattice, get_args(Lattice))
    kn, ks, d = positive("kn", kn, "N/m"), nonnegative("ks", ks, "N/m"), positive("diameter", diameter, "m")
    if lattice == "sc":
        return _cubic("sc", kn / d, 0.0, ks / (2.0 * d))
    if lattice == "fcc":
        return _cubic("fcc", SQRT2 * (kn + ks) / d, (kn - ks) / (SQRT2 * d), (kn + ks) / (SQRT2 * d))
    relaxed = 24.0 * d * (kn + 5.0 * ks)
    C11 = SQRT2 * (29.0 * kn**2 + 170.0 * kn * ks + 89.0 * ks**2) / relaxed
    C12 = SQRT2 * (kn - ks) * (11.0 * kn + 49.0 * ks) / relaxed
    C13 = SQRT2 * (kn - ks) / (3.0 * d)
    C33 = 2.0 * SQRT2 * (2.0 * kn + ks) / (3.0 * d)
    C44 = SQRT2 * (kn + 2.0 * ks) / (3.0 * d)
    return ElasticConstants("hcp", C11, C12, C13, C33, C44, 0.5 * (C11 - C12))


def calibrate(lattice: Lattice, E: float, nu: float, diameter: float) -> Stiffnesses:
    """Return the bond stiffnesses that give Young's modulus E [Pa] and Poisson's ratio nu along c (hcp), 100 (sc, fcc).

        hcp   kn = E d/(2 sqrt2 (1 - 2nu))     ks = kn (1 - 5nu)/(1 + nu)     -1 < nu <= 1/5
        fcc   kn = E d/(2 sqrt2 (1 - 2nu))     ks = kn (1 - 3nu)/(1 + nu)     -1 < nu <= 1/3
        sc    kn = E d                         ks = kn                             nu  = 0

    A pull along a cube edge of sc shears no bond, so it reaches nu = 0 only and leaves ks open. Here ks = kn, the one
    value with C44 = (C11 - C12)/2 = E/(2(1 + nu)): it makes the lattice isotropic, as nu = 0 makes hcp and fcc. Away
    from nu = 0 the axial shear modulus C44 of hcp is 2(kn + 2ks)/(3(kn + ks)) of E/(2(1 + nu)), 2/3 at nu = 1/5.

    Raises
    ------
    InputError : an unknown lattice, E or d not finite and positive, nu out of the lattice's reach.
    """
    choice("lattice", lattice, get_args(Lattice))
    E, nu, d = positive("E", E, "Pa"), finite_number("nu", nu), positive("diameter", diameter, "m")
    if lattice == "sc":
        if nu != 0.0:
            raise InputError(f"nu is {nu!r}; an sc lattice along its bonds reaches nu = 0 only, take 'fcc' or 'hcp'.")
        return Stiffnesses(E * d, E * d)
    largest = _LARGEST_NU[lattice]
    if not -1.0 < nu <= largest:
        other = " or take 'fcc' (up to 1/3)" if lattice == "hcp" and nu <= _LARGEST_NU["fcc"] else ""
        raise InputError(
            f"nu is {nu!r}; {lattice!r} reaches -1 < nu <= {largest:.6g} (there ks = 0); stay within{other}."
        )
    kn = E * d / (2.0 * SQRT2 * (1.0 - 2.0 * nu))
    return Stiffnesses(kn, kn * max(1.0 - nu / largest, 0.0) / (1.0 + nu))


def volume_per_sphere(lattice: Lattice, diameter: float) -> float:
    """Return the volume [m3] of the cell of one sphere: d^3 (sc), d^3/sqrt2 (fcc, hcp).

    Raises
    ------
    InputError : an unknown lattice, or a diameter that is not finite and positive.
    """
    choice("lattice", lattice, get_args(Lattice))
    d = positive("diameter", diameter, "m")
    return d**3 if lattice == "sc" else d**3 / SQRT2


def _cubic(lattice: Lattice, C11: float, C12: float, C44: float) -> ElasticConstants:
    return ElasticConstants(lattice, C11, C12, C12, C11, C44, C44)


def _dyad(n: Floats) -> Floats:
    """Return n n as a Voigt stress (6,), which also reads a normal strain along n out of a Voigt strain."""
    return np.array([n[0] ** 2, n[1] ** 2, n[2] ** 2, n[1] * n[2], n[0] * n[2], n[0] * n[1]])
