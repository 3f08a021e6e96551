"""Thermal expansion: the length at which a bond is free of stress grows with a rise of temperature.

    n0 = expansion heating length f(t)          f = min(1, t / over), or 1 from the start for over = 0
    F_n = kn (n - n0)                           U = kn (n - n0)^2/2 + the elastic rest

t is the time that the bond has lived [s]; cooling is a negative heating. The energy that heating puts into the bond
shows in the energy book as a negative loss. The thermal strain of Timoshenko & Goodier, Theory of Elasticity, 3rd ed.
(McGraw-Hill 1970), chapter 13, on the length of the bond.
"""

from typing import Any

from pybondem.laws.law import bond_law
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, minimum, where
from pybondem.physics.types import Components, Loads, Stiffness

TINY = 1e-300  # keeps 0/0 away


def free_elongation(d: Components, elapsed: Number, p: Any) -> Number:
    """Return the elongation n0 [m] at which the bond is free of stress, after so many seconds."""
    done = where(p.over > 0.0, minimum(1.0, elapsed / maximum(p.over, TINY)), 1.0)
    return p.expansion * p.heating * d.length * done


def thermal_energy(d: Components, k: Stiffness, m: Any, p: Any) -> Number:
    """Return the energy U [J] that the bond holds."""
    n = d.n - free_elongation(d, m.elapsed, p)
    rotation = k.kt * d.twist * d.twist + k.kb * (d.bend_s * d.bend_s + d.bend_t * d.bend_t)
    return 0.5 * (k.kn * n * n + k.ks * (d.s * d.s + d.t * d.t) + rotation)


@bond_law(
    parameters={
        "expansion": Parameter("1/K", "coefficient of thermal expansion", typical=1e-5),
        "heating": Parameter("K", "rise of temperature", typical=50.0),
        "over": Parameter("s", "time in which it rises", least=0.0, default=0.0, typical=1e-3),
    },
    memory={"elapsed": "s"},
    potential=thermal_energy,
)
def thermal(d: Components, k: Stiffness, m: Any, p: Any, dt: Number) -> tuple[Loads, Number]:
    """Elastic bond with thermal expansion of its length."""
    elapsed = m.elapsed + dt
    n = d.n - free_elongation(d, elapsed, p)
    loads = Loads(k.kn * n, k.ks * d.s, k.ks * d.t, k.kt * d.twist, k.kb * d.bend_s, k.kb * d.bend_t)
    return loads, elapsed
