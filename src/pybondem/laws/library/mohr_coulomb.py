"""Brittle strength after Mohr and Coulomb: pressure adds to the shear strength, a tensile strength cuts it off.

    sigma = F_n/A         sigma + beta |M_b| Rb/I > tension                             broken in tension
    tau = |F_s|/A         tau + beta |M_t| Rb/J > cohesion - friction sigma             broken in shear

sigma is the mean normal stress, positive in tension; friction = tan(phi), the coefficient and not the angle, because it
is what enters. Where tension exceeds cohesion / friction the line of the shear strength alone decides. The broken bond
carries no shear: friction between the particles afterwards is not part of this law.

Labuz & Zang, Mohr-Coulomb failure criterion, Rock Mech. Rock Eng. 45, 975-979 (2012); for a parallel bond, with the
moment share beta: Potyondy, Parallel-bond refinements to match macroproperties of hard rock, Proc. 2nd Int. FLAC/DEM
Symp. (2011).
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, where
from pybondem.physics.types import Deformation


@damage_law(
    parameters={
        "cohesion": Parameter("Pa", "shear strength without normal stress", above=0.0, typical=10e6),
        "friction": Parameter("1", "tangent of the angle of friction", least=0.0, typical=0.7),
        "tension": Parameter("Pa", "tensile strength", above=0.0, typical=5e6),
        "moment_share": Parameter("1", "share beta of the moments", least=0.0, most=1.0, default=1.0, typical=1.0),
    },
    memory={"broken": "1"},
)
def mohr_coulomb(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Brittle bond whose shear strength grows with pressure, with a tensile strength."""
    pulled = d.normal_stress + p.moment_share * d.bending_stress > p.tension
    sheared = d.shear_stress + p.moment_share * d.twist_stress > p.cohesion - p.friction * d.normal_stress
    broken = where(pulled, 1.0, where(sheared, 1.0, m.broken))
    return broken, broken
