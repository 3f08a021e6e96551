"""What holds two particles together: an elastic form and a damage law, with their values.

In a script:

    Bond(parallel(E=1e9, stiffness_ratio=2.0), strength(tension=5e6, shear=10e6), damping=0.1)
    Joint(bilinear(stiffness=6e7, slip_peak=1e-4, slip_end=4e-4))
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import finite_array, fraction, nonnegative, positive, positive_array
from pybondem.errors import InputError
from pybondem.physics.damage.bilinear import BilinearMemory, BilinearParameters, bilinear_damage
from pybondem.physics.damage.strength import StrengthMemory, StrengthParameters, strength_damage
from pybondem.physics.elastic.beam import euler_bernoulli_stiffness, timoshenko_stiffness
from pybondem.physics.elastic.parallel import parallel_stiffness
from pybondem.physics.types import DamageFunction, Stiffness

Value = float | NDArray[np.float64]


@dataclass(frozen=True)
class Elastic:
    """An elastic form: stiffness(radius [m], length [m]); radius_ratio: bond radius / smaller particle radius."""

    stiffness: Callable[[Value, Value], Stiffness]
    radius_ratio: float = 1.0


@dataclass(frozen=True)
class DamageLaw:
    """A damage law with its values.

    function(deformation, memory, parameters) -> (damage, memory), in the words of `ops`; parameters: the values as a
    named tuple of numbers, or arrays with one value per bond; memory: the type of its memory, which starts at zero;
    stiffness: shear stiffness per area [Pa/m] that the law brings for joints, if any.
    """

    function: DamageFunction
    parameters: Any
    memory: type[Any]
    stiffness: float | None = None


@dataclass(frozen=True)
class Bond:
    """A bond: elastic form, damage law (None: unbreakable), damping ratio zeta of its dashpots [-]."""

    elastic: Elastic
    damage: DamageLaw | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.elastic, Elastic):
            raise InputError(f"Bond needs an elastic form (parallel, timoshenko, springs ...), got {self.elastic!r}.")
        if self.damage is not None and not isinstance(self.damage, DamageLaw):
            raise InputError(f"The damage of Bond is {self.damage!r}; give a damage law (strength, bilinear) or None.")
        if self.damage is not None and self.damage.stiffness is not None:
            raise InputError("the law of Bond brings a stiffness per area, which is for Joint; leave stiffness out.")
        nonnegative("damping of Bond", self.damping, "1")


@dataclass(frozen=True)
class Joint:
    """An interface bond: a law that brings its shear stiffness per area, normal stiffness per area [Pa/m].

    normal_stiffness defaults to the shear stiffness; damping is the damping ratio zeta of its dashpots [-].
    """

    law: DamageLaw
    normal_stiffness: float | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.law, DamageLaw) or self.law.stiffness is None:
            raise InputError("Joint needs a law with a stiffness per area, for example bilinear(stiffness=6e7, ...).")
        if self.normal_stiffness is not None:
            nonnegative("normal_stiffness of Joint", self.normal_stiffness, "Pa/m")
        nonnegative("damping of Joint", self.damping, "1")

    def stiffness(self, area: Value) -> Stiffness:
        """Return the stiffness of joints that stand for the given areas [m2]: a number, or (m,)."""
        shear = self.law.stiffness
        assert shear is not None  # the law was checked when the joint was made
        normal = shear if self.normal_stiffness is None else self.normal_stiffness
        return Stiffness(normal * area, shear * area, 0.0, 0.0)


def parallel(E: float, stiffness_ratio: float, radius_ratio: float = 1.0) -> Elastic:
    """Return the parallel bond of Potyondy & Cundall (2004).

    E: modulus of the bond [Pa]; stiffness_ratio: kn/ks; radius_ratio: bond radius over the smaller particle radius.
    Raises InputError unless all are positive.
    """
    E, ratio = positive("E of parallel", E, "Pa"), positive("stiffness_ratio of parallel", stiffness_ratio, "1")
    return Elastic(lambda r, length: parallel_stiffness(E, ratio, r, length), _ratio(radius_ratio))


def timoshenko(E: float, nu: float, shear_factor: float = 0.9, radius_ratio: float = 1.0) -> Elastic:
    """Return the Timoshenko beam bond of Brown, Chen & Ooi (2014).

    E [Pa], nu: Poisson ratio of the bond material in (-1, 0.5]; shear_factor: shear correction of the section (0.9 for
    a circle); radius_ratio: bond radius over the smaller particle radius. Raises InputError outside these ranges.
    """
    E, G = positive("E of timoshenko", E, "Pa"), _shear_modulus("timoshenko", E, nu)
    factor = positive("shear_factor of timoshenko", shear_factor, "1")
    return Elastic(lambda r, length: timoshenko_stiffness(E, G, factor, r, length), _ratio(radius_ratio))


def euler_bernoulli(E: float, nu: float, radius_ratio: float = 1.0) -> Elastic:
    """Return the Euler-Bernoulli beam bond of Andre et al. (2012): E [Pa], nu in (-1, 0.5], radius ratio as above."""
    E, G = positive("E of euler_bernoulli", E, "Pa"), _shear_modulus("euler_bernoulli", E, nu)
    return Elastic(lambda r, length: euler_bernoulli_stiffness(E, G, r, length), _ratio(radius_ratio))


def springs(
    kn: ArrayLike, ks: ArrayLike, kt: ArrayLike = 0.0, kb: ArrayLike = 0.0, radius_ratio: float = 1.0
) -> Elastic:
    """Return plain springs: kn, ks [N/m], twist kt and bending kb [N m/rad], numbers or one value per bond.

    With kt = kb = 0 this is the lattice spring model of Born. Raises InputError where one is negative or not finite.
    """
    values = Stiffness(*(_stiffness(n, v) for n, v in zip(Stiffness._fields, (kn, ks, kt, kb), strict=True)))
    return Elastic(lambda r, length: values, _ratio(radius_ratio))


def strength(tension: ArrayLike, shear: ArrayLike, moment_share: float = 1.0) -> DamageLaw:
    """Return brittle strength: tension, shear [Pa], numbers or one value per bond; moment_share beta in [0, 1].

    Potyondy & Cundall (2004) with the moment share of Potyondy (2011). A broken bond that is pressed together keeps its
    normal stiffness. Raises InputError unless positive.
    """
    values = (_positive("tension of strength", tension, "Pa"), _positive("shear of strength", shear, "Pa"))
    share = fraction("moment_share of strength", moment_share, 0.0, 1.0)
    return DamageLaw(strength_damage, StrengthParameters(*values, share), StrengthMemory)


def bilinear(slip_peak: ArrayLike, slip_end: ArrayLike, stiffness: float | None = None) -> DamageLaw:
    """Return bilinear softening on the slip: onset slip_peak, failure slip_end [m], numbers or one value per bond.

    stiffness: shear stiffness per area k_S [Pa/m] when the law is used in a Joint; tau_max = k_S slip_peak and
    G_f = tau_max slip_end / 2. Raises InputError unless 0 < slip_peak < slip_end.
    """
    peak, end = _positive("slip_peak of bilinear", slip_peak, "m"), _positive("slip_end of bilinear", slip_end, "m")
    if np.ndim(peak) == np.ndim(end) == 1 and np.size(peak) != np.size(end):
        sizes = f"{np.size(peak)} and {np.size(end)}"
        raise InputError(
            f"slip_peak and slip_end of bilinear have {sizes} values; give as many of one as of the other."
        )
    low, high = np.broadcast_arrays(peak, end)
    if np.any(high <= low):
        k = int(np.argmax(high <= low))
        which = f"[{k}]" if high.ndim else ""
        raise InputError(
            f"slip_end of bilinear{which} is {high.flat[k]:g} m; it must exceed slip_peak, {low.flat[k]:g} m."
        )
    if stiffness is not None:
        stiffness = positive("stiffness of bilinear", stiffness, "Pa/m")
    return DamageLaw(bilinear_damage, BilinearParameters(peak, end), BilinearMemory, stiffness)


def _ratio(radius_ratio: float) -> float:
    return positive("radius_ratio", radius_ratio, "1")


def _shear_modulus(form: str, E: float, nu: float) -> float:
    nu = fraction(f"nu of {form}", nu, -1.0, 0.5)
    if nu == -1.0:
        raise InputError(f"nu of {form} is -1; it must be above -1 (the shear modulus E / (2 (1 + nu)) is infinite).")
    return float(E) / (2.0 * (1.0 + nu))


def _positive(name: str, value: ArrayLike, unit: str) -> Value:
    return positive(name, value, unit) if np.ndim(value) == 0 else positive_array(name, value, (None,), unit)


def _stiffness(name: str, value: ArrayLike) -> Value:
    if np.ndim(value) == 0:
        return nonnegative(f"{name} of springs", value, "N/m" if name in ("kn", "ks") else "N m/rad")
    array = finite_array(f"{name} of springs", value, (None,))
    if np.any(array < 0.0):
        k = int(np.argmax(array < 0.0))
        raise InputError(f"{name}[{k}] of springs is {array[k]:g}; it must not be negative.")
    return array
