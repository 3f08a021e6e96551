"""Figure 1 of the paper, speed: time of a step by number of particles on every engine, with equal forces."""

import os
from collections.abc import Sequence
from itertools import groupby, product
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from pybondem.engines.cpu import BONDS_PER_THREAD, physical_cores
from pybondem.engines.cuda_device import described
from pybondem.output.folder import provenance
from pybondem.output.readable import compact
from pybondem.output.sheet import Sheet, Table
from pybondem.paper.effort import Effort
from pybondem.paper.speed_cylinder import SHAKEN
from pybondem.paper.speed_gpu import DATA, committed
from pybondem.paper.speed_pictures import CPU_OF_PAPER, GPU_OF_PAPER, LOOKS, draw_gains, draw_times
from pybondem.paper.speed_timing import ITERATIONS, LEAST, PATIENCE, Kind, Point, measure, ways


class Plan(NamedTuple):
    """Sizes asked for, the largest one for interpreted Python, and seconds of timing for each point."""

    sizes: tuple[int, ...]
    most_interpreted: int
    budget: float


PAPERS = (1_000, 2_000, 4_000, 6_000, 8_000, 10_000)
FULL = Plan((*PAPERS, 100_000, 1_000_000, 10_000_000), PAPERS[-1], 20.0)
QUICK = Plan((300, 1_000), 1_000, 0.5)

# Ratios of interest, slow over fast, and what the paper says of them.
RATIOS: dict[tuple[Kind, Kind], str] = {
    ("interpreted", "numba"): "{} to {}".format(*CPU_OF_PAPER),
    ("interpreted", "threads"): "",
    ("interpreted", "gpu"): "{} to {}".format(*GPU_OF_PAPER),
    ("interpreted", "numpy"): "",
    ("numpy", "numba"): "",
    ("numpy", "threads"): "",
    ("numpy", "gpu"): "",
    ("numba", "threads"): "",
    ("numba", "gpu"): "4",
}
TIMES = ("particles", "bonds", "engine", "mean [ms]", "median [ms]", "quartiles [ms]", "ns per bond and step")
CIRCUMSTANCES = ("particles", "engine", "samples x iterations", "called alone [ms]", "forces off by", "arrays [MB]")


def figure(folder: Path, effort: Effort, data: Path = DATA) -> Sheet:
    """Time a step of the cylinder on every engine and at every size, and return the sheet.

    All engines are timed, whatever the effort's engine; its threads are those of the engine cpu at its fastest. data:
    folder of the results of GPUs, which are shown where this machine has none. About 25 minutes on two cores.
    """
    plan = QUICK if effort.quick else FULL
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None  # by others: before anything is timed
    points, left_out = measure(plan.sizes, ways(effort.threads, plan.most_interpreted), plan.budget, effort.quiet)
    if not any(p.kind == "gpu" for p in points):
        points += committed(data)
    sheet = Sheet("fig1", "Figure 1: time of a step by number of particles", folder)
    sheet.pictures = {
        "Time of a step (forces and integration) of the hexagonally packed cylinder: medians, with quartiles as bars.":
            draw_times(folder / "fig1-times.png", points),
        "How many times faster than interpreted Python, and what the paper quotes.":
            draw_gains(folder / "fig1-gains.png", points),
    }  # fmt: skip
    ordered = sorted(points, key=lambda p: (p.particles, list(LOOKS).index(p.kind)))
    sheet.tables = [
        Table("Time of a step", TIMES, [_times(p) for p in ordered]),
        Table("How it was measured", CIRCUMSTANCES, [_circumstances(p) for p in ordered]),
        ratio_table(points),
    ]
    sheet.remarks = remarks(points, plan)
    if load is not None and load > DISTURBED:
        sheet.remarks.append(BUSY.format(load))
    if left_out:
        sheet.remarks.append(f"Left out: {'; '.join(left_out)}.")
    sheet.facts = {"points": [_fact(p) for p in points], "left out": left_out, "GPU of this machine": described(),
                   "physical cores": physical_cores(), "load before": load}  # fmt: skip
    return sheet


def _times(p: Point) -> list[Any]:
    """Return the cells of a point in the first table."""
    low, middle, high = (compact(1e3 * value, 3) for value in p.quartiles)
    per_bond = compact(1e9 * p.median / p.bonds, 3)
    return [p.particles, p.bonds, p.label, compact(1e3 * p.mean, 3), middle, f"{low} to {high}", per_bond]


def _circumstances(p: Point) -> list[Any]:
    """Return the cells of a point in the second table."""
    return [
        p.particles, p.label, f"{len(p.samples)} x {p.steps}",
        compact(1e3 * median(p.alone), 3) if p.alone else "",
        "" if p.difference is None else compact(p.difference),
        "" if p.array_bytes is None else compact(1e-6 * p.array_bytes, 3),
    ]  # fmt: skip


def ratio_table(points: Sequence[Point]) -> Table:
    """Return the table of how many times longer one takes than another: a row for each two, a column for each size."""
    sizes = {n: {p.label: p.median for p in points if p.particles == n} for n in sorted({p.particles for p in points})}
    sizes = {n: medians for n, medians in sizes.items() if len(medians) > 1}
    rows: list[list[Any]] = []
    for (slow, fast), quoted in RATIOS.items():
        for a, b in product(_labels(points, slow), _labels(points, fast)):
            found = [compact(m[a] / m[b], 3) if {a, b} <= m.keys() else "" for m in sizes.values()]
            rows.append([f"{a} / {b}", quoted, *found])
    return Table("Ratios of the medians, by number of particles", ["ratio", "the paper", *map(str, sizes)], rows)


def _labels(points: Sequence[Point], kind: Kind) -> list[str]:
    """Return the names of the ways of a kind."""
    return list(dict.fromkeys(p.label for p in points if p.kind == kind))


def remarks(points: Sequence[Point], plan: Plan) -> list[str]:
    """Return what has to be said of the figure."""
    made = provenance()
    cores = physical_cores()
    differences = [p.difference for p in points if p.difference is not None]
    truths = ", at larger sizes ".join(dict.fromkeys(own[0].label for own in _measured_by_size(points)))
    said = [
        f"Machine: {made['cpu']}, {cores} physical core{'s' if cores > 1 else ''}; Python {made['python']}, NumPy "
        f"{made['numpy']}, Numba {made['numba']}. On many threads each takes {BONDS_PER_THREAD} bonds at least.",
        f"A sample is the mean over {ITERATIONS} iterations that one call runs one after the other, each begun when "
        f"all of the one before is done, and the call returns after the last; where {LEAST} such samples take more "
        f"than {plan.budget:g} s ({PATIENCE * plan.budget:g} s for interpreted Python), a sample is one iteration. "
        "Everything is compiled and has been run before. \"Called "
        "alone\" is the median of iterations that Python calls and waits for one by one: the difference is what a "
        "call costs, which a run of many steps does not pay. The arrays are what a step works on; what NumPy "
        "holds in passing, several times as much, is not counted.",
        "Interpreted Python is one loop over the particles and bonds as records of NumPy structured arrays, as the "
        "paper describes its baseline, whose code is not public. The fields are read through views of the records; "
        "looking each up by its name would make the baseline slower and all ratios to it larger. They say as much "
        "about interpreted Python as about what is compared with it: vectorised NumPy is the fairer measure.",
    ]  # fmt: skip
    if differences:
        off = float(np.max(differences))
        same = "the same bit for bit" if off == 0.0 else f"off by at most {compact(off)} of the largest"
        said.append(
            f"The same forces: every particle starts with a random velocity ({SHAKEN:g} m/s) and spin, so that every "
            "bond outside the held ends carries all six loads, and after the first step the forces and torques on the "
            f"particles are {same} "
            f"(against {truths})."
        )
    return [*said, _on_gpus(points), FLAT]


FLAT = (
    "In the paper the GPU's time does not grow below 6000 particles, which it puts down to a card that holds 10 240 "
    "threads at once. Forces take one thread per bond, however, some 30 000 at that size, so the card was full long "
    "before: a time without a size is rather that of Python launching the two kernels of a step, and shrinks where "
    "one launch covers many steps, as it does here."
)

DISTURBED = 1.0  # load average
BUSY = (
    "This machine was busy with something else: a load average of {:.2g} before the first time was taken. Threads wait "
    "for one another, and what disturbs one holds up all: times on several threads are to be taken on an idle machine."
)


def _on_gpus(points: Sequence[Point]) -> str:
    """Return where the times of GPUs come from."""
    gpu = [p for p in points if p.kind == "gpu"]
    kept = list(dict.fromkeys(p.device for p in gpu if p.device))
    if kept:
        return f"GPU: results kept with the package, not measured in this run ({'; '.join(kept)})."
    if gpu:
        return f"GPU: measured in this run on {described()}."
    return f"GPU: no curve, for this machine has {described()}, and no results of another one come with the package."


def _measured_by_size(points: Sequence[Point]) -> list[list[Point]]:
    """Return the points of this run, size by size, in the order in which they were measured."""
    here = sorted((p for p in points if p.device is None), key=lambda p: p.particles)
    return [list(own) for _, own in groupby(here, lambda p: p.particles)]


def _fact(p: Point) -> dict[str, Any]:
    """Return a point for programs [s]."""
    low, middle, high = p.quartiles
    return {**p._asdict(), "mean": p.mean, "median": middle, "first quartile": low, "third quartile": high}
