"""What a pull-out test pulls on: two elastic bars, a bilinear bond between them, and the slip of that bond.

A fibre (axial stiffness a_f = E_f A_f) and a matrix (a_m = E_m A_m) are bonded over 0 <= x <= L, with x = 0 at the tip
of the fibre and x = L at its end that is loaded by P. The bond stress tau depends on the slip s = u_f - u_m alone:

    equilibrium   N_f' = p tau,  N_m' = -p tau          =>   s'' = c tau(s),   p = 2 pi r_f,   c = p (1/a_f + 1/a_m)
    ends          s'(0) = -g0 P,   s'(L) = gL P              g0 + gL = 1/a_f + 1/a_m = 1/a_s,   rho = g0/gL
    pull-pull     matrix held at x = 0:  g0 = 1/a_m, gL = 1/a_f
    pull-push     matrix held at x = L:  g0 = 0,     gL = 1/a_s
    bond          tau = k s  (s <= s0),   k s0 (sf - s)/(sf - s0)  (s <= sf),   0 beyond
                  lam^2 = c k,   omega^2 = lam^2 s0/(sf - s0),   tau_max = k s0,   G_f = tau_max sf/2

`pullout.py` puts these together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import choice, finite_array, nonnegative, positive
from pybondem.errors import InputError

Floats = NDArray[np.float64]
Support = Literal["pull-pull", "pull-push"]

_UNITS = {"E_fibre": "Pa", "E_matrix": "Pa", "stiffness": "Pa/m", "extra_compliance": "m/N"}  # all others: m


class Side(NamedTuple):
    """What is found at a distance y from the section of least slip."""

    slip: Floats  # s [m]
    slope: Floats  # ds/dy [-]
    angle: Floats  # omega times the length within y that softens [rad]
    debonded: Floats  # length within y that has debonded [m]
    spent: Floats  # work dissipated within y over p G_f: the equivalent length of finished bond [m]


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

    def __post_init__(self) -> None:
        for name in (f.name for f in fields(self) if f.name != "support"):
            check = nonnegative if name == "extra_compliance" else positive
            object.__setattr__(self, name, check(f"PullOut: {name}", getattr(self, name), _UNITS.get(name, "m")))
        for small, large in (("r_fibre", "r_matrix"), ("slip_peak", "slip_end")):
            low, high = getattr(self, small), getattr(self, large)
            if not low < high:
                raise InputError(f"PullOut: {large} is {high!r} m; it must be above {small} = {low!r} m.")
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

        The sum s + c_sl tau(s) of both slips is bilinear again, with the same strength and the same G_f; it is what
        the returned specimen calls slip. `shear_lag_compliance` gives c_sl of a round fibre and its matrix.

        Raises
        ------
        InputError : c_sl is negative, or so large that the bond would snap back within itself.
        """
        c_sl = nonnegative("compliance", compliance, "m/Pa")
        limit = (self.slip_end - self.slip_peak) / self.tau_max
        if c_sl >= limit:
            raise InputError(
                f"with_shear_compliance: compliance is {c_sl!r} m/Pa; stay below (sf - s0)/tau_max = {limit!r}."
            )
        softer = 1.0 + self.stiffness * c_sl
        return replace(self, stiffness=self.stiffness / softer, slip_peak=self.slip_peak * softer)

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
        return self.lam * math.sqrt(self.slip_peak / (self.slip_end - self.slip_peak))

    @cached_property
    def tau_max(self) -> float:
        """Bond strength k s0 [Pa]."""
        return self.stiffness * self.slip_peak

    @cached_property
    def fracture_energy(self) -> float:
        """G_f, the area under the bond law [J/m2]."""
        return 0.5 * self.tau_max * self.slip_end

    def bond_stress(self, slip: ArrayLike) -> Floats:
        """Return tau(s) [Pa] for slips s [m] of any shape, with the sign of the slip.

        Raises
        ------
        InputError : a slip is not a finite real number.
        """
        s = finite_values("slip", slip)
        return np.copysign(self._tau(np.abs(s)), s)

    def _tau(self, slip: Floats) -> Floats:
        falling = self.tau_max * (self.slip_end - slip) / (self.slip_end - self.slip_peak)
        return np.maximum(np.minimum(self.stiffness * slip, falling), 0.0)

    def least_slip(self, log_slip: ArrayLike) -> Floats:
        """Return S = s0 exp(log_slip) [m]; all is computed from ln(S/s0), because S underflows in very long bonds."""
        return self.slip_peak * np.exp(np.asarray(log_slip, dtype=np.float64))

    def side(self, log_slip: ArrayLike, y: ArrayLike) -> Side:
        """Integrate s'' = c tau(s), s(0) = S, s'(0) = 0 over a distance y [m], by zones.

            elastic     s = S cosh(lam y)                                        up to y_e = acosh(s0/S)/lam
            softening   s = sf - (sf - s_e) cos(phi) + (v_e/omega) sin(phi)      phi = omega (y - y_e)
                        up to tan(phi) = omega (sf - s_e)/v_e, with slip s_e and slope v_e at y_e
            debonded    s = sf + v (y - y_d)

        For S > s0 there is no elastic zone: y_e = 0, s_e = S, v_e = 0.
        """
        s0, sf, lam, omega = self.slip_peak, self.slip_end, self.lam, self.omega
        log_slip, y = np.asarray(log_slip, dtype=np.float64), np.asarray(y, dtype=np.float64)
        depth = np.maximum(-log_slip, 0.0)  # ln(s0/S)
        root = np.sqrt(-np.expm1(-2.0 * depth))  # sqrt(1 - (S/s0)^2)

        y_e = (depth + np.log1p(root)) / lam
        z = lam * np.minimum(y, y_e)
        s_e = 0.5 * s0 * (np.exp(log_slip + z) + np.exp(log_slip - z))
        v_e = -0.5 * lam * s0 * np.exp(log_slip + z) * np.expm1(-2.0 * z)

        last = np.arctan2(omega * np.maximum(sf - np.maximum(self.least_slip(log_slip), s0), 0.0), lam * s0 * root)
        phi = np.clip(omega * (y - y_e), 0.0, last)
        gap = np.maximum(sf - s_e, 0.0)
        slip = s_e + gap * (1.0 - np.cos(phi)) + v_e / omega * np.sin(phi)
        slope = omega * gap * np.sin(phi) + v_e * np.cos(phi)

        debonded = np.maximum(y - y_e - last / omega, 0.0)
        spent = phi / omega + debonded - (slope - v_e) / (lam**2 * s0)  # the integral of (s - s0)/(sf - s0), 1 at most
        return Side(slip + slope * debonded, slope, phi, debonded, spent)


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
