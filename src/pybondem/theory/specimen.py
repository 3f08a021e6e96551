"""What a pull-out test pulls on: two elastic bars, a bilinear bond between them, and the slip of that bond.

A fibre (axial stiffness a_f = E_f A_f) and a matrix (a_m = E_m A_m) are bonded over 0 <= x <= L, with x = 0 at the tip
of the fibre and x = L at its end that is loaded by P. The bond stress tau depends on the slip s = u_f - u_m alone:

    equilibrium   N_f' = p tau,  N_m' = -p tau          =>   s'' = c tau(s),   p = 2 pi r_f,   c = p (1/a_f + 1/a_m)
    ends          s'(0) = -g0 P,   s'(L) = gL P              g0 + gL = 1/a_f + 1/a_m = 1/a_s,   rho = g0/gL
    pull-pull     matrix held at x = 0:  g0 = 1/a_m, gL = 1/a_f
    pull-push     matrix held at x = L:  g0 = 0,     gL = 1/a_s
    bond          tau = k s  (s <= s0),   tau_r + (tau_max - tau_r) (sf - s)/(sf - s0)  (s <= sf),   tau_r beyond
                  lam^2 = c k,   omega^2 = lam^2 (s0 - tau_r/k)/(sf - s0),   tau_max = k s0
    two parts     friction min(tau_r s/s0, tau_r), and cohesion, which has gone at sf:  G_f = (tau_max - tau_r) sf/2

`zones.py` integrates the equation, and `pullout.py` puts the parts together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import choice, finite_array, nonnegative, positive
from pybondem.errors import InputError

Floats = NDArray[np.float64]
Support = Literal["pull-pull", "pull-push"]

_UNITS = {"E_fibre": "Pa", "E_matrix": "Pa", "stiffness": "Pa/m", "extra_compliance": "m/N", "residual_stress": "Pa"}
# all others: m


@dataclass(frozen=True)
class Specimen:
    """Two bars, their bond and their support; the parameters are explained in `PullOut`."""

    E_fibre: float
    E_matrix: float
    r_fibre: float
    r_matrix: float
    length: float
    stiffness: float
    slip_peak: float
    slip_end: float
    support: Support = "pull-pull"
    extra_compliance: float = 0.0
    residual_stress: float = 0.0

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self) if f.name != "support"):
            check = nonnegative if name in ("extra_compliance", "residual_stress") else positive
            object.__setattr__(self, name, check(f"PullOut: {name}", getattr(self, name), _UNITS.get(name, "m")))
        for small, large in (("r_fibre", "r_matrix"), ("slip_peak", "slip_end")):
            low, high = getattr(self, small), getattr(self, large)
            if not low < high:
                raise InputError(f"PullOut: {large} is {high!r} m; it must be above {small} = {low!r} m.")
        if not self.residual_stress < self.tau_max:
            raise InputError(
                f"PullOut: residual_stress is {self.residual_stress!r} Pa; it must be below the peak stress "
                f"stiffness * slip_peak = {self.tau_max!r} Pa."
            )
        choice("PullOut: support", self.support, get_args(Support))

    def with_axial_stiffness(self, a_fibre: float, a_matrix: float) -> Self:
        """Return the specimen with axial stiffnesses EA [N] that were measured, such as those of two sphere lattices.

        The moduli become EA over the nominal areas, all else stays.
        """
        E_fibre = positive("a_fibre", a_fibre, "N") * self.E_fibre / self.a_fibre
        E_matrix = positive("a_matrix", a_matrix, "N") * self.E_matrix / self.a_matrix
        return replace(self, E_fibre=E_fibre, E_matrix=E_matrix)

    def with_shear_compliance(self, compliance: float) -> Self:
        """Return the specimen with an elastic layer of compliance c_sl [m/Pa] in series with the bond.

        The sum s + c_sl tau(s) of both slips follows the same kind of law again, with s0 + c_sl tau_max and
        sf + c_sl tau_r, the same strength and the same residual stress (without one the same G_f); it is what the
        returned specimen calls slip. `shear_lag_compliance` gives c_sl of a round fibre and its matrix.

        Raises
        ------
        InputError : c_sl is negative, or so large that the bond would snap back within itself.
        """
        c_sl = nonnegative("compliance", compliance, "m/Pa")
        limit = (self.slip_end - self.slip_peak) / (self.tau_max - self.residual_stress)
        if c_sl >= limit:
            falls = "tau_max - tau_r" if self.residual_stress else "tau_max"
            raise InputError(
                f"with_shear_compliance: compliance is {c_sl!r} m/Pa; stay below (sf - s0)/({falls}) = {limit!r}."
            )
        softer, slip_end = 1.0 + self.stiffness * c_sl, self.slip_end + c_sl * self.residual_stress
        return replace(self, stiffness=self.stiffness / softer, slip_peak=self.slip_peak * softer, slip_end=slip_end)

    # ---- the bars ----------------------------------------------------------------------------------------------------

    @cached_property
    def a_fibre(self) -> float:
        """Axial stiffness a_f of the fibre [N]."""
        return self.E_fibre * math.pi * self.r_fibre**2

    @cached_property
    def a_matrix(self) -> float:
        """Axial stiffness a_m of the matrix [N]."""
        return self.E_matrix * math.pi * (self.r_matrix**2 - self.r_fibre**2)

    @cached_property
    def a_series(self) -> float:
        """a_s = 1/(1/a_f + 1/a_m) [N]."""
        return 1.0 / (1.0 / self.a_fibre + 1.0 / self.a_matrix)

    @cached_property
    def alpha(self) -> float:
        """Share a_f/(a_f + a_m) of the fibre in the axial stiffness [-]."""
        return self.a_fibre / (self.a_fibre + self.a_matrix)

    @cached_property
    def g_tip(self) -> float:
        """g0 = -s'(0)/P [1/N]."""
        return 1.0 / self.a_matrix if self.support == "pull-pull" else 0.0

    @cached_property
    def g_end(self) -> float:
        """gL = s'(L)/P [1/N]."""
        return 1.0 / self.a_fibre if self.support == "pull-pull" else 1.0 / self.a_series

    @cached_property
    def rho(self) -> float:
        """g0/gL [-]: a_f/a_m in pull-pull, 0 in pull-push."""
        return self.g_tip / self.g_end

    # ---- the bond ----------------------------------------------------------------------------------------------------

    @cached_property
    def p(self) -> float:
        """Perimeter of the fibre [m]."""
        return 2.0 * math.pi * self.r_fibre

    @cached_property
    def c(self) -> float:
        """p/a_s, of s'' = c tau [m/N]."""
        return self.p / self.a_series

    @cached_property
    def lam(self) -> float:
        """Decay rate of slip in an elastic zone [1/m]."""
        return math.sqrt(self.c * self.stiffness)

    @cached_property
    def omega(self) -> float:
        """Wave number of slip in a softening zone [1/m]."""
        return self.lam * math.sqrt(self.slip_peak * (1.0 - self.residual_share) / (self.slip_end - self.slip_peak))

    @cached_property
    def tau_max(self) -> float:
        """Bond strength k s0 [Pa]."""
        return self.stiffness * self.slip_peak

    @cached_property
    def residual_share(self) -> float:
        """tau_r/tau_max [-]."""
        return self.residual_stress / self.tau_max

    @cached_property
    def overhang(self) -> float:
        """How far beyond sf the falling line would reach zero, (sf - s0) tau_r/(tau_max - tau_r) [m]."""
        return (self.slip_end - self.slip_peak) * self.residual_share / (1.0 - self.residual_share)

    @cached_property
    def fracture_energy(self) -> float:
        """G_f = (tau_max - tau_r) sf/2, spent by the cohesion: without friction the area under the bond law [J/m2]."""
        return 0.5 * (self.tau_max - self.residual_stress) * self.slip_end

    def bond_stress(self, slip: ArrayLike) -> Floats:
        """Return tau(s) [Pa] for slips s [m] of any shape, with the sign of the slip.

        Raises
        ------
        InputError : a slip is not a finite real number.
        """
        s = finite_values("slip", slip)
        return np.copysign(self._tau(np.abs(s)), s)

    def _tau(self, slip: Floats) -> Floats:
        falls, friction = self.tau_max - self.residual_stress, self.residual_stress
        falling = friction + falls * (self.slip_end - slip) / (self.slip_end - self.slip_peak)
        return np.minimum(self.stiffness * slip, np.maximum(falling, friction))

    def least_slip(self, log_slip: ArrayLike) -> Floats:
        """Return S = s0 exp(log_slip) [m]; all is computed from ln(S/s0), because S underflows in very long bonds."""
        return self.slip_peak * np.exp(np.asarray(log_slip, dtype=np.float64))


def finite_values(name: str, values: ArrayLike) -> Floats:
    """Return `values` as floats of the same shape. Raises InputError as `pybondem.check.finite_array`."""
    try:
        dimensions = np.ndim(values)
    except ValueError:  # rows of different lengths: for the check below to say
        dimensions = 0
    return finite_array(name, values, (None,) * dimensions)


def shear_lag_compliance(r_fibre: float, r_matrix: float, G_fibre: float, G_matrix: float) -> float:
    """Return c_sl [m/Pa], the slip between the mean displacements of fibre and matrix per unit of bond stress.

    Radii in m, axial shear moduli in Pa (C44 of an hcp lattice along c). Both parts stretch evenly and the matrix is
    free at its outer radius R, so the shear stress is tau r/r_f in the fibre and tau (r_f/r)(R^2 - r^2)/(R^2 - r_f^2)
    in the matrix. It is integrated to displacements, and these are averaged over each section: the shear lag of Cox
    1952 (Br. J. Appl. Phys. 3, 72) in terms of means.

        c_sl = r_f/(4 G_f) + (r_f/G_m) [R^4 ln(R/r_f)/(R^2 - r_f^2)^2 - (3R^2 - r_f^2)/(4(R^2 - r_f^2))].

    Raises
    ------
    InputError : a number is not finite and positive, or r_matrix <= r_fibre.
    """
    given = {
        "r_fibre": (r_fibre, "m"),
        "r_matrix": (r_matrix, "m"),
        "G_fibre": (G_fibre, "Pa"),
        "G_matrix": (G_matrix, "Pa"),
    }
    r, R, G_f, G_m = (positive(name, *value) for name, value in given.items())
    if not r < R:
        raise InputError(f"r_matrix is {R!r} m; it must be above r_fibre = {r!r} m.")
    annulus = R**2 - r**2
    matrix = R**4 * math.log(R / r) / annulus**2 - (3.0 * R**2 - r**2) / (4.0 * annulus)
    return r / (4.0 * G_f) + r / G_m * matrix
