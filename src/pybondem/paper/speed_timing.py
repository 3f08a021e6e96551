"""How long a step takes: engines by sizes, each time a point with its samples."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pybondem.engines.choose import make_engine
from pybondem.engines.cuda_device import bytes_per_particle, fastest, particles_that_fit, usable
from pybondem.errors import EngineError
from pybondem.model import Model
from pybondem.output.progress import waiting
from pybondem.paper.speed_cylinder import Stepper, cylinder

Floats = NDArray[np.float64]
Loads = tuple[Floats, Floats]  # forces and torques (n, 3) each
Kind = str  # interpreted, numpy, numba, threads or gpu: what a ratio is taken of

ITERATIONS = 100  # of the paper, whose mean is one sample
LEAST, MOST = 3, 20  # samples of so many iterations, and fewest samples of all
PATIENCE = 10.0  # times the seconds of the others: for interpreted Python, to have its 100 iterations
HOST_BYTES = 1100  # per particle at the most, building included
NUMPY_BYTES = 5200  # NumPy keeps what it computes in between
SURE = 1_000_000  # particles that are tried where the system does not say how much memory is free


class Way(NamedTuple):
    """A way to step: kind, name to be read, engine, threads, most particles, bytes per particle, most on a GPU."""

    kind: Kind
    label: str
    engine: str
    threads: int | None = None
    most: float = np.inf
    host_bytes: int = HOST_BYTES
    gpu_most: float = np.inf


class Point(NamedTuple):
    """What was measured of one way at one size.

    samples: seconds per step, each the mean over `steps` iterations done in one call; alone: seconds of iterations that
    were called and waited for one by one; difference: of forces and torques from those of the first way at this size,
    over the largest; None: not measured, or nothing to compare with; array_bytes: of what is stepped on; device: where
    it comes from, if not from this run.
    """

    kind: Kind
    label: str
    particles: int
    bonds: int
    steps: int
    samples: tuple[float, ...]
    alone: tuple[float, ...] = ()
    difference: float | None = None
    array_bytes: float | None = None
    device: str | None = None

    @property
    def mean(self) -> float:
        """Mean time of a step [s]."""
        return float(np.mean(self.samples))

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """First quartile, median and third quartile of the samples [s]."""
        low, middle, high = np.percentile(self.samples, (25, 50, 75)).tolist()
        return low, middle, high

    @property
    def median(self) -> float:
        """Median of the samples [s]."""
        return self.quartiles[1]


def ways(threads: int | None, most_interpreted: int) -> list[Way]:
    """Return what this machine can step with; threads: of the cpu engine, by default the physical cores.

    The first one is what the others' forces are compared with.
    """
    from pybondem.engines.cpu import Cpu

    every = Cpu(threads).threads
    found = [
        Way("numpy", "vectorised NumPy", "reference", None, SURE, NUMPY_BYTES),
        Way("interpreted", "interpreted Python", "interpreted", None, most_interpreted),
        Way("numba", "Numba, 1 thread", "cpu", 1),
    ]
    if every > 1:
        found.append(Way("threads", f"Numba, {every} threads", "cpu", every))
    with suppress(EngineError):
        gpu = usable()
        fit = particles_that_fit(gpu.free, bytes_per_particle(fastest(gpu.capability)))
        found.append(Way("gpu", f"CUDA, {gpu.name}", "cuda", gpu_most=fit))
    return found


def measure(sizes: Sequence[int], found: Sequence[Way], budget: float, quiet: bool) -> tuple[list[Point], list[str]]:
    """Time every way at every size, for about so many seconds each; returns points, and what was left out and why."""
    points: list[Point] = []
    left_out: list[str] = []
    for size in sizes:
        fit = []
        for way in found:
            slow = f"a step takes too long beyond {way.most:,}" if size > way.most else ""
            why = slow or too_large(way, size, free_memory())
            fit += [] if why else [way]
            left_out += [f"{way.label} with {size:,} particles: {why}"] if why else []
        if fit:
            with waiting(f"building {size:,} particles", quiet):
                model = cylinder(size)
            points += _at_one_size(model, fit, budget, quiet)
    return points, left_out


def _at_one_size(model: Model, fit: Sequence[Way], budget: float, quiet: bool) -> Iterator[Point]:
    """Yield the points of one model, the first one being the others' truth."""
    truth: Loads | None = None
    for way in fit:
        with waiting(f"timing {way.label}: {len(model):,} particles", quiet):
            point, loads = _timed_way(model, way, truth, budget)
        truth = truth or loads
        yield point


def _timed_way(model: Model, way: Way, truth: Loads | None, budget: float) -> tuple[Point, Loads]:
    """Return the point of one way, and the loads after its first step; nothing else that it took stays in memory."""
    stepper = Stepper(model, make_engine(way.engine, way.threads), records=way.kind == "interpreted")
    began = perf_counter()
    stepper.advance(1)
    first, loads = perf_counter() - began, stepper.loads
    difference = None if truth is None else apart(loads, truth)
    samples, steps = timed(stepper.advance, first, budget * (PATIENCE if way.kind == "interpreted" else 1.0))
    alone = samples if steps == 1 else sampled(stepper.advance, 1, ITERATIONS, budget)
    size = len(model), sum(len(each.pairs) for each in model.bonds)
    return Point(way.kind, way.label, *size, steps, samples, alone, difference, stepper.array_bytes), loads


def timed(
    advance: Callable[[int], None], first: float, budget: float, clock: Callable[[], float] = perf_counter
) -> tuple[tuple[float, ...], int]:
    """Return seconds per step of each sample, and the steps of a sample: 100, or 1 where that would take too long.

    first: what a step takes [s], nearly; budget: for all samples [s], of which there are three at the least.
    """
    steps = ITERATIONS if LEAST * ITERATIONS * first <= budget else 1
    return sampled(advance, steps, MOST if steps > 1 else ITERATIONS, budget, clock), steps


def sampled(
    advance: Callable[[int], None], steps: int, most: int, budget: float, clock: Callable[[], float] = perf_counter
) -> tuple[float, ...]:
    """Return seconds per step of samples of so many steps, each waited for: as many as the budget [s] allows."""
    samples: list[float] = []
    opened = clock()
    while len(samples) < LEAST or (len(samples) < most and clock() - opened < budget):
        began = clock()
        advance(steps)
        samples.append((clock() - began) / steps)
    return tuple(samples)


def apart(loads: Loads, truth: Loads) -> float:
    """Return the largest difference of two sets of forces, or of torques, over the largest force, or torque."""
    each = [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(loads, truth, strict=True)]
    return float(np.max(each))  # nan where one is, unlike max()


def too_large(way: Way, particles: int, free: int | None) -> str:
    """Return why so many particles do not fit, or nothing; free: memory [bytes], None where it is not known."""
    if particles > way.gpu_most:
        return f"the GPU has room for {way.gpu_most / 1e6:.3g} million"
    if free is None:
        return "" if particles <= SURE else "how much memory is free is not known"
    needed = particles * way.host_bytes
    return "" if needed <= free else f"it needs {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"


def free_memory() -> int | None:
    """Return the memory that this process may still take [bytes], None where the system does not say."""
    found: list[int] = []
    with suppress(OSError, StopIteration):  # what Linux can give, caches handed back
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        found.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    if not found:
        with suppress(AttributeError, ValueError, OSError):
            found.append(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with suppress(OSError, ValueError, StopIteration):  # what a container is allowed; "max" is no number
        group = Path("/sys/fs/cgroup")
        allowed = int((group / "memory.max").read_text(encoding="utf-8"))
        held = (group / "memory.stat").read_text(encoding="utf-8").splitlines()
        kept = next(line for line in held if line.startswith("anon "))
        found.append(max(0, allowed - int(kept.split()[1])))
    return min(found, default=None)
