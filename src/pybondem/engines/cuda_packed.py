"""The arrays that kernels of a step work on, packed, and the phases over particles, which are alike in both variants.

A component of 16 items lies in one line of 128 bytes, and the components of an item lie at fixed distances: a thread
holds one address for all that it reads of an item, where arrays (components, n) need one for each component, in
registers. Neighbours share lines: with dashpots a thread loads 2 x 16 numbers of the ends of its bond, each of which 32
threads find in 6 lines or 8 sectors (counted in a close packing), in 14 lines where each particle is a row of its own.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from pybondem.engines.cuda_phases import Phases, fields_of, seen_by, written_by
from pybondem.engines.cuda_text import Private, Sweep, blocks_for, each
from pybondem.program import Program, Stage

TILE = 16  # numbers in a line of memory
PARTICLES = "first.shape[0] - 1"
PLACE = """\
def place(item, rows):
    item = np.uint64(item)
    return (item >> np.uint64(4)) * (np.uint64(16) * rows) + (item & np.uint64(15))
"""

Rows = dict[str, list[int]]


def packed(n: int, rows: int) -> int:
    """Return the length of a packed array of n items with so many components."""
    return -(-n // TILE) * TILE * rows


def in_packed(array: str, at: str, rows: Iterable[int]) -> list[str]:
    """Return the expressions for components of the item whose place in a packed array is `at`."""
    return [f"{array}[{at} + np.uint64({TILE * row})]" for row in rows]


class PackedPhases(Phases):
    """Phases of a step on packed arrays.

    copies: of what bonds see of particles, in `seen`: 2 where a step reads one and writes the other. columns: rows of
    `seen` by field, those that are only told after the last step included; told: rows of the copy that the last step
    leaves free; rest: rows of `kept`, what else a particle hands from step to step; own: for each set of bonds, rows
    of what its bonds change and read again.
    """

    def __init__(self, program: Program, copies: int) -> None:
        super().__init__(program)
        self.look.arguments["first"] = program.shared["first"]
        self.copies = copies
        head = written_by(self.cycle.head)
        self.columns = self._numbered([*seen_by(self.cycle.bonds), *self.kept.last_start])
        self.rest = self._numbered([name for name in self.kept.always if name not in self.columns])
        told = self._numbered([name for name in self.kept.last if name not in (*self.columns, *self.rest)])
        width = count(self.columns)
        free = [row for name in head if name in self.columns for row in self.columns[name]] if copies == 2 else []
        free += range(width, width + max(0, count(told) - len(free)))
        self.told: Rows = {name: [free[row] for row in rows] for name, rows in told.items()}
        self.width = max([width, *(row + 1 for rows in self.told.values() for row in rows)])
        self.own = {stage.over: self._changing(stage) for _, stage in self.cycle.bonds}
        self.functions.append(PLACE)
        self.extra = ["seen", "kept", *(f"own_{block}" for block in self.own)]

    def _numbered(self, fields: Iterable[str]) -> Rows:
        """Return rows for the components of fields, one after another."""
        rows: Rows = {}
        for name in dict.fromkeys(fields):
            first = count(rows)
            rows[name] = list(range(first, first + len(self.locals(name))))
        return rows

    def _changing(self, stage: Stage) -> Rows:
        """Return rows for the components of each field that bonds of a stage change and read again."""
        rows: Rows = {}
        for name in fields_of(stage.reads):
            if name in stage.writes:
                value, first = self.look.program.bonds[stage.over][name], count(rows)
                rows[name] = list(range(first, first + (value.shape[0] if value.ndim == 2 else 1)))
        return rows

    # Particles --------------------------------------------------------------------------------------------------

    def places(self, **copies: str) -> list[str]:
        """Return the text that finds the places of particles in copies of `seen`: at_k="half" for that of k."""
        width = f"np.uint64({self.width})"
        return [f"{at} = {copy} + place({at[-1]}, {width})" for at, copy in copies.items()]

    def halves(self, step: str) -> list[str]:
        """Return the text that finds the copy that a step reads, and the other one that it writes."""
        if self.copies == 1:
            return ["half = other = np.uint64(0)"]
        size = "np.uint64(seen.shape[0] >> 1)"
        return [f"half = np.uint64({step} & 1) * {size}", f"other = {size} - half"]

    def seen_at(self) -> dict[str, list[str]]:
        """Return where fields that bonds see are read, those of the item {at} from its place at_{at}."""
        return {f"p_{name}": in_packed("seen", "at_{at}", rows) for name, rows in self.columns.items()}

    def home(self, field: str) -> list[str]:
        """Return where the components of a field of particle k are written."""
        if field in self.rest:
            return in_packed("kept", "kept_k", self.rest[field])
        return in_packed("seen", "to_k", self.columns.get(field) or self.told[field])

    def ends_step(self, gather: Sequence[str]) -> list[str]:
        """Return the text that ends a step of particle k and starts the next; gather: the text of its sums."""
        self.look.elsewhere = self.seen_at()
        self.look.elsewhere |= {f"p_{name}": in_packed("kept", "kept_k", rows) for name, rows in self.rest.items()}
        return [*self.places(at_k="half", to_k="other"), self._kept_k(), *self.turn(gather)]

    def begin(self) -> list[str]:
        """Return the start of the first step of particle k, from the program's own arrays; all that is seen of it."""
        lines = ["step = 0", "other = np.uint64(0)", *self.places(to_k="other"), self._kept_k(), *self.start()]
        still = [name for name in self.columns if name not in written_by(self.cycle.head)]
        for copy in ("to_k", "to_k + np.uint64(seen.shape[0] >> 1)")[: self.copies]:
            for name in still:
                lines += self._copied(in_packed("seen", copy, self.columns[name]), Phases.home(self, name))
        return lines

    def unpack(self) -> list[str]:
        """Return the text that writes what the steps have left of particle k to the program's own arrays."""
        lines = [*self.halves("(steps - 1)"), *self.places(at_k="half", to_k="other"), self._kept_k()]
        for name in self.columns:
            if name in written_by(self.cycle.head):
                lines += self._copied(Phases.home(self, name), in_packed("seen", "at_k", self.columns[name]))
        for name in (*self.rest, *self.told):
            lines += self._copied(Phases.home(self, name), self.home(name))
        return lines

    def _kept_k(self) -> str:
        return f"kept_k = place(k, np.uint64({count(self.rest)}))"

    @staticmethod
    def _copied(to: Sequence[str], source: Sequence[str]) -> list[str]:
        return [f"{', '.join(to)} = {', '.join(source)}"]

    def outer_rounds(self) -> tuple[list[Sweep], list[Sweep]]:
        """Return the passes over particles before the first step and after the last one."""
        begin = self.define("begin", "block, thread, steps", each(PARTICLES, self.begin()))
        unpack = self.define("unpack", "block, thread, steps", each(PARTICLES, self.unpack()))
        return [Sweep((begin,), blocks_for(PARTICLES))], [Sweep((unpack,), blocks_for(PARTICLES))]

    # Bonds ------------------------------------------------------------------------------------------------------

    def own_u(self, block: str, item: str) -> list[str]:
        """Return the text that finds the place u of an item in the packed array of what bonds of a set change."""
        return [f"u = place({item}, np.uint64({count(self.own[block])}))"] if self.own[block] else []

    def own_places(self, block: str, field: str) -> list[str]:
        """Return where the components of a field that a bond changes are kept."""
        return in_packed(f"own_{block}", "u", self.own[block][field])

    def own_copies(self, block: str) -> list[tuple[str, str]]:
        """Return where what bond k of a set changes is kept, and where the program has it."""
        arrays = self.look.program.bonds[block]
        pairs = [(self.own_places(block, n), self.look.item(block, arrays, n, "k")) for n in self.own[block]]
        return [pair for places, homes in pairs for pair in zip(places, homes, strict=True)]

    def evaluated(self, number: int, stage: Stage, always: Sequence[str], last: str) -> list[str]:
        """Return the text that evaluates bond k of a set and keeps what it changes.

        always: what else of its writes is stored in every step; the rest is where `last` holds.
        """
        look, block = self.look, stage.over
        assert stage.body is not None
        self.bodies[f"stage{number}"] = stage.body
        look.elsewhere = {}
        homes = {name: look.components(stage, name) for name in stage.writes}
        look.elsewhere = self.seen_at()
        look.elsewhere |= {f"{block}_{name}": self.own_places(block, name) for name in self.own[block]}
        results = {name: [f"{name}_{c}" for c in range(len(home))] for name, home in homes.items()}
        every = ", ".join(part for parts in results.values() for part in parts)
        lines = [f"{every} = stage{number}({look.reads(stage)})"]
        for name in self.own[block]:
            lines += self._copied(self.own_places(block, name), results[name])
        for name in always:
            lines += self._copied(homes[name], results[name])
        told = [n for n in stage.writes if n not in (*self.own[block], *always)]
        if told:
            lines += [f"if {last}:", *("    " + self._copied(homes[n], results[n])[0] for n in told)]
        return lines

    # Arrays -----------------------------------------------------------------------------------------------------

    def packed_arrays(self, per_bond: int) -> dict[str, Private]:
        """Return the packed arrays by name; per_bond: how often what a bond changes is kept."""
        program = self.look.program
        n = len(program.shared["first"]) - 1
        sizes = {"seen": self.copies * packed(n, self.width), "kept": packed(n, count(self.rest))}
        for block in program.blocks:
            sizes[f"own_{block.name}"] = packed(per_bond * block.count, count(self.own[block.name]))
        none = {f"own_{name}" for name, fields in self.own.items() if not fields}
        none |= set() if self.rest else {"kept"}
        return {name: Private((size,), np.float64) for name, size in sizes.items() if name not in none}


def count(rows: Rows) -> int:
    """Return how many rows there are."""
    return sum(len(of_field) for of_field in rows.values())
