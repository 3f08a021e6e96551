"""Bilinear softening: stress rises to a peak, then falls on a straight line to nothing; unloading to the origin.

    D = 0                                       x <= peak
    D = end (x - peak) / (x (end - peak))       peak < x < end         G_f = k peak end / 2
    D = 1                                       x >= end

with x the largest slip (bilinear) or opening (bilinear_tension) so far, and k the stiffness per area [Pa/m]; k peak is
the strength [Pa].

Hillerborg, Modeer & Petersson, Analysis of crack formation and crack growth in concrete by means of fracture mechanics
and finite elements, Cem. Concr. Res. 6, 773-781 (1976), in tension; on the slip of an interface: Ren, Yang, Chen &
Chen, Constr. Build. Mater. 24, 361-370 (2010), whose third piece, friction that stays, is nothing here.
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, minimum
from pybondem.physics.types import Deformation


def bilinear_damage(x: Number, peak: Number, end: Number) -> Number:
    """Return the damage at x >= peak, the largest opening or slip so far."""
    return minimum(1.0, end * (x - peak) / (x * (end - peak)))


@damage_law(
    parameters={
        "slip_peak": Parameter("m", "slip where softening begins", above=0.0, typical=1e-5),
        "slip_end": Parameter("m", "slip where nothing is left", above=0.0, typical=5e-5),
    },
    memory={"largest": "m"},
    needs={"slip_end > slip_peak": lambda p: p.slip_end > p.slip_peak},
    toughness={"slip": lambda p, k: 0.5 * k * p.slip_peak * p.slip_end},
)
def bilinear(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Linear softening on the slip."""
    largest = maximum(m.largest, d.slip)
    return bilinear_damage(maximum(largest, p.slip_peak), p.slip_peak, p.slip_end), largest


@damage_law(
    parameters={
        "opening_peak": Parameter("m", "opening where softening begins", above=0.0, typical=1e-5),
        "opening_end": Parameter("m", "opening where nothing is left", above=0.0, typical=5e-5),
    },
    memory={"largest": "m"},
    needs={"opening_end > opening_peak": lambda p: p.opening_end > p.opening_peak},
    toughness={"opening": lambda p, k: 0.5 * k * p.opening_peak * p.opening_end},
)
def bilinear_tension(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Linear softening on the opening."""
    largest = maximum(m.largest, d.opening)
    return bilinear_damage(maximum(largest, p.opening_peak), p.opening_peak, p.opening_end), largest
