"""The variant "bonds" of a step as a CUDA kernel: each bond is evaluated once, and its load goes through memory.

A thread for each bond writes its load; then a thread for each particle sums, ends the step and starts the next. The
whole grid meets twice in a step. For cards on which double precision is slow.
"""

from pybondem.engines.cuda_packed import PARTICLES, PackedPhases
from pybondem.engines.cuda_text import THREADS, Rounds, Sweep, Text, blocks_for, each, text_of
from pybondem.engines.lookups import NO_SUMS, SUM_OF_LOADS
from pybondem.program import Program, Stage

LEADING = "block, thread, step, steps"


def bond_text(program: Program, threads: int = THREADS) -> Text:
    """Return the kernel of the variant "bonds"; only for step programs (`is_step`). threads: of a block."""
    phases = BondPhases(program)
    first, last = phases.outer_rounds()
    for number, stage in phases.cycle.bonds:
        if phases.own[stage.over]:
            first.append(phases.over_bonds(f"pack{number}", "block, thread", stage, phases.pack(stage)))
            last.append(phases.over_bonds(f"unpack{number}", "block, thread", stage, phases.unpack_bonds(stage)))
    evaluate = tuple(
        phases.over_bonds(f"bonds{number}", LEADING, stage, phases.evaluate(number, stage))
        for number, stage in phases.cycle.bonds
    )
    gather = [NO_SUMS, *SUM_OF_LOADS.splitlines()]
    turn = phases.define("turn", LEADING, each(PARTICLES, [*phases.halves("step"), *phases.ends_step(gather)]))
    rounds = Rounds((tuple(first),), (evaluate, (Sweep((turn,), blocks_for(PARTICLES)),)), (tuple(last),))
    most = max(len(program.shared["first"]) - 1, *(block.count for block in program.blocks))
    return text_of(phases, rounds, phases.packed_arrays(per_bond=1), threads, -(-most // threads))


class BondPhases(PackedPhases):
    """Phases of the variant "bonds"."""

    def __init__(self, program: Program) -> None:
        super().__init__(program, copies=1)
        self.look.arguments |= {name: program.shared[name] for name in ("load", "ends")}

    def evaluate(self, number: int, stage: Stage) -> list[str]:
        """Return the text that evaluates bond k of a set."""
        ends = ", ".join(f"{self._ends(stage, end)}[k]" for end in "ij")
        places = [*self.halves("step"), *self.places(at_i="half", at_j="half"), *self.own_u(stage.over, "k")]
        return [f"i, j = {ends}", *places, *self.evaluated(number, stage, ("load",), "step + 1 == steps")]

    def pack(self, stage: Stage) -> list[str]:
        """Return the text that copies what bond k of a set changes from the program's own arrays."""
        return [*self.own_u(stage.over, "k"), *(f"{own} = {home}" for own, home in self.own_copies(stage.over))]

    def unpack_bonds(self, stage: Stage) -> list[str]:
        """Return the text that copies it back."""
        return [*self.own_u(stage.over, "k"), *(f"{home} = {own}" for own, home in self.own_copies(stage.over))]

    def over_bonds(self, name: str, leading: str, stage: Stage, lines: list[str]) -> Sweep:
        """Return a pass over the bonds k of a set, its phase added under a name."""
        count = f"{self._ends(stage, 'i')}.shape[0]"
        return Sweep((self.define(name, leading, each(count, lines)),), blocks_for(count))

    def _ends(self, stage: Stage, end: str) -> str:
        """Return the argument that holds the first or second ends of the bonds of a set."""
        return self.look.array(stage.over, self.look.program.bonds[stage.over], end)
