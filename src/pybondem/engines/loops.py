"""A step program as loops: the text of one function that advances it any number of steps.

The text holds nothing but loops, array look-ups by field name, and calls of the stages' bodies. The cpu engine
compiles it, the interpreted engine runs it as it is.
"""

from textwrap import indent
from typing import Any

from pybondem.engines.lookups import NO_SUMS, SUM_OF_LOADS, Lookups
from pybondem.program import Body, Program, Stage
from pybondem.state import Arrays

GATHER = "        for k in prange(p_force.shape[1]):\n" + indent(
    NO_SUMS
    + "\n"
    + SUM_OF_LOADS
    + "p_force[0, k], p_force[1, k], p_force[2, k] = force_0, force_1, force_2\n"
    + "p_torque[0, k], p_torque[1, k], p_torque[2, k] = torque_0, torque_1, torque_2\n",
    12 * " ",
)


class Loops(Lookups):
    """The loops of a program: source text, its arguments by name, and the bodies and types that it calls."""

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.bodies: dict[str, Body] = {}
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
        reads = self.reads(stage)
        writes = ", ".join(part for name in stage.writes for part in self.components(stage, name))
        if stage.over == "particles":
            self.array("p", self.program.particles, "force")
            lines = ["        for k in prange(p_force.shape[1]):"]
            if self.obeys_groups(reads):
                lines.append(f"            g = {self.array('p', self.program.particles, 'group')}[k]")
        else:
            i, j = (self.array(stage.over, self.program.bonds[stage.over], end) for end in "ij")
            lines = [f"        for k in prange({i}.shape[0]):", f"            i, j = {i}[k], {j}[k]"]
        lines.append(f"            {writes} = stage{number}({reads})")
        return [line + "\n" for line in lines]

    def values(self, dt: float, schedule: Arrays) -> list[Any]:
        """Return the values of the arguments for one call: time step dt [s] and scheduled fields are those given."""
        given: dict[str, Any] = schedule | {"dt": dt}
        return [given.get(name, value) for name, value in self.arguments.items()]
