"""Brittle strength: a bond breaks at once where a stress exceeds a strength.

    F_n/A + beta |M_b| Rb/I > tension    or    |F_s|/A + beta |M_t| Rb/J > shear

with the stresses of beam theory at the rim of the bond; the share beta <= 1 of the moments is for the yielding of a rim
that a linear stress does not know. A broken bond that is pressed together keeps its normal stiffness.

Potyondy & Cundall, A bonded-particle model for rock, Int. J. Rock Mech. Min. Sci. 41, 1329-1364 (2004), eq. 15; beta:
Potyondy, Parallel-bond refinements to match macroproperties of hard rock, Proc. 2nd Int. FLAC/DEM Symp. (2011).
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, where
from pybondem.physics.types import Deformation


@damage_law(
    parameters={
        "tension": Parameter("Pa", "tensile strength", above=0.0, typical=5e6),
        "shear": Parameter("Pa", "shear strength", above=0.0, typical=10e6),
        "moment_share": Parameter("1", "share beta of the moments", least=0.0, most=1.0, default=1.0, typical=1.0),
    },
    memory={"broken": "1"},
)
def strength(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Brittle bond of Potyondy & Cundall (2004): broken where a stress exceeds the tensile or the shear strength."""
    pulled = d.normal_stress + p.moment_share * d.bending_stress > p.tension
    sheared = d.shear_stress + p.moment_share * d.twist_stress > p.shear
    broken = where(pulled, 1.0, where(sheared, 1.0, m.broken))
    return broken, broken
