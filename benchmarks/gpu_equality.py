"""The pull-out example in elastic motion on the GPU and on the CPU: the same to round-off, and the same bits again.

python benchmarks/gpu_equality.py --particles 45000 --engines cuda:bonds,cuda:half-bonds --json FILE

Every particle starts with a random velocity and spin. Exits with 1 where an engine is off by more than 1e-9 of the
largest value after 1000 steps, or where a second run does not give the same bits.
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from machine import circumstances
from run import append

import pybondem as bd

ALLOWED = 1e-9
UNBREAKABLE = bd.bilinear(stiffness=6e7, slip_peak=1.0, slip_end=2.0)  # stays below its peak
EXAMPLE = (0.7, 13_600)  # diameter [m] and number of particles of the example as it is
SPEED, SPIN = 1.0, 1.0  # [m/s], [rad/s]
LOOKED_AT = ("displacement", "q", "v", "w", "force", "torque")

State = dict[str, Any]


def pullout(particles: int) -> bd.Model:
    """Return the model of the pull-out example with about so many particles, its interface elastic."""
    diameter = EXAMPLE[0] * (EXAMPLE[1] / particles) ** (1.0 / 3.0)
    return bd.examples.pullout(diameter=diameter, interface=UNBREAKABLE, pull=1e-3).build().model


def run(model: bd.Model, engine: str, steps: int) -> tuple[State, float]:
    """Return the state after so many steps, and the wall time of a step [s]."""
    sim = bd.Simulation(model, engine=engine)
    rng = np.random.default_rng(7)
    with sim.edit("v", "w") as (v, w):
        v[:], w[:] = rng.normal(scale=SPEED, size=v.shape), rng.normal(scale=SPIN, size=w.shape)
    began = perf_counter()
    sim.run(steps=steps, quiet=True)
    spent = perf_counter() - began
    p = sim.particles
    state = {"displacement": p.x - model.x, **{name: getattr(p, name) for name in LOOKED_AT[1:]}}
    return state, spent / steps


def difference(state: State, truth: State) -> dict[str, float]:
    """Return how far each field is off at most, over the largest value of the field."""
    return {name: float(np.abs(state[name] - truth[name]).max() / np.abs(truth[name]).max()) for name in truth}


def main() -> None:
    """Compare, print, append to the file that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, default=45_000)
    parser.add_argument("--engines", type=lambda text: text.split(","), default=["cuda:bonds", "cuda:half-bonds"])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args()
    model = pullout(options.particles)
    truth, step = run(model, "cpu", options.steps)
    print(f"pull-out, {len(model):,} particles, {options.steps} steps; cpu: {1e6 * step:.0f} us a step")
    good = True
    for engine in options.engines:
        state, step = run(model, engine, options.steps)
        again, _ = run(model, engine, options.steps)
        off = difference(state, truth)
        same = all(np.array_equal(state[name], again[name]) for name in state)
        good = good and same and max(off.values()) <= ALLOWED
        worst = ", ".join(f"{name} {value:.1e}" for name, value in off.items())
        print(f"{engine}: {1e6 * step:.1f} us a step; off by {worst}; {'the same' if same else 'OTHER'} bits again")
        if options.json:
            found = {"job": "pull-out equality", "particles": len(model), "steps": options.steps, "engine": engine}
            append(options.json, [{**circumstances(), **found, "off": off, "same_bits": same, "step_s": step}])
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
