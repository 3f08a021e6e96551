"""Compile the whole step for a GPU with every published law, and say what it needs; no GPU is needed.

python benchmarks/gpu_compile.py [--capability 8.0,9.0,10.0] [--threads 128] [--json FILE]

For each law and variant: the bounds of the launch (threads x blocks on a multiprocessor) that the engine takes, the
most at which all fits into registers; how many these are, bytes that do not fit, bytes of shared memory of a block,
seconds. Exits with 1 where a kernel spills 32 bytes or more. Needs the cuda extra: pip install pybondem[cuda].
"""

import argparse
import json
import re
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import user_law
from machine import circumstances

import pybondem as bd
from pybondem.assembly import assemble, step_program
from pybondem.bonds import ValuedLaw
from pybondem.engines.cuda_bonds import bond_text
from pybondem.engines.cuda_compile import Capability, Compiled, at_bounds, compile_kernel
from pybondem.engines.cuda_half_bonds import half_bond_text
from pybondem.engines.cuda_launch import CALLS, most_at_once
from pybondem.engines.cuda_text import THREADS
from pybondem.program import Program

VARIANTS = {"bonds": bond_text, "half-bonds": half_bond_text}
MOST_SPILLS = 32  # bytes written and read again, which may be more than once; none at all depends on the toolkit
TOOLKIT = {  # what makes machine code, and the package it comes in
    "numba-cuda": "numba-cuda", "nvvm": "nvidia-nvvm", "nvjitlink": "nvidia-nvjitlink", "ptxas": "nvidia-cuda-nvcc",
}  # fmt: skip


class Needs(NamedTuple):
    """What a kernel needs.

    Of law, variant and capability: bounds of the launch; registers; spilled and shared bytes; seconds of compilation;
    versions of what compiled it.
    """

    law: str
    variant: str
    capability: str
    bounds: tuple[int, int]
    registers: int | None
    spills: int | None
    shared: int
    seconds: float
    toolkit: dict[str, str | None]


def toolkit() -> dict[str, str | None]:
    """Return the versions of what makes machine code; None: it is not from a package."""
    found: dict[str, str | None] = {}
    for name, package in TOOLKIT.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            found[name] = None
    return found


def published() -> dict[str, ValuedLaw | None]:
    """Return no law, and every published law with its typical values."""
    return {"elastic": None} | {name: user_law.built_in(name) for name in user_law.names()}


def program(law: ValuedLaw | None) -> Program:
    """Return the step of bonds under a law, with all that a step may have: dashpots, damping, pushes, gravity."""
    model = bd.Model(bd.packing.line(3, spacing=1e-2, direction=(1, 2, 3), diameter=1e-2), density=2500.0)
    model.bond([[0, 1], [1, 2]], bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), law, damping=0.05))
    model.push(model.select([2]), fz=1.0)
    return step_program(assemble(model), (0.0, 0.0, -9.81), bd.local(0.2))


def needs(law: str, variant: str, capability: Capability = (9, 0), threads: int = THREADS) -> Needs:
    """Return what the kernel of a published law needs at the bounds that the engine takes; threads: of a block."""
    began = perf_counter()
    text = VARIANTS[variant](program(published()[law]), threads)
    first = compile_kernel(text, capability, (threads, 1))

    @cache
    def bounded(blocks: int) -> Compiled:
        return at_bounds(first, blocks)

    resident = most_at_once(threads, lambda blocks: CALLS + (bounded(blocks).frame or 0))
    made, (major, minor) = bounded(resident), capability
    shared = sum(int(n) for n in re.findall(r"\.shared .*\[(\d+)\]", made.ptx))
    return Needs(
        law, variant, f"{major}.{minor}", (threads, resident), made.registers, made.spills, shared,
        round(perf_counter() - began, 1), toolkit(),
    )  # fmt: skip


def line(found: Needs) -> str:
    """Return a line of the table."""
    what = f"{found.law:20} {found.variant:11} {found.capability:5} {found.bounds[0]} x {found.bounds[1]} "
    return f"{what} {found.registers!s:>9} {found.spills!s:>7} {found.shared:7d} {found.seconds:8.1f}"


HEAD = f"{'law':20} {'variant':11} {'sm':5} {'bounds':8} {'registers':>9} {'spills':>7} {'shared':>7} {'seconds':>8}"


def main() -> None:
    """Print the table, and write it to a file if asked to."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--capability", default="8.0,9.0,10.0", help="of the GPU, one or several")
    asked.add_argument("--threads", type=int, default=THREADS, help=f"of a block ({THREADS})")
    asked.add_argument("--json", type=Path, help="file for the table")
    given = asked.parse_args()
    print(HEAD)
    found: list[Needs] = []
    for words in given.capability.split(","):
        major, _, minor = words.partition(".")
        for law in published():
            for variant in VARIANTS:
                found.append(needs(law, variant, (int(major), int(minor or 0)), given.threads))
                print(line(found[-1]), flush=True)
    if given.json:
        record: dict[str, Any] = {"kernels": [f._asdict() for f in found], **circumstances()}
        given.json.write_text(json.dumps(record, indent=1) + "\n")
    if spilling := [line(f) for f in found if (f.spills or 0) >= MOST_SPILLS]:
        sys.exit("\n".join([f"{MOST_SPILLS} bytes or more are spilled:", *spilling]))


if __name__ == "__main__":
    main()
