"""An engine that runs the phases of a CUDA kernel on the CPU: block after block, thread after thread.

What only a GPU has is written out: a phase is done by all threads of a block before the next one begins, shared memory
holds nothing but NaN when a block takes it over, and the kernel's own arrays do when it starts. Blocks, threads and the
passes of a round can come in any order: a kernel without races does not care.
"""

from typing import Any, Literal

import numba
import numpy as np

from pybondem.engines import cpu
from pybondem.engines.binding import bind
from pybondem.engines.cuda_bonds import bond_text
from pybondem.engines.cuda_half_bonds import half_bond_text
from pybondem.engines.cuda_phases import indented
from pybondem.engines.cuda_text import Round, Sweep, Text, is_step, stage_text
from pybondem.program import Program
from pybondem.state import Arrays

Order = Literal["forwards", "backwards", "jumbled"]
ORDERS: tuple[Order, ...] = ("forwards", "backwards", "jumbled")
STRIDE = 7919  # a prime: no count of blocks or threads here is a multiple of it

_COMPILED: dict[Any, Any] = {}


def nth(k: Any, count: Any, order: Any) -> Any:
    """Return which of `count` things comes as number k."""
    if order == 0:
        return k
    return count - 1 - k if order == 1 else (k * STRIDE + 13) % count


class CudaOnCpu:
    """The phases of a variant on the CPU; threads: of a block; order: of blocks, threads and passes.

    compiled: by Numba, with a check of every index; else in plain Python, which starts at once.
    """

    name = "cuda on the cpu"

    def __init__(self, variant: Literal["bonds", "half-bonds"], threads: int = 32, order: Order = "forwards",
                 compiled: bool = False) -> None:  # fmt: skip
        self.variant, self.threads, self.order, self.compiled = variant, threads, ORDERS.index(order), compiled

    def prepare(self, program: Program) -> "Runner":
        """Return a runner for the program: of the variant where it is a time step, else as it stands."""
        step = {"bonds": bond_text, "half-bonds": half_bond_text}[self.variant]
        return Runner((step if is_step(program) else stage_text)(program, self.threads), self.order, self.compiled)


class Runner:
    """A text on the CPU."""

    def __init__(self, text: Text, order: int, compiled: bool) -> None:
        self.text, self._order = text, order
        key = (text.source, text.threads, *text.bodies.values(), compiled)
        if key not in _COMPILED:
            _COMPILED[key] = kernel(text, compiled)
        self._advance = _COMPILED[key]

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the kernel."""
        given: dict[str, Any] = schedule | {"dt": dt}
        arguments = [given.get(name, value) for name, value in self.text.arguments.items()]
        private = []
        for array in self.text.private.values():
            if array.initial is not None:
                assert array.initial.shape == array.shape
                private.append(array.initial.astype(array.dtype))
            else:
                private.append(np.full(array.shape, np.nan, array.dtype))
        shared = np.empty((6, self.text.threads))
        self._advance(steps, self._order, shared, *arguments, *private)
        for array, used in zip(self.text.private.values(), private, strict=True):
            assert array.initial is None or np.array_equal(array.initial, used)


def kernel(text: Text, compiled: bool) -> Any:
    """Return the kernel of a text as a function of steps, order, shared memory and the kernel's own arguments."""
    names: dict[str, Any] = {**text.words, **text.types, **text.bodies, "nth": nth}
    phases = text.source[: text.source.index("def advance(")]
    if compiled:
        names |= {name: bind(body, cpu.WORDS, cpu.inlined, cpu._BOUND) for name, body in text.bodies.items()}
    exec(compile(phases + emulated(text), "<CUDA kernel on the CPU>", "exec"), names)
    if compiled:
        made = [name for name in names if name not in (*text.bodies, *text.types, *text.words, "__builtins__")]
        checked = numba.njit(error_model="numpy", boundscheck=True)
        names |= {name: checked(names[name]) for name in made}
    return names["advance"]


def emulated(text: Text) -> str:
    """Return the text of a kernel that does what the CUDA kernel does, one thread at a time."""
    lines = ["step = 0"]
    before, step, after = ([line for one in part for line in one_round(one)] for part in text.rounds)
    lines += [*before, "for step in range(steps):", *indented(step), *after]
    arguments = ", ".join(["steps", "order", "shared", *text.arguments, *text.private])
    return "\n".join([f"def advance({arguments}):", *indented(lines), ""])


def one_round(sweeps: Round) -> list[str]:
    """Return the text of a round, its passes in any order."""
    lines = [f"for s in range({len(sweeps)}):", f"    sweep = nth(s, {len(sweeps)}, order)"]
    for s, sweep in enumerate(sweeps):
        lines += [f"    if sweep == {s}:", *indented(indented(one_sweep(sweep)))]
    return lines


def one_sweep(sweep: Sweep) -> list[str]:
    """Return the text of a pass over all blocks."""
    done = []
    for call in sweep.calls:
        done += ["for t in range(int(THREADS)):", "    thread = np.uint32(nth(t, int(THREADS), order))", f"    {call}"]
    if sweep.chunks:
        done = [f"for chunk in range({sweep.chunks}):", "    shared[:] = np.nan", *indented(done)]
    blocks = [f"count = int({sweep.blocks})", "for b in range(count):", "    block = np.uint64(nth(b, count, order))"]
    return [*blocks, *indented(done)]
