"""Ways to lay out a step on the GPU against each other: variant, threads of a block, blocks on a multiprocessor.

python benchmarks/gpu_variants.py --particles 200000 --json FILE     one line and one record for each
"""

import argparse
from itertools import product
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, get_args
from unittest import mock

import cylinder
from machine import circumstances
from run import append

import pybondem as bd
from pybondem import simulation
from pybondem.engines.cuda import Cuda
from pybondem.engines.cuda_device import Variant

# Threads of a block, blocks on a multiprocessor: 384, 256 and 512 threads on it at registers for as many.
LAYOUTS: tuple[tuple[int, int], ...] = ((128, 3), (128, 2), (128, 4), (64, 6), (96, 4), (192, 2), (256, 1), (256, 2))
SECONDS, REPEATS = 0.3, 5


def seconds_per_step(sim: bd.Simulation) -> list[float]:
    """Return the wall time of a step [s], several times over."""
    steps, spent = 8, 0.0
    while spent < 0.25 * SECONDS:
        steps *= 2
        began = perf_counter()
        sim.run(steps=steps, quiet=True)
        spent = perf_counter() - began
    found = []
    for _ in range(REPEATS):
        began = perf_counter()
        sim.run(steps=steps, quiet=True)
        found.append((perf_counter() - began) / steps)
    return found


def main() -> None:
    """Measure, print, and append to the file that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, default=200_000)
    parser.add_argument("--layouts", type=int, default=len(LAYOUTS), help="of each variant, the first so many")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    rod = cylinder.model(cylinder.packing(options.particles))
    limit = bd.Simulation(cylinder.model(cylinder.packing(1000)), dt=cylinder.DT).limit
    for variant, (threads, at_once) in product(get_args(Variant), LAYOUTS[: options.layouts]):
        engine = Cuda(variant, threads, at_once)
        with mock.patch.object(simulation, "stability_limit", return_value=limit):  # found once for all
            sim = bd.Simulation(rod, engine=engine, dt=cylinder.DT)
        times = seconds_per_step(sim)
        rate = len(rod) / median(times)
        print(f"{variant:12s} {threads:4d} threads, {at_once} at once: {rate:10.3g} particle-steps/s", flush=True)
        if options.json:
            case: dict[str, Any] = {"job": "cylinder layouts", "variant": variant, "threads": threads}
            case |= {"at_once": at_once, "particles": len(rod), "bonds": sim.bond_count, "step_s": times}
            append(options.json, [{**circumstances(), "gpu": engine.gpu.name, **case, "particle_steps_per_s": rate}])


if __name__ == "__main__":
    main()
