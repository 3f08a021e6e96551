"""Cohesion that softens beside friction that slips: the same stress as `bilinear_residual` while slip grows.

The bond is two parts side by side, of shares 1 - residual and residual of its shear stiffness ks:

    cohesion   (1 - D) (1 - residual) ks u          D that of bilinear.py at the largest slip so far
    friction   residual ks (u - w),  held to  |u - w| <= slip_peak:  beyond, w follows along u - w

    U = (1 - D) (kn <n>^2 + (1 - residual) ks |u|^2 + kt twist^2 + kb |bending|^2)/2 + kn <-n>^2/2
        + residual ks |u - w|^2/2                                                      <a> = max(a, 0)

u slip, w plastic slip: vectors across the bond. Both parts begin to give at slip_peak and the cohesion is gone at
slip_end, so that slip that only grows meets the three straight lines of `bilinear_residual`: a peak k slip_peak, and
the friction residual k slip_peak [Pa] (k = ks over area) that stays. A bond that slips back unloads with the stiffness
(1 - D) (1 - residual) k + residual k, its friction slips the other way after 2 slip_peak, and a full cycle of friction
between -S and S loses 4 residual k slip_peak (S - slip_peak) per area. Tension, twist and bending soften with the
cohesion and do not drive it; pressure is borne whole, and friction does not ask for it. Memory is D and w.

Each step moves u - w back to its circle along its radius: exact while slip keeps its direction, of first order in the
step where it turns.

Alfano & Sacco, Combining interface damage and friction in a cohesive-zone model, Int. J. Numer. Meth. Engng 68,
542-582 (2006), put damage beside friction. Theirs is Coulomb friction on the damaged share D of the area, limited by
the pressure there; here it acts from the beginning, on a share of its own, with a yield stress that is given. The three
lines: Ren, Yang, Chen & Chen, Constr. Build. Mater. 24, 361-370 (2010). The return: Simo & Hughes, Computational
Inelasticity (Springer 1998), chapter 1.
"""

from typing import Any

from pybondem.laws.law import bond_law
from pybondem.laws.library.bilinear import bilinear_damage
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, minimum, sqrt
from pybondem.physics.types import Components, Loads, Stiffness


def bilinear_friction_energy(d: Components, k: Stiffness, m: Any, p: Any) -> Number:
    """Return the energy U [J] that the bond holds."""
    s, t, pulled, pressed = d.s - m.slip_s, d.t - m.slip_t, maximum(d.n, 0.0), minimum(d.n, 0.0)
    rotation = k.kt * d.twist * d.twist + k.kb * (d.bend_s * d.bend_s + d.bend_t * d.bend_t)
    cohesion = k.kn * pulled * pulled + (1.0 - p.residual) * k.ks * (d.s * d.s + d.t * d.t) + rotation
    friction = p.residual * k.ks * (s * s + t * t)
    return 0.5 * ((1.0 - m.damage) * cohesion + friction + k.kn * pressed * pressed)


@bond_law(
    parameters={
        "slip_peak": Parameter("m", "slip where both parts give", above=0.0, typical=1e-5),
        "slip_end": Parameter("m", "slip where only friction is left", above=0.0, typical=5e-5),
        "residual": Parameter("1", "share of the peak stress that stays", least=0.0, most=1.0, typical=0.3),
    },
    memory={"damage": "1", "slip_s": "m", "slip_t": "m"},
    needs={"slip_end > slip_peak": lambda p: p.slip_end > p.slip_peak},
    potential=bilinear_friction_energy,
)
def bilinear_friction(d: Components, k: Stiffness, m: Any, p: Any) -> tuple[Loads, Number, Number, Number]:
    """Linear softening of cohesion beside elastic-plastic friction."""
    slip = sqrt(d.s * d.s + d.t * d.t)
    D = maximum(m.damage, bilinear_damage(maximum(slip, p.slip_peak), p.slip_peak, p.slip_end))
    s, t = d.s - m.slip_s, d.t - m.slip_t
    back = minimum(1.0, p.slip_peak / maximum(sqrt(s * s + t * t), p.slip_peak))
    s, t, left = back * s, back * t, 1.0 - D
    n = k.kn * (left * maximum(d.n, 0.0) + minimum(d.n, 0.0))
    tied, rubbed = left * (1.0 - p.residual) * k.ks, p.residual * k.ks
    loads = Loads(n, tied * d.s + rubbed * s, tied * d.t + rubbed * t, left * k.kt * d.twist,
                  left * k.kb * d.bend_s, left * k.kb * d.bend_t)  # fmt: skip
    return loads, D, d.s - s, d.t - t
