"""Bilinear softening down to a friction that stays: the trilinear law of interfaces; unloading to the origin.

    stress = k x                                                             x <= peak
    stress = k peak (residual + (1 - residual) (end - x) / (end - peak))     peak < x < end
    stress = k peak residual                                                 x >= end, for ever
    D = 1 - stress / (k x)

with x the largest slip so far, and k the stiffness per area [Pa/m]; k peak is the strength [Pa], and residual = tau_r /
(k peak) the share of it that stays, so that it holds whatever the stiffness of a bond: 0 is `bilinear`, 1 a plateau
for ever. D comes near 1 and never there, and the work has no end, so no toughness is declared.

Meant for slip that grows, as along a fibre that is pulled out: a bond that slips back goes along its secant to the
origin and gives half of the work of friction back, which friction does not do. `bilinear_friction` has the same stress
while slip grows, and unloads as cohesion and friction do.

Ren, Yang, Chen & Chen, Analytical analysis and numerical simulation of grouted rock bolts, Constr. Build. Mater. 24,
361-370 (2010): the trilinear stress-slip law, for slip that grows; damage and its secant were added here.
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum
from pybondem.physics.types import Deformation


def bilinear_residual_damage(x: Number, peak: Number, end: Number, residual: Number) -> Number:
    """Return the damage at x >= peak, the largest slip so far."""
    stress = residual + (1.0 - residual) * maximum(0.0, (end - x) / (end - peak))  # over that of the peak
    return 1.0 - stress * peak / x


@damage_law(
    parameters={
        "slip_peak": Parameter("m", "slip where softening begins", above=0.0, typical=1e-5),
        "slip_end": Parameter("m", "slip where only friction is left", above=0.0, typical=5e-5),
        "residual": Parameter("1", "share of the peak stress that stays", least=0.0, most=1.0, typical=0.3),
    },
    memory={"largest": "m"},
    needs={"slip_end > slip_peak": lambda p: p.slip_end > p.slip_peak},
)
def bilinear_residual(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Linear softening on the slip, to a residual stress."""
    largest = maximum(m.largest, d.slip)
    return bilinear_residual_damage(maximum(largest, p.slip_peak), p.slip_peak, p.slip_end, p.residual), largest
