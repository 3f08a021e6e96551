"""Mixed-mode softening: opening and slip together, in three shapes with two criteria of toughness.

With the elastic energy of the undamaged bond in each mode, per area, and the share B of slip in it,

    x^2/2 = kn <opening>^2 / 2 + ks slip^2 / 2             B = (ks slip^2 / 2) / (x^2/2)             <a> = max(a, 0)

damage begins where the stresses reach the quadratic criterion, and all the energy is spent where they have done G_c:

    (sigma / tension)^2 + (tau / shear)^2 = 1  at  x = peak:   peak^-2 = (1 - B) kn / tension^2 + B ks / shear^2
    *_bk      G_c = G_I + (G_II - G_I) B^eta
    *_power   ((1 - B) G_c / G_I)^alpha + (B G_c / G_II)^alpha = 1

(kn, ks per area [Pa/m].) x is the effective opening sqrt(<opening>^2 + slip^2) times the root of the stiffness in its
direction. The work of the stresses on any straight path is the integral of (1 - D) x dx, so that the shapes of
bilinear.py, exponential.py and trapezoidal.py, drawn over x, spend exactly G_c(B), with kn = ks or not; B is then the
share of slip in the energy spent. With past = G_c/peak - peak/2, what is spent beyond the peak divided by it:

    bilinear      end = peak + 2 past
    exponential   decay = past
    trapezoidal   plateau = peak + plateau_share past,    end = plateau + 2 (1 - plateau_share) past

plateau_share is the share of the energy beyond the peak that the plateau spends (of all of G_c it could be too much for
one direction and not for another): 0 is bilinear. Where G_c < peak^2/2, less than the bond holds at its strength, it
breaks there at once and spends that: take a stiffer bond. Memory is the damage itself, the largest that any state so
far has asked for: it never heals when the share B changes, and does not grow while a bond is unloaded. Pressure neither
adds to x nor is damaged. In a Bond, twist and bending soften with the rest but do not drive it.

Camanho & Davila, Mixed-mode decohesion finite elements for the simulation of delamination in composite materials,
NASA/TM-2002-211737 (2002); stiffnesses that differ: Turon, Gonzalez, Sarrado, Guillamet & Maimi, Compos. Struct. 184,
506-511 (2018). bk: Benzeggagh & Kenane, Compos. Sci. Technol. 56, 439-449 (1996); power: Whitcomb, NASA TM-86301
(1984), and Reeder, An evaluation of mixed-mode delamination failure criteria, NASA TM-104210 (1992).
"""

from typing import Any

from pybondem.laws.law import damage_law
from pybondem.laws.library.bilinear import bilinear_damage
from pybondem.laws.library.exponential import exponential_damage
from pybondem.laws.library.trapezoidal import trapezoidal_damage
from pybondem.laws.parameters import Parameter
from pybondem.ops import Number, maximum, power, sqrt
from pybondem.physics.types import Deformation

TINY = 1e-300  # keeps 0/0 away
BRITTLE = 1e-9  # the least that is spent beyond the peak, over what is spent before: keeps the shapes defined

STRENGTHS = {
    "tension": Parameter("Pa", "tensile strength", above=0.0, typical=2e6),
    "shear": Parameter("Pa", "shear strength", above=0.0, typical=3e6),
    "G_I": Parameter("J/m2", "fracture energy in opening", above=0.0, typical=100.0),
    "G_II": Parameter("J/m2", "fracture energy in slip", above=0.0, typical=300.0),
}
BK = {**STRENGTHS, "eta": Parameter("1", "exponent of Benzeggagh & Kenane", above=0.0, typical=2.0)}
POWER = {**STRENGTHS, "alpha": Parameter("1", "exponent of the power law", above=0.0, typical=1.0)}
PLATEAU = {"plateau_share": Parameter("1", "plateau in the energy beyond the peak", least=0.0, most=0.99, typical=0.5)}
TOUGHNESS = {
    "opening": lambda p, k: maximum(p.G_I, 0.5 * p.tension * p.tension / k),
    "slip": lambda p, k: maximum(p.G_II, 0.5 * p.shear * p.shear / k),
}
MEMORY = {"largest": "1"}


def mixed(d: Deformation, p: Any) -> tuple[Number, Number, Number]:
    """Return x now, x at the peak in this direction [sqrt(J/m2)], and the share B of slip."""
    opening = maximum(d.opening, 0.0)
    normal, shear = d.normal_stiffness * opening * opening, d.shear_stiffness * d.slip * d.slip
    share = shear / maximum(normal + shear, TINY)
    tension = (1.0 - share) * d.normal_stiffness / (p.tension * p.tension)
    peak = 1.0 / sqrt(maximum(tension + share * d.shear_stiffness / (p.shear * p.shear), TINY))
    return sqrt(normal + shear), peak, share


def past(peak: Number, toughness: Number) -> Number:
    """Return what is spent beyond the peak, divided by it [sqrt(J/m2)]."""
    return maximum(toughness / peak - 0.5 * peak, BRITTLE * peak)


def bk_toughness(share: Number, p: Any) -> Number:
    """Return G_c [J/m2] of Benzeggagh & Kenane."""
    return p.G_I + (p.G_II - p.G_I) * power(share, p.eta)


def power_toughness(share: Number, p: Any) -> Number:
    """Return G_c [J/m2] of the power law."""
    spent = power((1.0 - share) / p.G_I, p.alpha) + power(share / p.G_II, p.alpha)
    return power(spent, -1.0 / p.alpha)


def bilinear_mixed(x: Number, peak: Number, toughness: Number) -> Number:
    """Return the damage of the bilinear shape that spends `toughness` in all."""
    return bilinear_damage(maximum(x, peak), peak, peak + 2.0 * past(peak, toughness))


def exponential_mixed(x: Number, peak: Number, toughness: Number) -> Number:
    """Return the damage of the exponential shape that spends `toughness` in all."""
    return exponential_damage(maximum(x, peak), peak, past(peak, toughness))


def trapezoidal_mixed(x: Number, peak: Number, toughness: Number, plateau_share: Number) -> Number:
    """Return the damage of the trapezoidal shape that spends `toughness` in all."""
    beyond = past(peak, toughness)
    plateau = peak + plateau_share * beyond
    return trapezoidal_damage(maximum(x, peak), peak, plateau, plateau + 2.0 * (1.0 - plateau_share) * beyond)


@damage_law(parameters=BK, memory=MEMORY, toughness=TOUGHNESS)
def bilinear_bk(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Linear softening in mixed mode, toughness of Benzeggagh & Kenane (1996)."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, bilinear_mixed(x, peak, bk_toughness(share, p)))
    return largest, largest


@damage_law(parameters=POWER, memory=MEMORY, toughness=TOUGHNESS)
def bilinear_power(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Linear softening in mixed mode, toughness of the power law."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, bilinear_mixed(x, peak, power_toughness(share, p)))
    return largest, largest


@damage_law(parameters=BK, memory=MEMORY, toughness=TOUGHNESS)
def exponential_bk(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Exponential softening in mixed mode, toughness of Benzeggagh & Kenane (1996)."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, exponential_mixed(x, peak, bk_toughness(share, p)))
    return largest, largest


@damage_law(parameters=POWER, memory=MEMORY, toughness=TOUGHNESS)
def exponential_power(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """Exponential softening in mixed mode, toughness of the power law."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, exponential_mixed(x, peak, power_toughness(share, p)))
    return largest, largest


@damage_law(parameters=BK | PLATEAU, memory=MEMORY, toughness=TOUGHNESS)
def trapezoidal_bk(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """A plateau and linear softening in mixed mode, toughness of Benzeggagh & Kenane (1996)."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, trapezoidal_mixed(x, peak, bk_toughness(share, p), p.plateau_share))
    return largest, largest


@damage_law(parameters=POWER | PLATEAU, memory=MEMORY, toughness=TOUGHNESS)
def trapezoidal_power(d: Deformation, m: Any, p: Any) -> tuple[Number, Number]:
    """A plateau and linear softening in mixed mode, toughness of the power law."""
    x, peak, share = mixed(d, p)
    largest = maximum(m.largest, trapezoidal_mixed(x, peak, power_toughness(share, p), p.plateau_share))
    return largest, largest
