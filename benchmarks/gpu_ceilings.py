"""What this GPU can do at most, measured, and what share of it figures reach that were taken on it.

python benchmarks/gpu_ceilings.py --json FILE     memory copied and double-precision multiply-adds per second; appends a
                                                  record to the list in FILE, and with --beside says what share of these
                                                  the figures of the cylinder job in that file reach
"""

import argparse
import json
import re
from pathlib import Path
from statistics import median
from typing import Any

import cylinder
import numpy as np
from run import append

import pybondem as bd
from pybondem.assembly import assemble, step_program
from pybondem.engines.cuda_compile import compile_kernel
from pybondem.engines.cuda_device import fastest, usable
from pybondem.engines.cuda_text import stage_text

WORDS = 2**26  # doubles copied: 512 MiB each way, far more than any cache holds
ROUNDS = 4096  # multiply-adds of a thread in each of its chains
CHAINS = 8  # independent of each other, so that none waits for the one before
BLOCKS, THREADS = 132 * 8, 256
REPEATS = 9
ARITHMETIC = re.compile(r"\b(?:fma|mul|add|sub|div|sqrt|rcp|abs|neg|min|max|setp)\.\S*f64\b")


# What it can do -------------------------------------------------------------------------------------------------


def kernels() -> tuple[Any, Any]:
    """Return the copy kernel and the multiply-add kernel."""
    from numba import cuda

    @cuda.jit
    def copy(source: Any, target: Any) -> None:
        for k in range(cuda.grid(1), source.size, cuda.gridsize(1)):
            target[k] = source[k]

    @cuda.jit
    def multiply_add(target: Any, factor: float, rounds: int) -> None:
        k = cuda.grid(1)
        a = b = c = d = e = f = g = h = float(k)
        for _ in range(rounds):
            a, b, c, d = a * factor + 1.0, b * factor + 2.0, c * factor + 3.0, d * factor + 4.0
            e, f, g, h = e * factor + 5.0, f * factor + 6.0, g * factor + 7.0, h * factor + 8.0
        target[k] = a + b + c + d + e + f + g + h

    return copy, multiply_add


def seconds(launch: Any) -> float:
    """Return the median time that a launch takes on the GPU [s], after two that warm it up."""
    from numba import cuda

    times = []
    for _ in range(2 + REPEATS):
        began, ended = cuda.event(), cuda.event()
        began.record()
        launch()
        ended.record()
        ended.synchronize()
        times.append(1e-3 * cuda.event_elapsed_time(began, ended))
    return median(times[2:])


def ceilings() -> dict[str, Any]:
    """Return bytes per second copied (read and written both counted) and multiply-adds per second.

    Raises EngineError where there is no GPU to be used, RuntimeError where a kernel has not done its work.
    """
    from numba import cuda

    gpu = usable()
    copy, multiply_add = kernels()
    words = np.random.default_rng(1).random(WORDS)
    source, target = cuda.to_device(words), cuda.device_array(WORDS)
    copied = seconds(lambda: copy[BLOCKS, THREADS](source, target))
    few = cuda.device_array(BLOCKS * THREADS)
    added = seconds(lambda: multiply_add[BLOCKS, THREADS](few, 0.5, ROUNDS))
    limit = 2.0 * sum(range(1, CHAINS + 1))  # each chain tends to its constant over 1 - factor
    if not np.array_equal(target.copy_to_host(), words) or not np.allclose(few.copy_to_host(), limit, rtol=1e-12):
        raise RuntimeError("a kernel of the ceilings has not done its work.")
    return {
        "gpu": gpu.name,
        "driver": gpu.driver,
        "variant": fastest(gpu.capability),
        "copy_bytes_per_s": 2.0 * words.nbytes / copied,
        "fp64_multiply_adds_per_s": float(BLOCKS * THREADS * CHAINS * ROUNDS) / added,
    }


# What is made of it ---------------------------------------------------------------------------------------------


def least_bytes() -> float:
    """Return the memory traffic per particle and step that no layout avoids, in the cylinder job [bytes].

    Read and written once: x, q, v, w, work of the particle; power and damped of its six bonds. Read once: its start and
    its group, both ends of its bonds.
    """
    changing, bonds = 3 + 4 + 3 + 3 + 1, 6
    return 8.0 * (2 * changing + 3) + 4.0 + bonds * (2 * 2 * 8.0 + 2 * 4.0)


def arithmetic_per_bond() -> int:
    """Return the double-precision instructions that evaluate one bond of the cylinder job, a division or root as one.

    Counted in the compiler's text: that of a kernel with bonds less that of one without.
    """
    rod = cylinder.model(cylinder.packing(100))
    alone = bd.Model(bd.packing.Particles(rod.x, rod.radius), density=cylinder.DENSITY)
    counts = []
    for model in (rod, alone):
        text = stage_text(step_program(assemble(model), (0.0, 0.0, 0.0), None))
        counts.append(len(ARITHMETIC.findall(compile_kernel(text).ptx)))
    return counts[0] - counts[1]


def shares(record: dict[str, Any], most: dict[str, Any], per_bond: int) -> dict[str, float]:
    """Return what share of the ceilings a figure of the cylinder job reaches: memory, arithmetic.

    Of the traffic that no layout avoids, and of the arithmetic of its variant: twice as much where each end of a bond
    is evaluated by itself.
    """
    rate = record["particle_steps_per_s"]
    halves = "half-bonds" in (most["variant"] if record["engine"] == "cuda" else record["engine"])
    arithmetic = per_bond * (2 if halves else 1) * record["bonds"] / record["particles"]
    return {
        "memory_share": rate * least_bytes() / most["copy_bytes_per_s"],
        "arithmetic_share": rate * arithmetic / most["fp64_multiply_adds_per_s"],
    }


def main() -> None:
    """Measure, print, and append to the file that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--beside", action="store_true", help="also the shares that the figures in FILE reach")
    options = parser.parse_args()
    most = ceilings()
    print(
        f"{most['gpu']}: {most['copy_bytes_per_s']:.3g} B/s copied, {most['fp64_multiply_adds_per_s']:.3g} fp64 FMA/s"
    )
    found: dict[str, Any] = {"job": "ceilings", **most}
    if options.beside:
        per_bond = arithmetic_per_bond()
        records = [r for r in json.loads(options.json.read_text()) if r.get("job") == "cylinder"]
        found |= {"arithmetic_per_bond": per_bond, "least_bytes_per_particle": least_bytes(), "shares": []}
        for record in (r for r in records if r["engine"].startswith("cuda")):
            reached = {name: record[name] for name in ("engine", "particles", "particle_steps_per_s")}
            found["shares"].append(reached | shares(record, most, per_bond))
            print(
                "{engine:16s} {particles:>10,d} particles {particle_steps_per_s:10.3g} particle-steps/s: "
                "{memory_share:6.1%} of memory, {arithmetic_share:6.1%} of arithmetic".format(**found["shares"][-1])
            )
    if options.json:
        append(options.json, [found])


if __name__ == "__main__":
    main()
