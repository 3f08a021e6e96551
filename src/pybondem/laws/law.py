"""Laws as decorated functions of numbers.

    @bd.damage_law(parameters={"rate": "1/m"}, memory={"longest": "m"})
    def tiring(d, m, p):
        longest = bd.maximum(m.longest, d.opening)
        return 1.0 - bd.exp(-p.rate * longest), longest

    bond = bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), tiring(rate=50.0))

A law names what it reads, in this order: d, the deformation (`Deformation` in a damage law, `Components` in a bond
law); k, the `Stiffness` of the bond (bond laws only); m, its memory, which starts at zero; p, its parameters; rate, how
fast d changes (`Rate`, or `ComponentRates`); dt, the time step [s]. It returns its answer - damage, a `Damage` with one
value for each mode, or the `Loads` of a bond law - and then each word of its memory.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from pybondem.bonds import ValuedLaw
from pybondem.check import positive
from pybondem.errors import LawError
from pybondem.laws.check import check_law
from pybondem.laws.findings import Report
from pybondem.laws.parameters import Needs, Parameter, check_values, declared, given, remembered
from pybondem.laws.plot import plot_law
from pybondem.laws.reading import Reading, read_function, sample

Function = Callable[..., Any]
MODES = ("opening", "slip")


class Law:
    """A declared law. Called with the values of its parameters it is ready for a Bond or a Joint.

    name, user (the function as it was written), kind ("damage" or "bond"), parameters (name -> Parameter), memory (word
    -> unit), needs (what must hold between parameters), toughness (fracture energy per area [J/m2] in "opening" and
    "slip", as functions of the parameters and the stiffness per area [Pa/m]), potential (stored energy [J] of a bond
    law).
    """

    def __init__(self, user: Function, kind: str, parameters: Mapping[str, str | Parameter], memory: Mapping[str, str],
                 needs: Needs, toughness: Mapping[str, Function], potential: Function | None) -> None:  # fmt: skip
        self.name: str = getattr(user, "__name__", repr(user))
        self.user, self.kind, self.needs, self.toughness, self.potential = user, kind, needs, toughness, potential
        self.parameters: Mapping[str, Any] = declared(self.name, parameters)
        self.memory: Mapping[str, str] = remembered(self.name, memory)
        self._check_toughness()
        self.__doc__ = user.__doc__
        self._values: Any = namedtuple("Parameters", self.parameters)  # type: ignore[misc]
        self._words: Any = namedtuple("Memory", self.memory)  # type: ignore[misc]
        typical = self._values(**{name: sample(p) for name, p in self.parameters.items()})
        self._read: Reading = read_function(self.name, user, kind, typical, self._words, potential)

    def _check_toughness(self) -> None:
        """Raise LawError where a toughness is declared of no mode that there is, or as no function."""
        for mode, function in self.toughness.items():
            if mode not in MODES or not callable(function):
                raise LawError(
                    f"the toughness of {self.name} in {mode!r} is {function!r}; declare functions (p, k) in 'opening' "
                    "or 'slip'."
                )

    def __repr__(self) -> str:
        lines = [f"{self.name}({', '.join(self.parameters)}): a {self.kind} law"]
        for name, p in self.parameters.items():
            default = "" if p.default is None else f", by default {p.default:g}"
            lines.append(f"  {name} [{p.unit}] {p.meaning} ({p.range}{default})")
        lines += [f"  remembers {word} [{unit}]" for word, unit in self.memory.items()]
        return "\n".join(lines)

    def __call__(self, *values: Any, stiffness: float | None = None, **named: Any) -> ValuedLaw:
        """Return the law with values: for each parameter a number, one value per bond (m,), or a `scatter`.

        stiffness: shear stiffness per area [Pa/m] that it brings where it is used in a Joint. Raises InputError for a
        misspelt or missing parameter, and for values outside their range.
        """
        all_values = self._values(**given(self.name, self.parameters, values, named))
        self.check_values(all_values)
        if stiffness is not None:
            stiffness = positive(f"stiffness of {self.name}", stiffness, "Pa/m")
        return ValuedLaw(
            self.name, self.kind, self._read.function, all_values, self._words, self._read.modes, self._read.flows,
            self._read.branches, self._read.potential, stiffness, self,
        )  # fmt: skip

    def check_values(self, values: Any) -> None:
        """Raise InputError where values (a named tuple of numbers or arrays) may not be taken."""
        check_values(self.name, self.parameters, self.needs, values)

    def check(self, *values: Any, quiet: bool = False, **named: Any) -> Report:
        """Try the law on every engine; print, unless quiet, and return what was found.

        values, named: as in a call, by default the typical ones.
        """
        return check_law(self._tried(values, named), quiet=quiet)

    def plot(self, *values: Any, path: str | Path | None = None, reach: float | None = None,
             driven: ArrayLike | None = None, **named: Any) -> Any:  # fmt: skip
        """Draw stress, damage and dissipated energy against opening, slip and both; return the figure.

        values, named: as in a call, by default the typical ones; path: of a figure file to write; reach: how far to go
        [m], by default to the end of the law; driven (points, 6): a path of one's own instead, the six components
        of `Components` [m, rad].
        """
        return plot_law(self._tried(values, named), path=path, reach=reach, driven=driven)

    def _tried(self, values: tuple[Any, ...], named: dict[str, Any]) -> ValuedLaw:
        """Return the law with the values given, and typical ones for the rest."""
        rest = list(self.parameters)[len(values) :]
        typical = {n: p.typical for n in rest if n not in named and (p := self.parameters[n]).typical is not None}
        return self(*values, **typical, **named)


def damage_law(function: Function | None = None, *, parameters: Mapping[str, str | Parameter] | None = None,
               memory: Mapping[str, str] | None = None, needs: Needs | None = None,
               toughness: Mapping[str, Function] | None = None) -> Any:  # fmt: skip
    """Declare a damage law: a decorator of function(d, m, p, rate, dt) -> damage, memory words.

    parameters: unit of each, or a `Parameter` with meaning and range; memory: unit of each word; needs: what must hold
    between parameters, {"end > peak": lambda p: p.end > p.peak}; toughness: fracture energy per area that `check`
    should find, {"slip": lambda p, k: ...}, k the stiffness per area [Pa/m]. Returns a `Law`. Raises LawError for a
    function that is not a law.
    """

    def declare(user: Function) -> Law:
        return Law(user, "damage", parameters or {}, memory or {}, needs or {}, toughness or {}, None)

    return declare if function is None else declare(function)


def bond_law(function: Function | None = None, *, parameters: Mapping[str, str | Parameter] | None = None,
             memory: Mapping[str, str] | None = None, needs: Needs | None = None,
             potential: Function | None = None) -> Any:  # fmt: skip
    """Declare a bond law: a decorator of function(d, k, m, p, rate, dt) -> Loads, memory words.

    potential: the energy [J] that the bond holds, a function of what it names of d, k, m, p, with m as it was returned.
    Without it, what its loads hold in the elastic form counts as stored, sum Q^2 / 2k: right for plastic bonds, wrong
    for a law that damages its own stiffness. A memory word named "damage" is reported as the damage of the bond. Make
    changed Loads with Loads(...), not with _replace, which does not compile. The rest as in `damage_law`.
    """

    def declare(user: Function) -> Law:
        return Law(user, "bond", parameters or {}, memory or {}, needs or {}, {}, potential)

    return declare if function is None else declare(function)
