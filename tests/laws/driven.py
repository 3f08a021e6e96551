"""Laws called as an engine calls them, on numbers, one state after the other; and the library with values to try."""

from collections.abc import Iterable, Sequence
from typing import Any

from pybondem import laws as library
from pybondem.bonds import ValuedLaw
from pybondem.physics.types import ComponentRates, Components, Deformation, Loads, Rate, Stiffness

KN, KS = 2e11, 0.5e11  # normal and shear stiffness per area [Pa/m]
LENGTH, AREA = 8e-3, 5e-5

# Every law with one set of values.
LAWS = {
    "strength": library.strength(tension=5e6, shear=3e6),
    "mohr_coulomb": library.mohr_coulomb(cohesion=10e6, friction=0.5, tension=4e6),
    "rate_strength": library.rate_strength(tension=4e6, shear=8e6, C=0.1, reference_rate=1e-3),
    "bilinear": library.bilinear(slip_peak=1e-5, slip_end=5e-5),
    "bilinear_tension": library.bilinear_tension(opening_peak=1e-5, opening_end=5e-5),
    "exponential": library.exponential(slip_peak=1e-5, slip_decay=2e-5),
    "exponential_tension": library.exponential_tension(opening_peak=1e-5, opening_decay=2e-5),
    "trapezoidal": library.trapezoidal(slip_peak=1e-5, slip_plateau=3e-5, slip_end=6e-5),
    "trapezoidal_tension": library.trapezoidal_tension(opening_peak=1e-5, opening_plateau=3e-5, opening_end=6e-5),
    "bilinear_bk": library.bilinear_bk(tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, eta=2.0),
    "bilinear_power": library.bilinear_power(tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, alpha=1.0),
    "exponential_bk": library.exponential_bk(tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, eta=2.0),
    "exponential_power": library.exponential_power(tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, alpha=1.0),
    "trapezoidal_bk": library.trapezoidal_bk(tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, eta=2.0, plateau_share=0.4),
    "trapezoidal_power": library.trapezoidal_power(
        tension=3e6, shear=5e6, G_I=100.0, G_II=300.0, alpha=1.0, plateau_share=0.4
    ),
    "concrete": library.concrete(threshold=1e-4, alpha=0.96, beta=350.0),
    "bilinear_residual": library.bilinear_residual(slip_peak=1e-5, slip_end=5e-5, residual=0.3),
    "bilinear_friction": library.bilinear_friction(slip_peak=1e-5, slip_end=5e-5, residual=0.3),
    "plastic_slip": library.plastic_slip(yield_stress=1e6, hardening=1e10),
    "thermal": library.thermal(expansion=1e-5, heating=50.0, over=1e-3),
}
DAMAGE_LAWS = [name for name, law in LAWS.items() if law.kind == "damage"]


def deformation(opening: float = 0.0, slip: float = 0.0, bending_stress: float = 0.0, twist_stress: float = 0.0,
                kn: float = KN, ks: float = KS) -> Deformation:  # fmt: skip
    """Return what a damage law sees; kn, ks: stiffness per area [Pa/m]."""
    return Deformation(
        opening, slip, 0.0, 0.0, LENGTH, AREA, kn * opening, ks * slip, bending_stress, twist_stress, kn, ks
    )


def damages(law: ValuedLaw, states: Iterable[Deformation], rates: Sequence[Rate] | None = None) -> list[float]:
    """Return the damage after each of the states that a bond goes through."""
    found, memory = [], law.memory(*(0.0 for _ in law.memory._fields))
    for step, d in enumerate(states):
        rate = Rate(0.0, 0.0, 0.0, 0.0) if rates is None else rates[step]
        damage, words = law.function(d, None, memory, law.parameters, rate, 0.0)
        found.append(damage)
        memory = law.memory(*words)
    return found


def answers(law: ValuedLaw, states: Iterable[Components], k: Stiffness, dt: float = 0.0) -> list[tuple[Loads, Any]]:
    """Return the loads and the memory after each of the states that a bond goes through, dt [s] apart."""
    found, memory, rate = [], law.memory(*(0.0 for _ in law.memory._fields)), ComponentRates(*(0.0,) * 6)
    for d in states:
        loads, words = law.function(d, k, memory, law.parameters, rate, dt)
        memory = law.memory(*words)
        found.append((loads, memory))
    return found
