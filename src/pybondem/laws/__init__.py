"""Laws of bonds: the published ones by name. `damage_law` and `bond_law` declare one's own."""

from pybondem.laws.library.bilinear import bilinear, bilinear_tension
from pybondem.laws.library.bilinear_friction import bilinear_friction
from pybondem.laws.library.bilinear_residual import bilinear_residual
from pybondem.laws.library.concrete import concrete
from pybondem.laws.library.exponential import exponential, exponential_tension
from pybondem.laws.library.mixed_mode import (
    bilinear_bk,
    bilinear_power,
    exponential_bk,
    exponential_power,
    trapezoidal_bk,
    trapezoidal_power,
)
from pybondem.laws.library.mohr_coulomb import mohr_coulomb
from pybondem.laws.library.plastic_slip import plastic_slip
from pybondem.laws.library.rate_strength import rate_strength
from pybondem.laws.library.strength import strength
from pybondem.laws.library.thermal import thermal
from pybondem.laws.library.trapezoidal import trapezoidal, trapezoidal_tension

__all__ = [
    "strength", "mohr_coulomb", "rate_strength",
    "bilinear", "bilinear_tension", "exponential", "exponential_tension", "trapezoidal", "trapezoidal_tension",
    "bilinear_bk", "bilinear_power", "exponential_bk", "exponential_power", "trapezoidal_bk", "trapezoidal_power",
    "concrete", "bilinear_residual",
    "bilinear_friction", "plastic_slip", "thermal",
]  # fmt: skip
