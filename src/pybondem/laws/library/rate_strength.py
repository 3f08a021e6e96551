"""Brittle strength that grows with the logarithm of the strain rate.

    F_n/A + beta |M_b| Rb/I > g tension    or    |F_s|/A + beta |M_t| Rb/J > g shear
    g = 1 + C ln(max(rate / reference_rate, 1))      rate = sqrt(opening rate^2 + slip rate^2) / length

The factor of Johnson & Cook on the strengths of Potyondy & Cundall. The rate is that of this very step: a bond that was
stretched fast and then held must bear its load with the static strength.

Johnson & Cook, Fracture characteristics of three metals subjected to various strains, strain rates, temperatures and
pressures, Eng. Fract. Mech. 21, 31-48 (1985); the strengths: see strength.py.
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, log, maximum, sqrt, where
from pybondem.physics.types import Deformation, Rate


@damage_law(
    parameters={
        "tension": Parameter("Pa", "static tensile strength", above=0.0, typical=5e6),
        "shear": Parameter("Pa", "static shear strength", above=0.0, typical=10e6),
        "C": Parameter("1", "growth of strength with the logarithm of the rate", least=0.0, typical=0.02),
        "reference_rate": Parameter("1/s", "strain rate up to which strength is static", above=0.0, typical=1e-3),
        "moment_share": Parameter("1", "share beta of the moments", least=0.0, most=1.0, default=1.0, typical=1.0),
    },
    memory={"broken": "1"},
)
def rate_strength(d: Deformation, m: Any, p: Any, rate: Rate) -> tuple[Number, Number]:
    """Brittle bond whose strengths grow with the strain rate as in Johnson & Cook (1985)."""
    strain_rate = sqrt(rate.opening * rate.opening + rate.slip * rate.slip) / d.length
    growth = 1.0 + p.C * log(maximum(strain_rate / p.reference_rate, 1.0))
    pulled = d.normal_stress + p.moment_share * d.bending_stress > growth * p.tension
    sheared = d.shear_stress + p.moment_share * d.twist_stress > growth * p.shear
    broken = where(pulled, 1.0, where(sheared, 1.0, m.broken))
    return broken, broken
