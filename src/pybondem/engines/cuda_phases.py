"""What one thread does between two barriers, as text: functions phase(block, thread, ...) of loops and look-ups.

The end of one step and the start of the next are one phase over particles: what one stage hands to the next stays in
local variables, and only what is read again in the next step, or told after the last one, goes to memory.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import Any, NamedTuple

from pybondem.engines.lookups import Lookups
from pybondem.program import Body, Program, Stage
from pybondem.state import CHORD

Numbered = tuple[int, Stage]
SUMS = ("force", "torque")  # what the gather writes


# The parts of a program -----------------------------------------------------------------------------------------


class Cycle(NamedTuple):
    """The stages of a program, with their numbers: start of a step, bonds, gather and end of a step."""

    head: tuple[Numbered, ...]
    bonds: tuple[Numbered, ...]
    tail: tuple[Numbered, ...]


class Kept(NamedTuple):
    """Fields of particles by when they go to memory: at every start of a step, at the last one, after the last step."""

    always: tuple[str, ...]
    last_start: tuple[str, ...]
    last: tuple[str, ...]


def cycle_of(program: Program) -> Cycle:
    """Return the stages of a program in their three parts, each of which may be empty."""
    stages = tuple(enumerate(program.stages))
    head = tuple(takewhile(lambda s: s[1].over == "particles", stages))
    bonds = tuple(takewhile(lambda s: s[1].over not in ("particles", "gather"), stages[len(head) :]))
    return Cycle(head, bonds, stages[len(head) + len(bonds) :])


def kept(cycle: Cycle) -> Kept:
    """Return when each field that stages over particles write has to go to memory."""
    read, written = set(seen_by(cycle.bonds)), set[str]()
    for stage in (*cycle.tail, *cycle.head):
        read |= set(fields_of(stage[1].reads)) - written
        written |= set(written_by([stage]))
    end, both = written_by(cycle.tail), written_by((*cycle.tail, *cycle.head))
    always = tuple(name for name in both if name in read)
    return Kept(always, tuple(name for name in both if name not in (*always, *end)), end)


def seen_by(bonds: Iterable[Numbered]) -> tuple[str, ...]:
    """Return the fields of particles that bonds read at their ends, each once."""
    names = [
        name for _, stage in bonds for name in fields_of(stage.reads) if name == CHORD or name[-2:] in (".i", ".j")
    ]
    return tuple(dict.fromkeys("start" if name == CHORD else name[:-2] for name in names))


def written_by(stages: Iterable[Numbered]) -> tuple[str, ...]:
    """Return the fields of particles that stages write, each once."""
    return tuple(dict.fromkeys(name for _, s in stages for name in (SUMS if s.body is None else s.writes)))


def fields_of(reads: Iterable[Any]) -> list[str]:
    """Return the names in the reads of a stage, those inside its named tuples included."""
    names: list[str] = []
    for read in reads:
        names += fields_of(read[1:]) if isinstance(read, tuple) else [read]
    return names


def indented(lines: Iterable[str]) -> list[str]:
    """Return lines of text one level further in."""
    return ["    " + line for line in lines]


# Their text -----------------------------------------------------------------------------------------------------


class Phases:
    """Phases as text; those of the start and the end of a step, which are much the same in every variant.

    look: what things are called; functions: the text of the phases; bodies: what they call; extra: names of arrays that
    are no part of the program.
    """

    def __init__(self, program: Program) -> None:
        self.look = Lookups(program)
        self.cycle = cycle_of(program)
        self.kept = kept(self.cycle)
        self.bodies: dict[str, Body] = {}
        self.functions: list[str] = []
        self.extra: list[str] = []

    def define(self, name: str, leading: str, lines: Iterable[str]) -> str:
        """Add a phase, with each array that its lines use as an argument; returns the call of it.

        Its local variables end with it: the next phase reads everything from memory.
        """
        self.look.elsewhere = {}
        body = "\n".join(indented(lines))
        words = set(re.findall(r"\w+", body))
        call = f"{name}({', '.join([leading, *(a for a in (*self.look.arguments, *self.extra) if a in words)])})"
        self.functions.append(f"def {call}:\n{body}\n")
        return call

    def start(self) -> list[str]:
        """Return the start of step `step` of particle k."""
        lines = self._run(self.cycle.head) + self.store(self.kept.always)
        if self.kept.last_start:
            lines += ["if step + 1 == steps:", *indented(self.store(self.kept.last_start))]
        return lines

    def turn(self, gather: Sequence[str]) -> list[str]:
        """Return the end of step `step` of particle k, and the start of the next; gather: the text of its sums."""
        self.hold(SUMS)
        lines = [*gather, *self._run(self.cycle.tail[1:])]
        if not self.cycle.head:
            return lines + self.store(self.kept.last)
        last = indented(self.store(self.kept.last))
        return [*lines, "if step + 1 == steps:", *last, "else:", "    step = step + 1", *indented(self.start())]

    def _run(self, stages: Iterable[Numbered]) -> list[str]:
        """Return the calls of bodies over particles; what they write is in local variables from then on."""
        lines = []
        for number, stage in stages:
            assert stage.body is not None
            self.bodies[f"stage{number}"] = stage.body
            reads = self.look.reads(stage)
            if self.look.obeys_groups(reads):
                lines.append(f"g = {self.look.array('p', self.look.program.particles, 'group')}[k]")
            results = [local for name in stage.writes for local in self.locals(name)]
            lines.append(f"{', '.join(results)} = stage{number}({reads})")
            self.hold(stage.writes)
        return lines

    def locals(self, field: str) -> list[str]:
        """Return the local variables for the components of a field of particles."""
        value = self.look.program.particles[field]
        return [f"{field}_{c}" for c in range(value.shape[0] if value.ndim == 2 else 1)]

    def hold(self, fields: Iterable[str]) -> None:
        """From here on, read these fields of particles from local variables."""
        self.look.elsewhere |= {f"p_{name}": self.locals(name) for name in fields}

    def store(self, fields: Iterable[str]) -> list[str]:
        """Return the text that writes local variables to memory."""
        return [f"{', '.join(self.home(name))} = {', '.join(self.locals(name))}" for name in fields]

    def home(self, field: str) -> list[str]:
        """Return where the components of a field of particle k are kept in memory: in the program's own arrays."""
        name = self.look.array("p", self.look.program.particles, field)
        rows = [""] if len(self.locals(field)) == 1 else [f"{c}, " for c in range(len(self.locals(field)))]
        return [f"{name}[{row}k]" for row in rows]
