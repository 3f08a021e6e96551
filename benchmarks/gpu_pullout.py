"""The pull-out example as it is, with more particles, on the GPU: how long a whole run takes.

python benchmarks/gpu_pullout.py --particles 45000 --folder FOLDER --json FILE
"""

import argparse
from pathlib import Path
from time import perf_counter

from gpu_equality import EXAMPLE
from machine import circumstances
from run import append

import pybondem as bd


def main() -> None:
    """Run, print, append to the file that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, default=45_000)
    parser.add_argument("--engine", default="cuda")
    parser.add_argument("--folder", type=Path, help="of the result, new; by default one in runs/")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    example = bd.examples.pullout(diameter=EXAMPLE[0] * (EXAMPLE[1] / options.particles) ** (1.0 / 3.0))
    particles = len(example.build().model)
    began = perf_counter()
    example.run(engine=options.engine, folder=options.folder, quiet=True)
    seconds = perf_counter() - began
    print(f"pull-out, {particles:,} particles on {options.engine}: {seconds:.1f} s, model, steps and result folder")
    if options.json:
        found = {"job": "pull-out", "particles": particles, "engine": options.engine, "seconds": seconds}
        append(options.json, [{**circumstances(), **found}])


if __name__ == "__main__":
    main()
