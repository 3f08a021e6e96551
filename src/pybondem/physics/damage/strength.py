"""Brittle strength of a bond: it breaks when a stress reaches a strength.

    F_n/A + beta |M_b| Rb/I > tension   or   |F_s|/A + beta |M_t| Rb/J > shear

Potyondy & Cundall, Int. J. Rock Mech. Min. Sci. 41 (2004), eq. 15; the moment share beta: Potyondy, Proc. 2nd Int.
FLAC/DEM Symp. (2011).
"""

from typing import NamedTuple

from pybondem.ops import Number, where
from pybondem.physics.types import Deformation


class StrengthParameters(NamedTuple):
    """tension [Pa], shear [Pa], moment_share beta [-] in [0, 1]."""

    tension: Number
    shear: Number
    moment_share: Number


class StrengthMemory(NamedTuple):
    """broken: 0 while whole, 1 once the strength has been exceeded."""

    broken: Number


def strength_damage(d: Deformation, m: StrengthMemory, p: StrengthParameters) -> tuple[Number, StrengthMemory]:
    """Return damage (0 or 1) and memory of a brittle bond."""
    pulled = d.normal_stress + p.moment_share * d.bending_stress > p.tension
    sheared = d.shear_stress + p.moment_share * d.twist_stress > p.shear
    broken = where(pulled, 1.0, where(sheared, 1.0, m.broken))
    return broken, StrengthMemory(broken)
