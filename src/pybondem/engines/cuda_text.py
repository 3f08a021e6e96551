"""A step program as the text of one CUDA kernel that advances it any number of steps in one launch.

The text is made of phases (`cuda_phases`): what a thread does between two barriers. The kernel calls them for all
blocks of threads, lets the threads of a block meet where they share memory, and the whole grid where one round of
blocks needs what another has written. Nothing in a phase knows of CUDA, so that the same phases run, and are tested, on
a CPU. There are two variants:

    bonds        a thread for each bond, its load to memory; then a thread for each particle: sum, end of the step,
                 start of the next. Any program (`stage_text`); steps on packed arrays (`cuda_bonds`).
    half-bonds   a thread for each end of each bond, loads to the memory shared by a block; then a thread for each
                 particle of the block: sum, end of the step, start of the next. Steps (`cuda_half_bonds`).
"""

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.engines.cuda_phases import Phases, cycle_of, indented, written_by
from pybondem.engines.lookups import INDEX_WORDS, NO_SUMS, SUM_OF_LOADS
from pybondem.program import Body, Program, Stage

# Of a block. At 255 registers, the most that a thread has, two blocks are on a multiprocessor: one works while the
# other waits for itself. 120 of 128 threads have a half-bond where each particle has 12. See `cuda_launch.RESIDENT`.
THREADS = 128


class Sweep(NamedTuple):
    """One pass over all blocks of threads.

    calls: the phases, between which the threads of a block meet; blocks: how many blocks there are, as text; chunks:
    how often the calls are repeated for a block, as text, or nothing where there is one phase that shares no memory.
    """

    calls: tuple[str, ...]
    blocks: str
    chunks: str = ""


Round = tuple[Sweep, ...]  # in any order; the whole grid meets after it


class Rounds(NamedTuple):
    """What a kernel does: before the first step, in each step, after the last one."""

    before: tuple[Round, ...]
    step: tuple[Round, ...]
    after: tuple[Round, ...] = ()


class Private(NamedTuple):
    """An array on the device that is the kernel's own: it holds nothing from one launch to the next but `initial`."""

    shape: tuple[int, ...]
    dtype: type
    initial: NDArray[Any] | None = None


class Text(NamedTuple):
    """A kernel as text, and what it needs.

    source: the phases, and at the end the kernel advance(steps, arguments..., private...), steps >= 1; bodies, types:
    what the text calls; arguments: the program's arrays and numbers by name, of which "dt" and the scheduled fields
    are new in each launch; private: arrays of the kernel's own; written: arguments that the kernel writes; threads: of
    a block, exactly; blocks: that there is work for, though any number of them does it; rounds: what the kernel does.
    """

    source: str
    bodies: dict[str, Body]
    types: dict[str, type]
    arguments: dict[str, Any]
    private: dict[str, Private]
    written: frozenset[str]
    threads: int
    blocks: int
    rounds: Rounds

    def without_initial(self) -> "Text":
        """Return the text without what its private arrays hold at first, to free that."""
        return self._replace(private={name: p._replace(initial=None) for name, p in self.private.items()})

    @property
    def words(self) -> dict[str, Any]:
        """Global names of the text that are the same on every target, for this number of threads."""
        return {"np": np, "THREADS": np.uint32(self.threads), "SHARED": (6, self.threads), **INDEX_WORDS}


def is_step(program: Program) -> bool:
    """Return whether a program is a whole time step of bonded particles: start, bonds, gather, finish."""
    cycle = cycle_of(program)
    return len(cycle.head) == 1 and len(cycle.tail) == 2 and any(block.count > 0 for block in program.blocks)


def stage_text(program: Program, threads: int = THREADS) -> Text:
    """Return the kernel that serves every program, on the program's own arrays; threads: of a block."""
    phases, leading, particles = Phases(program), "block, thread, step, steps", "first.shape[0] - 1"
    phases.look.arguments |= {name: program.shared[name] for name in ("load", "first", "ends")}
    before: list[Round] = []
    rounds: list[Round] = []
    if phases.cycle.head:
        call = phases.define("begin", leading, each(particles, phases.start()))
        before.append((Sweep((call,), blocks_for(particles)),))
    if phases.cycle.bonds:
        sweeps = []
        for number, stage in phases.cycle.bonds:
            count = f"{stage.over}_i.shape[0]"
            call = phases.define(f"bonds{number}", leading, each(count, _bond(phases, number, stage)))
            sweeps.append(Sweep((call,), blocks_for(count)))
        rounds.append(tuple(sweeps))
    if phases.cycle.tail:
        gather = [NO_SUMS, *SUM_OF_LOADS.splitlines()]
        call = phases.define("turn", leading, each(particles, phases.turn(gather)))
        rounds.append((Sweep((call,), blocks_for(particles)),))
    most = max(len(program.shared["first"]) - 1, *(block.count for block in program.blocks), 1)
    return text_of(phases, Rounds(tuple(before), tuple(rounds)), {}, threads, -(-most // threads))


def _bond(phases: Phases, number: int, stage: Stage) -> list[str]:
    """Return the text that evaluates bond k of a block, and writes to the program's own arrays."""
    look = phases.look
    assert stage.body is not None
    phases.bodies[f"stage{number}"] = stage.body
    reads = look.reads(stage)
    writes = ", ".join(part for name in stage.writes for part in look.components(stage, name))
    i, j = (look.array(stage.over, look.program.bonds[stage.over], end) for end in "ij")
    return [f"i, j = {i}[k], {j}[k]", f"{writes} = stage{number}({reads})"]


def each(count: str, lines: list[str]) -> list[str]:
    """Return the text of a thread that does something to one of so many items k."""
    return ["k = np.uint32(block * THREADS + thread)", f"if k < {count}:", *indented(lines)]


def blocks_for(count: str) -> str:
    """Return the text for the number of blocks with a thread for each of so many items."""
    return f"({count} + THREADS - 1) // THREADS"


def text_of(phases: Phases, rounds: Rounds, private: dict[str, Private], threads: int, blocks: int) -> Text:
    """Return the text of phases that are called in these rounds: before the first step, and in every step."""
    look = phases.look
    lines = _kernel(rounds)
    words = set(re.findall(r"\w+", "\n".join(lines)))
    arguments = {name: value for name, value in look.arguments.items() if name in words}
    written = {f"p_{name}" for name in written_by((*phases.cycle.head, *phases.cycle.tail))}
    written |= {w for _, s in phases.cycle.bonds for name in s.writes for w in (name, f"{s.over}_{name}")}
    head = f"def advance({', '.join(['steps', *arguments, *private])}):"
    source = "\n\n".join([*phases.functions, "\n".join([head, *lines, ""])])
    told = frozenset(written & set(arguments))
    return Text(source, phases.bodies, look.types, arguments, private, told, threads, blocks, rounds)


def _kernel(rounds: Rounds) -> list[str]:
    """Return the text of the kernel: rounds of sweeps, after each of which the whole grid meets."""
    lines = [
        "thread = np.uint32(cuda.threadIdx.x)",
        "grid = cuda.cg.this_grid()",
        "step = 0",
    ]
    if any(sweep.chunks for each_round in rounds.step for sweep in each_round):
        lines.append("shared = cuda.shared.array(SHARED, np.float64)")
    before, step, after = ([line for one in part for line in _round(one)] for part in rounds)
    return indented([*lines, *before, "for step in range(steps):", *indented(step), *after])


def _round(sweeps: Round) -> list[str]:
    """Return the text of a round: a block of threads takes every so manieth block of work."""
    lines = []
    for sweep in sweeps:
        last = f"np.uint32({sweep.blocks})"
        lines.append(f"for block in range(np.uint32(cuda.blockIdx.x), {last}, np.uint32(cuda.gridDim.x)):")
        if sweep.chunks:
            met = [line for call in sweep.calls for line in (call, "cuda.syncthreads()")]
            lines += indented([f"for chunk in range({sweep.chunks}):", *indented(met)])
        else:
            lines += indented(sweep.calls)
    return [*lines, "grid.sync()"]
