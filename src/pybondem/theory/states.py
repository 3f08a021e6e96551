"""Equilibrium states of a pull-out test: one of them with its profiles along the fibre, or a whole path of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.errors import InputError
from pybondem.theory.specimen import Floats, Specimen, finite_values
from pybondem.theory.zones import Side, side

_ROUND_OFF = 1e-9  # of the length: by so much may a position computed elsewhere miss an end


class LoadPoint(NamedTuple):
    """A point of the load-displacement curve."""

    load: float  # P [N]
    displacement: float  # u of the loaded end [m]


@dataclass(frozen=True)
class PullOutState:
    """One equilibrium state. The profiles take positions x [m] of any shape in 0 <= x <= L (tip to loaded end).

    Attributes
    ----------
    specimen : what is pulled.
    log_slip : ln(S/s0), kept because S itself underflows in very long bonds.
    least_slip, section : the least slip S and the section x_m where it is found [m].
    load, displacement : P [N]; u of the loaded end against the held section, with that of the extra compliance [m].
    dissipated : work used up so far [J]: G_f (s - s0)/(sf - s0) by the cohesion, G_f at most, and tau_r (s - s0) by
        friction, which unloads along its elastic slope tau_r/s0. Without friction, unloading gives P u/2 back.
    zones : from tip to loaded end, such as "SESD": Elastic, Softening, Debonded.
    slips_back : whether a debonded section slips back there along the path, which friction would not let it do: the
        state is then that of a reversible bond, `dissipated` a function of its slips.

    Raises
    ------
    InputError : (by the profiles) a position is not a finite real number or not on the bond.
    """

    specimen: Specimen
    log_slip: float
    least_slip: float
    section: float
    load: float
    displacement: float
    dissipated: float
    zones: str
    slips_back: bool

    def slip(self, x: ArrayLike) -> Floats:
        """Return s(x) = u_f - u_m [m]."""
        return self._side(self._on_bond(x)).slip

    def shear(self, x: ArrayLike) -> Floats:
        """Return the bond stress tau(x) [Pa]."""
        return self.specimen.bond_stress(self.slip(x))

    def fibre_force(self, x: ArrayLike) -> Floats:
        """Return N_f(x) = a_s (s' + g0 P) [N], tension positive: 0 at the tip, P at the loaded end."""
        x = self._on_bond(x)
        slope = np.sign(x - self.section) * self._side(x).slope
        return self.specimen.a_series * (slope + self.specimen.g_tip * self.load)

    def matrix_displacement(self, x: ArrayLike) -> Floats:
        """Return u_m(x) [m] against the held section, mean over the area."""
        of, x = self.specimen, self._on_bond(x)
        if of.support == "pull-push":
            return of.alpha * (self.slip(of.length) - self.slip(x))
        return of.alpha * (self.slip(0.0) - self.slip(x)) + self.load * x / (of.a_fibre + of.a_matrix)

    def fibre_displacement(self, x: ArrayLike) -> Floats:
        """Return u_f(x) = u_m + s [m] against the held section, mean over the area."""
        return self.matrix_displacement(x) + self.slip(x)

    def _on_bond(self, x: ArrayLike) -> Floats:
        """Return positions as an array, those that miss an end by round-off moved onto it."""
        given, length = finite_values("x", x), self.specimen.length
        on_bond = np.clip(given, 0.0, length)
        outside = np.flatnonzero(np.abs(given - on_bond) > _ROUND_OFF * length)
        if outside.size:
            first = int(outside[0])
            raise InputError(f"x[{first}] is {float(given.flat[first])!r} m; the bond reaches from 0 to {length!r} m.")
        return on_bond

    def _side(self, x: Floats) -> Side:
        return side(self.specimen, self.log_slip, np.abs(x - self.section))


@dataclass(frozen=True)
class PullOutPath:
    """Equilibrium states along the path, from P = 0 to the last section debonded (S = sf): arrays of n values.

    Attributes
    ----------
    least_slip, section : the least slip S and its section x_m [m].
    load, displacement : P [N] and u of the loaded end [m].
    dissipated : work used up so far [J], p L G_f and the work of friction at the end; it falls only where debonded
        sections slip back.
    zones : n words from tip to loaded end, such as "SESD".
    slips_back : whether a debonded section slips back there against friction (see `PullOutState`).
    """

    least_slip: Floats
    section: Floats
    load: Floats
    displacement: Floats
    dissipated: Floats
    zones: tuple[str, ...]
    slips_back: NDArray[np.bool_]
