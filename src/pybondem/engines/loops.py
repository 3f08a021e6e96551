"""A step program as loops: the text of one function that advances it any number of steps.

The text holds nothing but loops, array look-ups by field name, and calls of the stages' bodies. The cpu engine
compiles it, the interpreted engine runs it as it is.
"""

from typing import Any

import numpy as np

from pybondem.program import Body, Program, Stage
from pybondem.state import CHORD, GROUP_FIELDS, SCHEDULED_FIELDS, Arrays

GROUP = {f.name for f in GROUP_FIELDS}
SCHEDULED = {f.name for f in SCHEDULED_FIELDS}

GATHER = """\
        for k in prange(p_force.shape[1]):
            fx = fy = fz = tx = ty = tz = 0.0
            for c in range(first[k], first[k + ONE]):
                bond, side = ends[c] >> ONE, ends[c] & ONE
                sign, row = 1.0 - 2.0 * side, THREE + THREE * side
                fx += sign * load[0, bond]
                fy += sign * load[1, bond]
                fz += sign * load[2, bond]
                tx += load[row, bond]
                ty += load[row + ONE, bond]
                tz += load[row + TWO, bond]
            p_force[0, k], p_force[1, k], p_force[2, k] = fx, fy, fz
            p_torque[0, k], p_torque[1, k], p_torque[2, k] = tx, ty, tz
"""

INDEX_WORDS = {"ONE": np.uint32(1), "TWO": np.uint32(2), "THREE": np.uint32(3)}


class Loops:
    """The loops of a program: source text, names of its arguments, and the bodies and types that it calls."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.arguments: dict[str, Any] = {}
        self.bodies: dict[str, Body] = {}
        self.types: dict[str, type] = {}
        lines = [line for number, stage in enumerate(program.stages) for line in self._stage(number, stage)]
        head = [f"def advance(steps, {', '.join(self.arguments)}):\n", "    for step in range(steps):\n"]
        self.source = "".join(head + lines)

    def _stage(self, number: int, stage: Stage) -> list[str]:
        """Return the text of one stage, line by line."""
        if stage.body is None:  # the gather
            for name in ("load", "first", "ends"):
                self.arguments[name] = self.program.shared[name]
            for name in ("force", "torque"):
                self.arguments[f"p_{name}"] = self.program.particles[name]
            return [GATHER]
        self.bodies[f"stage{number}"] = stage.body
        reads = ", ".join(self._read(stage, name) for name in stage.reads)
        writes = ", ".join(part for name in stage.writes for part in self._components(stage, name))
        if stage.over == "particles":
            self._array("p", self.program.particles, "force")
            lines = ["        for k in prange(p_force.shape[1]):"]
            if any(f"{name}[" in reads for name in GROUP | SCHEDULED):
                lines.append(f"            g = {self._array('p', self.program.particles, 'group')}[k]")
        else:
            i, j = (self._array(stage.over, self.program.bonds[stage.over], end) for end in "ij")
            lines = [f"        for k in prange({i}.shape[0]):", f"            i, j = {i}[k], {j}[k]"]
        lines.append(f"            {writes} = stage{number}({reads})")
        return [line + "\n" for line in lines]

    def _read(self, stage: Stage, name: Any) -> str:
        """Return the expression for one argument of a body."""
        if isinstance(name, tuple):
            kind, *fields = name
            return f"{self._type(kind)}({', '.join(self._read(stage, f) for f in fields)})"
        parts = self._components(stage, name)
        return parts[0] if len(parts) == 1 else f"({', '.join(parts)})"

    def _type(self, kind: type) -> str:
        """Return the name that a type goes by: its own, with a stroke for every other type that has the same."""
        name = kind.__name__
        while self.types.setdefault(name, kind) is not kind:
            name += "_"
        return name

    def _components(self, stage: Stage, name: str) -> list[str]:
        """Return the expression for each component of a field or constant."""
        field, _, end = name.partition(".")
        shared = self.program.shared
        if field == "dt":
            self.arguments[field] = 0.0
            return [field]
        if field == CHORD:
            start = self._array("p", self.program.particles, "start")
            return [f"{start}[{c}, j] - {start}[{c}, i]" for c in range(3)]
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
            return self._item("p", self.program.particles, field, end or "k")
        return self._item(stage.over, self.program.bonds[stage.over], field, "k")

    def _item(self, prefix: str, arrays: dict[str, Any], name: str, index: str) -> list[str]:
        value, argument = arrays[name], self._array(prefix, arrays, name)
        if not isinstance(value, np.ndarray):
            return [argument]
        if value.ndim == 1:
            return [f"{argument}[{index}]"]
        return [f"{argument}[{c}, {index}]" for c in range(value.shape[0])]

    def _array(self, prefix: str, arrays: dict[str, Any], name: str) -> str:
        """Return the argument that stands for an array or constant."""
        argument = f"{prefix}_{name}"
        self.arguments[argument] = arrays[name]
        return argument

    def values(self, dt: float, schedule: Arrays) -> list[Any]:
        """Return the values of the arguments for one call: time step dt [s] and scheduled fields are those given."""
        given: dict[str, Any] = schedule | {"dt": dt}
        return [given.get(name, value) for name, value in self.arguments.items()]
