"""Plastic slip in the bond with linear kinematic hardening; opening, twist and bending stay elastic.

    F = ks (u - w)         X = H A w              u slip, w plastic slip, X back force: vectors across the bond
    |F - X| <= yield_stress A,  dw along F - X     H = hardening [Pa/m]; 0: perfectly plastic

    U = kn n^2/2 + ks |u - w|^2/2 + H A |w|^2/2 + kt twist^2/2 + kb |bending|^2/2

Each step moves the trial force back to the yield circle along its radius: exact while the slip keeps its direction, of
first order in the step where it turns. What is lost is yield_stress A |dw|; a cycle between -S and S loses
4 yield_stress A (ks S - yield_stress A) / (ks + H A).

Prager, A new method of analyzing stresses and strains in work-hardening plastic solids, J. Appl. Mech. 23, 493-496
(1956); the return: Simo & Hughes, Computational Inelasticity (Springer 1998), chapter 1.
"""

from typing import Any

from pybondem.laws.law import bond_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, sqrt
from pybondem.physics.types import Components, Loads, Stiffness

TINY = 1e-300  # keeps 0/0 away


def plastic_slip_energy(d: Components, k: Stiffness, m: Any, p: Any) -> Number:
    """Return the energy U [J] that the bond holds."""
    s, t = d.s - m.slip_s, d.t - m.slip_t
    hardened = p.hardening * d.area * (m.slip_s * m.slip_s + m.slip_t * m.slip_t)
    rotation = k.kt * d.twist * d.twist + k.kb * (d.bend_s * d.bend_s + d.bend_t * d.bend_t)
    return 0.5 * (k.kn * d.n * d.n + k.ks * (s * s + t * t) + hardened + rotation)


@bond_law(
    parameters={
        "yield_stress": Parameter("Pa", "shear stress where slip begins", above=0.0, typical=5e6),
        "hardening": Parameter("Pa/m", "back stress for a plastic slip", least=0.0, default=0.0, typical=1e11),
    },
    memory={"slip_s": "m", "slip_t": "m"},
    potential=plastic_slip_energy,
)
def plastic_slip(d: Components, k: Stiffness, m: Any, p: Any) -> tuple[Loads, Number, Number]:
    """Elastic-plastic slip with kinematic hardening (Prager 1956)."""
    back = p.hardening * d.area
    s = k.ks * (d.s - m.slip_s) - back * m.slip_s
    t = k.ks * (d.t - m.slip_t) - back * m.slip_t
    size = sqrt(s * s + t * t)
    flow = maximum(0.0, size - p.yield_stress * d.area) / maximum(k.ks + back, TINY) / maximum(size, TINY)
    slip_s, slip_t = m.slip_s + flow * s, m.slip_t + flow * t
    shear_s, shear_t = k.ks * (d.s - slip_s), k.ks * (d.t - slip_t)
    return Loads(k.kn * d.n, shear_s, shear_t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t), slip_s, slip_t
