"""A published law as a user would have written it in a script, beside the built-in one: is it as fast?"""

from types import FunctionType

import pybondem as bd
from pybondem.bonds import ValuedLaw
from pybondem.laws.law import Law


@bd.damage_law(parameters={"slip_peak": "m", "slip_end": "m"}, memory={"largest": "m"})
def bilinear(d, m, p):  # type: ignore[no-untyped-def]  # a script has none
    """Linear softening on the slip."""
    largest = bd.maximum(m.largest, d.slip)
    x = bd.maximum(largest, p.slip_peak)
    return bd.minimum(1.0, p.slip_end * (x - p.slip_peak) / (x * (p.slip_end - p.slip_peak))), largest


def names() -> list[str]:
    """Return the names of the published laws."""
    return list(bd.laws.__all__)


def built_in(name: str) -> ValuedLaw:
    """Return a published law with its typical values."""
    return _with_values(published(name), published(name))


def users(name: str) -> ValuedLaw:
    """Return the same law by a user: `bilinear` written out above, another declared anew from a copy."""
    law = published(name)
    return _with_values(bilinear if name == "bilinear" else _declared_anew(law), law)


def published(name: str) -> Law:
    """Return a law of `pybondem.laws`."""
    law: Law = getattr(bd.laws, name)
    return law


def _with_values(law: Law, typical: Law) -> ValuedLaw:
    """Return a law with the typical values of another one."""
    values = {n: p.default if p.typical is None else p.typical for n, p in typical.parameters.items()}
    valued: ValuedLaw = law(**values)
    return valued


def _declared_anew(law: Law) -> Law:
    """Return a copy of a law: a function of its own, through the decorator."""
    f = law.user
    copy = FunctionType(f.__code__, {**f.__globals__}, f"my_{law.name}", f.__defaults__, f.__closure__)
    common = {"parameters": law.parameters, "memory": law.memory, "needs": law.needs}
    if law.kind == "damage":
        own: Law = bd.damage_law(**common, toughness=law.toughness)(copy)
    else:
        own = bd.bond_law(**common, potential=built_in(law.name).potential)(copy)
    return own
