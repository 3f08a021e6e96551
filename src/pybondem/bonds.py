"""What holds two particles together: an elastic form and a law, with their values.

In a script:

    Bond(parallel(E=1e9, stiffness_ratio=2.0), strength(tension=5e6, shear=10e6), damping=0.1)
    Joint(bilinear(stiffness=6e7, slip_peak=1e-4, slip_end=4e-4))

The laws themselves are in `laws`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.check import finite_array, fraction, nonnegative, positive
from pybondem.errors import InputError
from pybondem.physics.elastic.beam import euler_bernoulli_stiffness, timoshenko_stiffness
from pybondem.physics.elastic.parallel import parallel_stiffness
from pybondem.physics.types import LawFunction, PotentialFunction, Stiffness

Value = float | NDArray[np.float64]


@dataclass(frozen=True)
class Elastic:
    """An elastic form: stiffness(radius [m], length [m]); radius_ratio: bond radius / smaller particle radius."""

    stiffness: Callable[[Value, Value], Stiffness]
    radius_ratio: float = 1.0


class Declared(Protocol):
    """What a law with values knows of its declaration.

    user: the function as its author wrote it; parameters and memory: their declarations by name; toughness: fracture
    energy per area in "opening" and "slip", as functions.
    """

    user: Callable[..., Any]
    parameters: Mapping[str, Any]
    memory: Mapping[str, str]
    toughness: Mapping[str, Callable[..., Any]]

    def check_values(self, values: Any) -> None:
        """Raise InputError where values (a named tuple of numbers or arrays) may not be taken."""

    def check(self, *values: Any, quiet: bool = False, **named: Any) -> Any:
        """Try the law with these values on every engine; print and return what was found."""

    def plot(self, *values: Any, **named: Any) -> Any:
        """Draw what the law with these values answers to driven paths."""


@dataclass(frozen=True, repr=False)
class ValuedLaw:
    """A law with its values, ready for a Bond or a Joint.

    kind: "damage" or "bond"; function: see `physics.types.LawFunction`; parameters: the values as a named tuple of
    numbers, arrays with one value per bond, or a Scatter; memory: the type of its memory, which starts at zero; modes:
    1 where one damage serves all modes, 4 where each has its own; flows: whether it reads rates or the time step;
    branches: whether it cannot take whole arrays; potential: stored energy of a bond law; stiffness: shear stiffness
    per area [Pa/m] that the law brings for joints, if any; declared: the law itself.
    """

    name: str
    kind: str
    function: LawFunction
    parameters: Any
    memory: Any
    modes: int
    flows: bool
    branches: bool
    potential: PotentialFunction | None
    stiffness: float | None
    declared: Declared

    def __repr__(self) -> str:
        values = [
            f"{n}={v:g}" if np.ndim(v) == 0 and not hasattr(v, "values") else f"{n}=..." for n, v in self._given()
        ]
        return f"{self.name}({', '.join(values)})"

    def _given(self) -> list[tuple[str, Any]]:
        """Return names and values of the parameters, and of the stiffness for joints where there is one."""
        stiffness = [] if self.stiffness is None else [("stiffness", self.stiffness)]
        return [*self.parameters._asdict().items(), *stiffness]

    def check(self, quiet: bool = False) -> Any:
        """Try the law with these values on every engine; print and return what was found."""
        return self.declared.check(quiet=quiet, stiffness=self.stiffness, **self.parameters._asdict())

    def plot(self, path: Any = None, reach: float | None = None, driven: ArrayLike | None = None) -> Any:
        """Draw what the law with these values answers to driven paths; path, reach, driven: see `Law.plot`."""
        values = {"stiffness": self.stiffness, **self.parameters._asdict()}
        return self.declared.plot(path=path, reach=reach, driven=driven, **values)


@dataclass(frozen=True)
class Bond:
    """A bond: elastic form, law (None: unbreakable), damping ratio zeta of its dashpots [-].

    hand_over (not for bond laws, which decide that themselves): once all of it has failed, damage 1 in every mode, the
    bond answers nothing, not even to being pressed together: its pair goes to a contact law. By default a broken bond
    that is pressed together keeps its normal stiffness.
    """

    elastic: Elastic
    law: ValuedLaw | None = None
    damping: float = 0.0
    hand_over: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.elastic, Elastic):
            raise InputError(f"Bond needs an elastic form (parallel, timoshenko, springs ...), got {self.elastic!r}.")
        if self.law is not None:
            _check_law("Bond", self.law, self.hand_over)
            if self.law.stiffness is not None:
                raise InputError("the law of Bond brings a stiffness per area, which is for Joint; leave it out.")
        nonnegative("damping of Bond", self.damping, "1")


@dataclass(frozen=True)
class Joint:
    """An interface bond: a law that brings its shear stiffness per area, normal stiffness per area [Pa/m].

    normal_stiffness defaults to the shear stiffness; damping is the damping ratio zeta of its dashpots [-]; hand_over
    as in `Bond`.
    """

    law: ValuedLaw
    normal_stiffness: float | None = None
    damping: float = 0.0
    hand_over: bool = False

    def __post_init__(self) -> None:
        _check_law("Joint", self.law, self.hand_over)
        if self.law.stiffness is None:
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


def _check_law(what: str, law: Any, hand_over: bool) -> None:
    if isinstance(law, ValuedLaw):
        if hand_over and law.kind == "bond":
            raise InputError(f"{law.name} is a bond law, which answers for a failed bond itself; leave hand_over out.")
    else:
        if hasattr(law, "check_values"):
            raise InputError(f"the law of {what} is {law.name} without values; give it values: {law.name}(...).")
        raise InputError(f"the law of {what} is {law!r}; give a law with its values, such as strength(...).")


def _ratio(radius_ratio: float) -> float:
    return positive("radius_ratio", radius_ratio, "1")


def _shear_modulus(form: str, E: float, nu: float) -> float:
    nu = fraction(f"nu of {form}", nu, -1.0, 0.5)
    if nu == -1.0:
        raise InputError(f"nu of {form} is -1; it must be above -1 (the shear modulus E / (2 (1 + nu)) is infinite).")
    return float(E) / (2.0 * (1.0 + nu))


def _stiffness(name: str, value: ArrayLike) -> Value:
    if np.ndim(value) == 0:
        return nonnegative(f"{name} of springs", value, "N/m" if name in ("kn", "ks") else "N m/rad")
    array = finite_array(f"{name} of springs", value, (None,))
    if np.any(array < 0.0):
        k = int(np.argmax(array < 0.0))
        raise InputError(f"{name}[{k}] of springs is {array[k]:g}; it must not be negative.")
    return array
