"""What the text of a program's loops calls things: fields of the current item, constants, types, arguments."""

from typing import Any

import numpy as np

from pybondem.program import Program, Stage
from pybondem.state import CHORD, GROUP_FIELDS, GROWING, SCHEDULED_FIELDS

GROUP = {f.name for f in GROUP_FIELDS}
SCHEDULED = {f.name for f in SCHEDULED_FIELDS}

NO_SUMS = "force_0 = force_1 = force_2 = torque_0 = torque_1 = torque_2 = 0.0"
SUM_OF_LOADS = """\
for c in range(first[k], first[k + ONE]):
    bond, side = ends[c] >> ONE, ends[c] & ONE
    sign, row = 1.0 - 2.0 * side, THREE + THREE * side
    force_0 += sign * load[0, bond]
    force_1 += sign * load[1, bond]
    force_2 += sign * load[2, bond]
    torque_0 += load[row, bond]
    torque_1 += load[row + ONE, bond]
    torque_2 += load[row + TWO, bond]
"""

INDEX_WORDS = {"ONE": np.uint32(1), "TWO": np.uint32(2), "THREE": np.uint32(3)}


class Lookups:
    """The expressions for what stages read and write, in the order in which they are asked for.

    Item k is the current particle or bond, i and j are the ends of bond k, g is the group of particle k, step is the
    number of the step. arguments: the arrays and numbers of the program that the expressions name; types: the named
    tuples that they call; elsewhere: the expressions for fields that are kept in another place than the program's own
    array, by the name that this array has as an argument, a field's item standing as {at}.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.arguments: dict[str, Any] = {}
        self.types: dict[str, type] = {}
        self.elsewhere: dict[str, list[str]] = {}

    def reads(self, stage: Stage) -> str:
        """Return the arguments of a stage's body."""
        return ", ".join(self.read(stage, name) for name in stage.reads)

    def read(self, stage: Stage, name: Any) -> str:
        """Return the expression for one argument of a body."""
        if isinstance(name, tuple):
            kind, *fields = name
            return f"{self.type_name(kind)}({', '.join(self.read(stage, f) for f in fields)})"
        parts = self.components(stage, name)
        return parts[0] if len(parts) == 1 else f"({', '.join(parts)})"

    def type_name(self, kind: type) -> str:
        """Return the name that a type goes by: its own, with a stroke for every other type that has the same."""
        name = kind.__name__
        while self.types.setdefault(name, kind) is not kind:
            name += "_"
        return name

    def components(self, stage: Stage, name: str) -> list[str]:
        """Return the expression for each component of a field or constant."""
        field, _, end = name.partition(".")
        particles, shared = self.program.particles, self.program.shared
        if field == "dt":
            self.arguments[field] = 0.0
            return [field]
        if field == CHORD:
            ends = (self.item("p", particles, "start", end) for end in "ji")
            return [f"{b} - {a}" for b, a in zip(*ends, strict=True)]
        if field == GROWING.name:
            self.arguments[field] = shared[field]
            return [f"{field}[step]"]
        if field in SCHEDULED:
            self.arguments[field] = shared[field]
            row = "step + 1" if stage.after else "step"
            return [f"{field}[{row}, {c}, g]" for c in range(shared[field].shape[1])]
        if field in GROUP:
            self.arguments[field] = shared[field]
            return [f"{field}[{c}, g]" for c in range(shared[field].shape[0])]
        if field in ("load", "energy"):
            self.arguments[field] = shared[field]
            self.arguments[f"{stage.over}_first"] = np.uint64(self.program.block(stage.over).first)
            where = f"k + {stage.over}_first"
            rows = [f"{c}, " for c in range(shared[field].shape[0])] if shared[field].ndim == 2 else [""]
            return [f"{field}[{row}{where}]" for row in rows]
        if end or stage.over == "particles":
            return self.item("p", particles, field, end or "k")
        return self.item(stage.over, self.program.bonds[stage.over], field, "k")

    def item(self, prefix: str, arrays: dict[str, Any], name: str, index: str) -> list[str]:
        """Return the expression for each component of an item of an array, or the name of a constant."""
        places = self.elsewhere.get(f"{prefix}_{name}")
        if places is not None:
            return [place.format(at=index) for place in places]
        value, argument = arrays[name], self.array(prefix, arrays, name)
        if not isinstance(value, np.ndarray):
            return [argument]
        if value.ndim == 1:
            return [f"{argument}[{index}]"]
        return [f"{argument}[{c}, {index}]" for c in range(value.shape[0])]

    def array(self, prefix: str, arrays: dict[str, Any], name: str) -> str:
        """Return the argument that stands for an array or constant."""
        argument = f"{prefix}_{name}"
        self.arguments[argument] = arrays[name]
        return argument

    def obeys_groups(self, text: str) -> bool:
        """Return whether an expression looks up anything by the group of the particle."""
        return any(f"{name}[" in text for name in GROUP | SCHEDULED)
