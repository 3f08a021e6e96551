"""Exponential softening: stress rises to a peak, then decays and never quite ends; unloading to the origin.

    stress = k peak exp(-(x - peak) / decay)        x > peak            G_f = k peak (peak/2 + decay)
    D = 1 - (peak / x) exp(-(x - peak) / decay)

with x the largest slip (exponential) or opening (exponential_tension) so far, and k the stiffness per area [Pa/m].
decay is a length [m], over which the stress falls to 37 %: decay = G_f / (k peak) - peak/2.

Gopalaratnam & Shah, Softening response of plain concrete in direct tension, ACI J. 82 (3), 310-323 (1985), with the
exponent 1 on the opening, and with a linear rise before the peak.
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, exp, maximum
from pybondem.physics.types import Deformation


def exponential_damage(x: Number, peak: Number, decay: Number) -> Number:
    """Return the damage at x >= peak, the largest opening or slip so far."""
    return 1.0 - peak / x * exp((peak - x) / decay)


@damage_law(
    parameters={
        "slip_peak": Parameter("m", "slip where softening begins", above=0.0, typical=1e-5),
        "slip_decay": Parameter("m", "further slip in which the stress falls to 37 %", above=0.0, typical=2e-5),
    },
    memory={"largest": "m"},
    toughness={"slip": lambda p, k: k * p.slip_peak * (0.5 * p.slip_peak + p.slip_decay)},
)
def exponential(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Exponential softening on the slip."""
    largest = maximum(m.largest, d.slip)
    return exponential_damage(maximum(largest, p.slip_peak), p.slip_peak, p.slip_decay), largest


@damage_law(
    parameters={
        "opening_peak": Parameter("m", "opening where softening begins", above=0.0, typical=1e-5),
        "opening_decay": Parameter("m", "further opening in which the stress falls to 37 %", above=0.0, typical=2e-5),
    },
    memory={"largest": "m"},
    toughness={"opening": lambda p, k: k * p.opening_peak * (0.5 * p.opening_peak + p.opening_decay)},
)
def exponential_tension(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Exponential softening on the opening."""
    largest = maximum(m.largest, d.opening)
    return exponential_damage(maximum(largest, p.opening_peak), p.opening_peak, p.opening_decay), largest
