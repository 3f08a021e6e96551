"""The variant "half-bonds" of a step as a CUDA kernel: the grid meets once in a step, and no load goes to memory.

A thread evaluates the bond of one half-bond and leaves what acts on its own end in the memory shared by its block,
which owns all half-bonds of its particles; then a thread for each particle sums, ends the step and starts the next.
Both threads of a bond evaluate it from its first end to its second: they compute the same bits, so that each keeps its
own copy of what the bond remembers.
"""

import numpy as np

from pybondem.engines.cuda_partition import half_bonds, share_out
from pybondem.engines.cuda_phases import SUMS, Phases, fields_of, indented, seen_by, written_by
from pybondem.engines.cuda_text import THREADS, Private, Rounds, Sweep, Text, blocks_for, each, text_of
from pybondem.engines.lookups import NO_SUMS
from pybondem.program import Program, Stage

SECTOR = 4  # doubles that memory hands out at once

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
LAST = "step + 1 == steps"
THEIRS = ("half_i", "half_j", "half_bond")  # what a thread reads of its half-bond
SETS = ("half_set", "half_place")  # and where there are several sets of bonds


def half_bond_text(program: Program, threads: int = THREADS) -> Text:
    """Return the kernel of the variant "half-bonds"; only for step programs (`is_step`). threads: of a block."""
    phases, shared = HalfBondPhases(program), program.shared
    phases.look.arguments |= {name: shared[name] for name in ("first", "load")}
    begin = phases.define("begin", "block, thread, step, steps", each("first.shape[0] - 1", phases.begin()))
    unpack = phases.define("unpack", "block, thread, steps", each("first.shape[0] - 1", phases.unpack()))
    first, last = ([Sweep((call,), blocks_for("first.shape[0] - 1"))] for call in (begin, unpack))
    if any(phases.own.values()):
        for name, sweeps, lines in (("pack", first, phases.pack()), ("unpack", last, phases.unpack_bonds())):
            call = phases.define(f"{name}_bonds", "block, thread", each("half_bond.shape[0]", lines))
            sweeps.append(Sweep((call,), blocks_for("half_bond.shape[0]")))
    evaluate = phases.define("evaluate", LEADING, phases.evaluate())
    turn = phases.define("turn", LEADING, phases.turn_in_block())
    main = Sweep((evaluate, turn), "owners.shape[0] - 1", "chunks[block]")
    private = phases.private(threads)
    rounds = Rounds((tuple(first),), ((main,),), (tuple(last),))
    most = max(private["chunks"].shape[0], -(-len(shared["first"]) // threads))
    return text_of(phases, rounds, private, threads, most)


class HalfBondPhases(Phases):
    """Phases of the variant "half-bonds".

    What bonds see of particles is packed into seen[2, n, width]: a step reads one half and writes the other. own: for
    each set of bonds the fields that its bonds change and read again, which are kept once for each half-bond, in rows.
    """

    def __init__(self, program: Program) -> None:
        super().__init__(program)
        self.columns: dict[str, list[int]] = {}
        for field in seen_by(self.cycle.bonds):
            first = sum(len(taken) for taken in self.columns.values())
            self.columns[field] = list(range(first, first + len(self.locals(field))))
        self.own = {stage.over: self._changing(stage) for _, stage in self.cycle.bonds}
        self.extra = ["owners", "half_start", "chunks", *THEIRS, *SETS, "seen", *(f"own_{block}" for block in self.own)]

    # Particles --------------------------------------------------------------------------------------------------

    def begin(self) -> list[str]:
        """Return the start of the first step of particle k, from the program's own arrays; all that is seen of it."""
        lines = ["other = 0", *self.start()]
        for name in self.columns:
            if name not in written_by(self.cycle.head):
                both = zip(*(self.seen(name, half, "k") for half in "01"), Phases.home(self, name), strict=True)
                lines += [f"{a} = {b} = {value}" for a, b, value in both]
        return lines

    def turn_in_block(self) -> list[str]:
        """Return the text of a thread that ends a step for one particle of its block, and starts the next."""
        self.look.elsewhere = {f"p_{name}": self.seen(name, "half", "{at}") for name in self.columns}
        homes = [part for name in SUMS for part in Phases.home(self, name)]
        sums = [part for name in SUMS for part in self.locals(name)]
        carried, carry = (f"{', '.join(a)} = {', '.join(b)}" for a, b in ((sums, homes), (homes, sums)))
        gather = [NO_SUMS, "if chunk > 0:", f"    {carried}", *SUM_OF_SHARED.splitlines()]
        gather += ["if chunk + ONE < chunks[block]:", f"    {carry}", "    return"]
        return [
            "half = np.uint32(step & 1)",
            "other = ONE - half",
            "k = np.uint32(owners[block] + thread)",
            "if k < owners[block + ONE]:",
            *indented(self.turn(gather)),
        ]

    def home(self, field: str) -> list[str]:
        """Return where the components of a field of particle k are written: packed where bonds see it."""
        return self.seen(field, "other", "k") if field in self.columns else super().home(field)

    def seen(self, field: str, half: str, item: str) -> list[str]:
        """Return where the components of a field of a particle are packed."""
        return [f"seen[{half}, {item}, {c}]" for c in self.columns[field]]

    def unpack(self) -> list[str]:
        """Return the text that writes what bonds have last seen of particle k to the program's own arrays."""
        packed = [name for name in self.columns if name in written_by(self.cycle.head)]
        lines = [f"{', '.join(Phases.home(self, n))} = {', '.join(self.seen(n, 'half', 'k'))}" for n in packed]
        return ["half = np.uint32((steps - 1) & 1)", *lines]

    # Bonds ------------------------------------------------------------------------------------------------------

    def pack(self) -> list[str]:
        """Return the text that copies what bonds change from the program's own arrays to half-bond k."""
        texts = [[f"{own} = {home}" for own, home in self._copies(s.over)] for _, s in self.cycle.bonds]
        return ["c = k", "k = half_bond[c] >> ONE", *self._by_set(texts)]

    def unpack_bonds(self) -> list[str]:
        """Return the text that copies it back, from the half-bond k of a first end."""
        texts = [[f"{home} = {own}" for own, home in self._copies(s.over)] for _, s in self.cycle.bonds]
        lines = ["k = half_bond[c] >> ONE", *self._by_set(texts)]
        return ["c = k", "if half_bond[c] & ONE == 0:", *indented(lines)]

    def evaluate(self) -> list[str]:
        """Return the text that evaluates one half-bond of a block and leaves its load with the block."""
        return [
            "c = np.uint32(half_start[block] + chunk * THREADS + thread)",
            "if c < half_start[block + ONE]:",
            "    half = np.uint32(step & 1)",
            "    i, j, code = half_i[c], half_j[c], half_bond[c]",
            "    k, side = code >> ONE, code & ONE",
            *indented(self._by_set([self._half_bond(number, stage) for number, stage in self.cycle.bonds])),
            *indented(TO_SHARED.splitlines()),
        ]

    def _by_set(self, texts: list[list[str]]) -> list[str]:
        """Return the text that does for a half-bond what its set asks for; u: its number among those of the set."""
        if len(texts) == 1:
            return ["u = c", *texts[0]]
        lines = ["own_set, u = half_set[c], half_place[c]"]
        for s, text in enumerate(texts[:-1]):
            lines += [f"{'elif' if s else 'if'} own_set == {s}:", *indented(text or ["pass"])]
        return [*lines, "else:", *indented(texts[-1] or ["pass"])]

    def _copies(self, block: str) -> list[tuple[str, str]]:
        """Return where a half-bond of a set keeps what its bond k changes, and where the program does."""
        arrays = self.look.program.bonds[block]
        pairs = [(self._places(block, n), self.look.item(block, arrays, n, "k")) for n in self.own[block]]
        return [pair for places, homes in pairs for pair in zip(places, homes, strict=True)]

    def _half_bond(self, number: int, stage: Stage) -> list[str]:
        """Return the text that evaluates bond k of one set, and keeps what it changes."""
        look, block = self.look, stage.over
        assert stage.body is not None
        self.bodies[f"stage{number}"] = stage.body
        look.elsewhere = {}
        homes = {name: look.components(stage, name) for name in stage.writes}
        look.elsewhere = {f"p_{name}": self.seen(name, "half", "{at}") for name in self.columns}
        look.elsewhere |= {f"{block}_{name}": self._places(block, name) for name in self.own[block]}
        results = {name: [f"{name}_{c}" for c in range(len(home))] for name, home in homes.items()}
        every = ", ".join(part for parts in results.values() for part in parts)
        lines = [f"{every} = stage{number}({look.reads(stage)})"]
        lines += [f"{', '.join(self._places(block, n))} = {', '.join(results[n])}" for n in self.own[block]]
        told = [f"{', '.join(homes[n])} = {', '.join(results[n])}" for n in stage.writes if n not in self.own[block]]
        return [*lines, f"if {LAST} and side == 0:", *indented(told)]

    def _places(self, block: str, field: str) -> list[str]:
        """Return where a half-bond keeps the components of a field that its bond changes."""
        return [f"own_{block}[{row}, u]" for row in self.own[block][field]]

    def _changing(self, stage: Stage) -> dict[str, list[int]]:
        """Return the rows for the components of each field that bonds of a stage change and read again."""
        rows: dict[str, list[int]] = {}
        for name in fields_of(stage.reads):
            if name in stage.writes:
                value, first = self.look.program.bonds[stage.over][name], sum(len(r) for r in rows.values())
                rows[name] = list(range(first, first + (value.shape[0] if value.ndim == 2 else 1)))
        return rows

    # Arrays -----------------------------------------------------------------------------------------------------

    def private(self, threads: int) -> dict[str, Private]:
        """Return the arrays that only the kernel uses, by name."""
        program = self.look.program
        bonds = {block.name: program.bonds[block.name] for block in program.blocks}
        owners = share_out(program.shared["first"], threads)
        halves = half_bonds(program.shared["ends"], [(fields["i"], fields["j"]) for fields in bonds.values()])
        indices = owners._asdict() | {f"half_{name}": value for name, value in halves._asdict().items()}
        needed = [name for name in indices if len(bonds) > 1 or name not in SETS]
        private = {name: Private(indices[name].shape, np.uint32, indices[name]) for name in needed}
        width = sum(len(taken) for taken in self.columns.values())
        private["seen"] = Private((2, len(program.shared["first"]) - 1, -(-width // SECTOR) * SECTOR), np.float64)
        for block, fields in self.own.items():
            if fields:
                rows = sum(len(r) for r in fields.values())
                private[f"own_{block}"] = Private((rows, 2 * len(bonds[block]["i"])), np.float64)
        return private
