"""The variant "half-bonds" of a step as a CUDA kernel: the grid meets once in a step, and no load goes to memory.

A thread evaluates the bond of one half-bond and leaves what acts on its own end in the memory shared by its block,
which owns all half-bonds of its particles; then a thread for each particle sums, ends the step and starts the next.
Both threads of a bond evaluate it from its first end to its second: they compute the same bits, so that each keeps its
own copy of what the bond remembers.
"""

import numpy as np

from pybondem.engines.cuda_packed import PackedPhases
from pybondem.engines.cuda_partition import half_bonds, share_out
from pybondem.engines.cuda_phases import SUMS, indented
from pybondem.engines.cuda_text import THREADS, Private, Rounds, Sweep, Text, blocks_for, each, text_of
from pybondem.engines.lookups import NO_SUMS
from pybondem.program import Program

SUM_OF_SHARED = """\
begin = half_start[block] + chunk * THREADS
for c in range(np.uint32(max(first[k], begin)), np.uint32(min(first[k + ONE], begin + THREADS))):
    h = np.uint32(c - begin)
    force_0 += shared[0, h]
    force_1 += shared[1, h]
    force_2 += shared[2, h]
    torque_0 += shared[3, h]
    torque_1 += shared[4, h]
    torque_2 += shared[5, h]
"""
TO_SHARED = """\
sign = 1.0 - 2.0 * side
shared[0, thread], shared[1, thread], shared[2, thread] = sign * load_0, sign * load_1, sign * load_2
shared[3, thread] = load_3 if side == 0 else load_6
shared[4, thread] = load_4 if side == 0 else load_7
shared[5, thread] = load_5 if side == 0 else load_8
"""
LEADING = "block, thread, chunk, step, steps, shared"
LAST = "step + 1 == steps and side == 0"
THEIRS = ("half_i", "half_j", "half_bond")  # what a thread reads of its half-bond
SETS = ("half_set", "half_place")  # and where there are several sets of bonds


def half_bond_text(program: Program, threads: int = THREADS) -> Text:
    """Return the kernel of the variant "half-bonds"; only for step programs (`is_step`). threads: of a block."""
    phases = HalfBondPhases(program)
    phases.look.arguments["load"] = program.shared["load"]
    first, last = phases.outer_rounds()
    if any(phases.own.values()):
        for name, sweeps, lines in (("pack", first, phases.pack()), ("unpack", last, phases.unpack_bonds())):
            call = phases.define(f"{name}_bonds", "block, thread", each("half_bond.shape[0]", lines))
            sweeps.append(Sweep((call,), blocks_for("half_bond.shape[0]")))
    evaluate = phases.define("evaluate", LEADING, phases.evaluate())
    turn = phases.define("turn", LEADING, phases.turn_in_block())
    main = Sweep((evaluate, turn), "owners.shape[0] - 1", "chunks[block]")
    private = phases.private(threads)
    rounds = Rounds((tuple(first),), ((main,),), (tuple(last),))
    most = max(private["chunks"].shape[0], -(-len(program.shared["first"]) // threads))
    return text_of(phases, rounds, private, threads, most)


class HalfBondPhases(PackedPhases):
    """Phases of the variant "half-bonds": what bonds change is kept once for each half-bond."""

    def __init__(self, program: Program) -> None:
        super().__init__(program, copies=2)
        self.extra += ["owners", "half_start", "chunks", *THEIRS, *SETS]

    def turn_in_block(self) -> list[str]:
        """Return the text of a thread that ends a step for one particle of its block, and starts the next."""
        homes = [part for name in SUMS for part in self.home(name)]
        sums = [part for name in SUMS for part in self.locals(name)]
        carried, carry = (f"{', '.join(a)} = {', '.join(b)}" for a, b in ((sums, homes), (homes, sums)))
        gather = [NO_SUMS, "if chunk > 0:", f"    {carried}", *SUM_OF_SHARED.splitlines()]
        gather += ["if chunk + ONE < chunks[block]:", f"    {carry}", "    return"]
        return [
            "k = np.uint32(owners[block] + thread)",
            "if k < owners[block + ONE]:",
            *indented([*self.halves("step"), *self.ends_step(gather)]),
        ]

    def pack(self) -> list[str]:
        """Return the text that copies what bonds change from the program's own arrays to half-bond k."""
        texts = [[f"{own} = {home}" for own, home in self.own_copies(s.over)] for _, s in self.cycle.bonds]
        return ["c = k", "k = half_bond[c] >> ONE", *self._by_set(texts)]

    def unpack_bonds(self) -> list[str]:
        """Return the text that copies it back, from the half-bond k of a first end."""
        texts = [[f"{home} = {own}" for own, home in self.own_copies(s.over)] for _, s in self.cycle.bonds]
        lines = ["k = half_bond[c] >> ONE", *self._by_set(texts)]
        return ["c = k", "if half_bond[c] & ONE == 0:", *indented(lines)]

    def evaluate(self) -> list[str]:
        """Return the text that evaluates one half-bond of a block and leaves its load with the block."""
        texts = [self.evaluated(number, stage, (), LAST) for number, stage in self.cycle.bonds]
        return [
            "c = np.uint32(half_start[block] + chunk * THREADS + thread)",
            "if c < half_start[block + ONE]:",
            "    i, j, code = half_i[c], half_j[c], half_bond[c]",
            "    k, side = code >> ONE, code & ONE",
            *indented([*self.halves("step"), *self.places(at_i="half", at_j="half")]),
            *indented(self._by_set(texts)),
            *indented(TO_SHARED.splitlines()),
        ]

    def _by_set(self, texts: list[list[str]]) -> list[str]:
        """Return the text that does for half-bond c what its set asks for; u: its place in what the set keeps."""
        blocks = [stage.over for _, stage in self.cycle.bonds]
        if len(texts) == 1:
            return [*self.own_u(blocks[0], "c"), *texts[0]]
        lines = ["own_set, h = half_set[c], half_place[c]"]
        for s, (block, text) in enumerate(zip(blocks, texts, strict=True)):
            test = "else:" if s == len(texts) - 1 else f"{'elif' if s else 'if'} own_set == {s}:"
            lines += [test, *indented([*self.own_u(block, "h"), *text] or ["pass"])]
        return lines

    def private(self, threads: int) -> dict[str, Private]:
        """Return the arrays that only the kernel uses, by name."""
        program = self.look.program
        ends = [(fields["i"], fields["j"]) for fields in (program.bonds[block.name] for block in program.blocks)]
        owners = share_out(program.shared["first"], threads)
        halves = half_bonds(program.shared["ends"], ends)
        indices = owners._asdict() | {f"half_{name}": value for name, value in halves._asdict().items()}
        needed = [name for name in indices if len(ends) > 1 or name not in SETS]
        private = {name: Private(indices[name].shape, np.uint32, indices[name]) for name in needed}
        return private | self.packed_arrays(per_bond=2)
