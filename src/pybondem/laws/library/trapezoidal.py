"""Trapezoidal softening: stress rises to a peak, stays there, then falls on a straight line; unloading to the origin.

    stress = k peak                                 peak < x <= plateau
    stress = k peak (end - x) / (end - plateau)     plateau < x < end        G_f = k peak (end + plateau - peak) / 2
    D = 1 - stress / (k x)

with x the largest slip (trapezoidal) or opening (trapezoidal_tension) so far, and k the stiffness per area [Pa/m].

Tvergaard & Hutchinson, The relation between crack growth resistance and fracture process parameters in elastic-plastic
solids, J. Mech. Phys. Solids 40, 1377-1397 (1992): for bonds that yield before they soften.
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, minimum
from pybondem.physics.types import Deformation


def trapezoidal_damage(x: Number, peak: Number, plateau: Number, end: Number) -> Number:
    """Return the damage at x >= peak, the largest opening or slip so far; the plateau lasts from peak to plateau."""
    stress = minimum(1.0, maximum(0.0, (end - x) / (end - plateau)))  # over that of the peak
    return 1.0 - stress * peak / x


@damage_law(
    parameters={
        "slip_peak": Parameter("m", "slip where the plateau begins", above=0.0, typical=1e-5),
        "slip_plateau": Parameter("m", "slip where the plateau ends", above=0.0, typical=3e-5),
        "slip_end": Parameter("m", "slip where nothing is left", above=0.0, typical=6e-5),
    },
    memory={"largest": "m"},
    needs={
        "slip_plateau >= slip_peak": lambda p: p.slip_plateau >= p.slip_peak,
        "slip_end > slip_plateau": lambda p: p.slip_end > p.slip_plateau,
    },
    toughness={"slip": lambda p, k: 0.5 * k * p.slip_peak * (p.slip_end + p.slip_plateau - p.slip_peak)},
)
def trapezoidal(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """A plateau and linear softening on the slip."""
    largest = maximum(m.largest, d.slip)
    return trapezoidal_damage(maximum(largest, p.slip_peak), p.slip_peak, p.slip_plateau, p.slip_end), largest


@damage_law(
    parameters={
        "opening_peak": Parameter("m", "opening where the plateau begins", above=0.0, typical=1e-5),
        "opening_plateau": Parameter("m", "opening where the plateau ends", above=0.0, typical=3e-5),
        "opening_end": Parameter("m", "opening where nothing is left", above=0.0, typical=6e-5),
    },
    memory={"largest": "m"},
    needs={
        "opening_plateau >= opening_peak": lambda p: p.opening_plateau >= p.opening_peak,
        "opening_end > opening_plateau": lambda p: p.opening_end > p.opening_plateau,
    },
    toughness={"opening": lambda p, k: 0.5 * k * p.opening_peak * (p.opening_end + p.opening_plateau - p.opening_peak)},
)
def trapezoidal_tension(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """A plateau and linear softening on the opening."""
    largest = maximum(m.largest, d.opening)
    x = maximum(largest, p.opening_peak)
    return trapezoidal_damage(x, p.opening_peak, p.opening_plateau, p.opening_end), largest
