"""The bond integrated zone by zone, from the section of least slip outward.

With v = ds/dy, and the slip s_z = sf + (sf - s0) tau_r/(tau_max - tau_r) where the falling line would reach zero,
s'' = c tau(s) from s(0) = S, v(0) = 0 is

    elastic     s = S cosh(lam y)                                              up to y_e = acosh(s0/S)/lam
    softening   s = s_z - (s_z - s_e) cos(phi) + (v_e/omega) sin(phi)          phi = omega (y - y_e)
                up to s = sf, with slip s_e and slope v_e at y_e
    debonded    s = sf + v_d d + c tau_r d^2/2                                 d = y - y_d

For S > s0 there is no elastic zone: y_e = 0, s_e = S, v_e = 0; for S > sf no softening one either.

How a state grows with ln S, w = ds/d(ln S) at a fixed y, obeys the linearised equation w'' = c tau'(s) w from w(0) = S,
w'(0) = 0: a cosh, a cosine and a straight line in the three zones. Its first integral is w' v = c (tau w - tau(S) S).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pybondem.theory.specimen import Floats, Specimen


class Side(NamedTuple):
    """What is found at a distance y from the section of least slip."""

    slip: Floats  # s [m]
    slope: Floats  # v = ds/dy [-]
    slip_growth: Floats  # w = ds/d(ln S) [m]
    slope_growth: Floats  # w' = dv/d(ln S) [-]
    parted: Floats  # integral within y of the cohesive damage (s - s0)/(sf - s0), 0 to 1 [m]
    slid: Floats  # integral within y of the slip s - s0 against friction, where there is any [m2]


class _Places(NamedTuple):
    """Places at the end of a zone, or at y where that comes before."""

    slip: Floats
    slope: Floats
    slip_growth: Floats
    slope_growth: Floats


def side(of: Specimen, log_slip: ArrayLike, y: ArrayLike) -> Side:
    """Integrate from the section of least slip S = s0 exp(log_slip) over distances y [m]."""
    log_slip, y = np.asarray(log_slip, dtype=np.float64), np.asarray(y, dtype=np.float64)
    depth = np.maximum(-log_slip, 0.0)  # ln(s0/S)
    root = np.sqrt(-np.expm1(-2.0 * depth))  # sqrt(1 - (S/s0)^2)
    y_e = (depth + np.log1p(root)) / of.lam
    last = _last_angle(of, of.least_slip(log_slip), root)
    elastic = _elastic(of, log_slip, np.minimum(y, y_e))
    phi = np.clip(of.omega * (y - y_e), 0.0, last)
    soft = _softening(of, elastic, phi)
    d = np.maximum(y - y_e - last / of.omega, 0.0)
    parted = phi / of.omega - (soft.slope - elastic.slope) / (of.lam**2 * of.slip_peak)
    parted = parted / (1.0 - of.residual_share)
    bend = of.c * of.residual_stress
    slid = (of.slip_end - of.slip_peak) * parted
    slid = slid + d * (soft.slip - of.slip_peak + d * (soft.slope / 2.0 + bend * d / 6.0))
    growing = _friction_growth(of, of.least_slip(log_slip), soft, (d > 0.0) & (depth > 0.0))
    return Side(
        soft.slip + soft.slope * d + 0.5 * bend * d**2, soft.slope + bend * d, soft.slip_growth + growing * d, growing,
        parted + d, slid,
    )  # fmt: skip


def _elastic(of: Specimen, log_slip: Floats, y: Floats) -> _Places:
    """Return the places at y up to y_e: what is linear grows in proportion."""
    z = of.lam * y
    slip = 0.5 * of.slip_peak * (np.exp(log_slip + z) + np.exp(log_slip - z))
    slope = -0.5 * of.lam * of.slip_peak * np.exp(log_slip + z) * np.expm1(-2.0 * z)
    return _Places(slip, slope, slip, slope)


def _last_angle(of: Specimen, least: Floats, root: Floats) -> Floats:
    """Return phi where softening ends: with A = omega (s_z - s_e), Q = omega (s_z - sf) and the slope v_e at its
    beginning, v_d^2 = v_e^2 + A^2 - Q^2 and A cos(phi) - v_e sin(phi) = Q."""
    Q = of.omega * of.overhang
    rise = of.omega * np.maximum(of.slip_end - np.maximum(least, of.slip_peak), 0.0)
    A, v_e = rise + Q, of.lam * of.slip_peak * root
    v_d = np.sqrt(v_e**2 + rise * (A + Q))
    return np.arctan2(np.maximum(v_d * A - Q * v_e, 0.0), Q * A + v_d * v_e)


def _softening(of: Specimen, e: _Places, phi: Floats) -> _Places:
    """Return the places at angles phi beyond the elastic zone."""
    gap, cos, sin = of.overhang + np.maximum(of.slip_end - e.slip, 0.0), np.cos(phi), np.sin(phi)
    return _Places(
        e.slip + gap * 2.0 * np.sin(0.5 * phi) ** 2 + e.slope / of.omega * sin,
        of.omega * gap * sin + e.slope * cos,
        e.slip_growth * cos + e.slope_growth / of.omega * sin,
        e.slope_growth * cos - of.omega * e.slip_growth * sin,
    )


def _friction_growth(of: Specimen, least: Floats, soft: _Places, debonded: Floats) -> Floats:
    """Return w' beyond softening: where it begins, by the first integral with tau(S) = k S.

    Without friction and in a long bond w' is next to nothing, and this keeps its sign.
    """
    by_integral = of.c * of.residual_stress * soft.slip_growth - (of.lam * least) ** 2
    return np.where(debonded, by_integral / np.where(debonded, soft.slope, 1.0), soft.slope_growth)
