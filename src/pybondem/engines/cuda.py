"""The cuda engine: a program as one cooperative kernel, its arrays in GPU memory until somebody looks at them.

One launch advances many steps. The same bits on every run of one GPU: no atomics, sums in fixed order.
"""

import gc
from collections.abc import Callable
from typing import Any, get_args

import numpy as np

from pybondem.check import choice, whole_number
from pybondem.engines.compile_errors import refuse_laws
from pybondem.engines.cuda_bonds import bond_text
from pybondem.engines.cuda_compile import assembly
from pybondem.engines.cuda_device import Variant, fastest, usable
from pybondem.engines.cuda_half_bonds import half_bond_text
from pybondem.engines.cuda_launch import Device, Launch, out_of_memory
from pybondem.engines.cuda_memory import Mirror, Rows
from pybondem.engines.cuda_phases import fields_of
from pybondem.engines.cuda_text import THREADS, Text, is_step, stage_text
from pybondem.errors import EngineError, InputError
from pybondem.program import Program
from pybondem.state import ENERGY, GROWING, SCHEDULED_FIELDS, Arrays, Fields

GIVEN = {
    ENERGY.name,
    GROWING.name,
    *(field.name for field in SCHEDULED_FIELDS),
}  # with each call, not held between calls
TEXTS: dict[Variant, Callable[[Program, int], Text]] = {"bonds": bond_text, "half-bonds": half_bond_text}
MOST_THREADS = 1024  # of a block
LEFT_FREE = 2**26  # bytes of GPU memory for the kernel itself


class CudaRunner:
    """A program on the GPU."""

    def __init__(self, program: Program, text: Text, device: Device, mirror: Mirror, at_once: int | None) -> None:
        self._program, self._text, self._device, self._mirror = program, text, device, mirror
        self._at_once = at_once
        self._launch: Launch | None = None
        self._steps = 0
        self._tables: dict[str, Rows] = {}
        self._arrays = {n: a for n, a in text.arguments.items() if isinstance(a, np.ndarray) and n not in GIVEN}
        self._moving = {} if isinstance(program.particles, Fields) else _read_of_particles(program)
        self._make_room()
        for fields in (program.particles, program.shared, *program.bonds.values()):
            if isinstance(fields, Fields):
                fields.source = mirror

    def _make_room(self) -> None:
        """Take the GPU memory that the program needs; raises EngineError where there is too little, nothing taken."""
        private = self._text.private.values()
        needed = self._mirror.missing(self._arrays.values())
        needed += sum(int(np.prod(p.shape)) * np.dtype(p.dtype).itemsize for p in private)
        free = self._device.free()
        if needed + LEFT_FREE > free:
            gc.collect()  # simulations that nobody can reach any more
            free = self._device.free()
        if needed + LEFT_FREE > free:
            raise out_of_memory(self._device.gpu, needed + LEFT_FREE, free)
        self._private = [self._device.empty(p.shape, p.dtype) for p in private]
        self._mirror.keep_all(self._arrays.values())
        for there, p in zip(self._private, private, strict=True):
            if p.initial is not None:
                self._device.upload(p.initial, there)
        self._text = self._text.without_initial()  # which may be gigabytes

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the program's stages `steps` times, dt [s] apart.

        An array of the schedule that the program writes is brought back into it. Raises EngineError where the GPU
        fails, with the steps it was in: what it held is lost then.
        """
        if steps == 0:
            return
        for array in self._moving.values():
            self._mirror.changed(array)
        arguments, written = self._text.arguments, self._text.written
        tables = {name: self._table(name, table) for name, table in schedule.items() if name in arguments}
        given: dict[str, Any] = tables | {"dt": dt}
        values = [given[name] if name in given else self._value(value) for name, value in arguments.items()]
        for name in written - tables.keys():  # at once: the copies are up to date, whatever becomes of the launch
            self._mirror.written(self._arrays[name])
        self._run(steps, dt, [*values, *self._private])
        for name in written & tables.keys():
            self._device.download(tables[name], schedule[name])
        if not isinstance(self._program.particles, Fields):
            for array in self._program.particles.values():
                self._mirror.fetch(array)

    def _table(self, name: str, table: Any) -> Any:
        """Return a table of the schedule in GPU memory; one that the program writes has arbitrary values there."""
        there = self._tables.setdefault(name, Rows(self._device)).for_table(table)
        if name not in self._text.written:
            self._device.upload(table, there)
        return there

    def _value(self, value: Any) -> Any:
        """Return what the kernel takes for an argument that is the same in all calls."""
        return self._mirror.copy_of(value) if isinstance(value, np.ndarray) else value

    def _compiled(self, values: list[Any]) -> Launch:
        """Return the compiled kernel; raises LawError with its author's own line where a law is what cannot be."""
        try:
            return self._device.kernel(self._text, values, self._at_once)
        except EngineError:
            raise
        except Exception:  # Numba raises more than its own errors
            capability = self._device.gpu.capability
            refuse_laws(self._program, lambda law: assembly(law.function, law.types, capability))
            raise

    def _run(self, steps: int, dt: float, values: list[Any]) -> None:
        """Launch the kernel; a step of no length is none that the user counts."""
        if self._launch is None:
            self._launch = self._compiled(values)
        counted = steps if dt > 0.0 else 0
        first, last = self._steps + min(counted, 1), self._steps + counted
        try:
            self._launch(steps, *values)
        except EngineError as error:
            raise EngineError(f"in steps {first} to {last} {error}") from error
        self._steps += counted


def _read_of_particles(program: Program) -> dict[str, Any]:
    """Return the particle arrays whose values the stages read: what a host that keeps no `Fields` sets before a call.

    Positions that stages only take chords from are constant, and are not among them.
    """
    read = {name.partition(".")[0] for stage in program.stages for name in fields_of(stage.reads)}
    return {name: array for name, array in program.particles.items() if name in read and isinstance(array, np.ndarray)}


class Cuda:
    """Engine "cuda".

    variant: how a step is laid out on the GPU. "bonds": one thread per bond, loads through memory, two meetings of all
    blocks in a step; "half-bonds": one thread for each end of a bond, loads within a block, one meeting; None: what
    should be faster on this GPU. threads: of a block; at_once: blocks that must fit on one multiprocessor, where more
    of them wait less for memory and leave fewer registers to each; None: as many as fit without spills. Raises
    EngineError where no GPU can be used; never runs on anything else.
    """

    name = "cuda"

    def __init__(self, variant: Variant | None = None, threads: int = THREADS, at_once: int | None = None) -> None:
        if variant is not None:
            choice("variant of the engine cuda", variant, get_args(Variant))
        self.threads = whole_number("threads of the engine cuda", threads)
        if self.threads > MOST_THREADS:
            raise InputError(f"threads of the engine cuda is {threads}; it must not exceed {MOST_THREADS}.")
        self.at_once = None if at_once is None else whole_number("at_once of the engine cuda", at_once)
        try:
            self.gpu = usable()
        except EngineError as error:
            raise EngineError(f"the engine cuda cannot run: {error} The engine cpu needs no GPU.") from None
        self.variant: Variant = variant or fastest(self.gpu.capability)
        self._device = Device(self.gpu)
        self._mirror = Mirror(self._device)

    def prepare(self, program: Program) -> CudaRunner:
        """Return a runner for the program, with room for it in GPU memory; compiled on first use, then cached.

        Raises EngineError with needed and free bytes where the program does not fit.
        """
        make = TEXTS[self.variant] if is_step(program) else stage_text
        text = make(program, self.threads)
        return CudaRunner(program, text, self._device, self._mirror, self.at_once)
