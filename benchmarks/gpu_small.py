"""A small model with all that a step on the GPU may have, for a tool that looks at every access to memory.

python benchmarks/gpu_small.py cuda:half-bonds     five steps in launches of three and two, compared with the engine
                                                   reference; exits with 1 where they differ by more than 1e-9

A hub with more bonds than a block has threads, so that its ends are in two blocks or more; a chain beside it; a set of
bonds under a damage law and one under a bond law; numbers of particles and bonds that leave the last block ragged.
"""

import argparse
import sys
from math import pi, sqrt

import numpy as np
from gpu_equality import ALLOWED, LOOKED_AT, State, difference

import pybondem as bd
from pybondem.engines.cuda_text import THREADS

DIAMETER, DENSITY, DT = 1e-3, 2500.0, 1e-8  # [m], [kg/m3], [s]
AROUND, CHAIN = 150, 40  # particles on the hub, and in the chain
LAUNCHES = (3, 2)  # steps
SOFTENING = bd.bilinear(slip_peak=1e-9, slip_end=1e-6)  # as soon as anything moves
SLIPPING = bd.laws.plastic_slip(yield_stress=1e3, hardening=1e11)  # likewise


def model() -> bd.Model:
    """Return the model: a hub and what is bonded to it, a chain whose first particle is held, with dashpots."""
    k = np.arange(AROUND) + 0.5
    up, turn = 1.0 - 2.0 * k / AROUND, pi * (1.0 + sqrt(5.0)) * k  # evenly over a sphere
    across = np.sqrt(1.0 - up**2)
    hub = 7.0 * DIAMETER
    around = (hub + 0.5 * DIAMETER) * np.column_stack([across * np.cos(turn), across * np.sin(turn), up])
    chain = np.column_stack([np.full(CHAIN, 3.0 * hub), DIAMETER * np.arange(CHAIN), np.zeros(CHAIN)])
    x = np.concatenate([np.zeros((1, 3)), around, chain])
    made = bd.Model(bd.packing.Particles(x, np.array([hub, *[0.5 * DIAMETER] * (len(x) - 1)])), density=DENSITY)
    parallel = bd.parallel(E=1e9, stiffness_ratio=2.0)
    first = 1 + AROUND
    on_hub = [(0, 1 + k) for k in range(AROUND)]
    in_chain = [(k, k + 1) for k in range(first, first + CHAIN - 1)]
    made.bond(on_hub, bd.Bond(parallel, SOFTENING, damping=0.1))
    made.bond(in_chain, bd.Bond(parallel, SLIPPING, damping=0.1))
    made.fix(made.select([first]))
    made.drive(made.select([first + CHAIN - 1]), vy=1.0)
    made.push(made.select([5]), fz=1.0)
    return made


def run(engine: str) -> State:
    """Return the state after the launches, from random velocities and spins."""
    made, rng = model(), np.random.default_rng(7)
    sim = bd.Simulation(made, engine=engine, dt=DT, damping=bd.local(0.2), gravity=(0.0, 0.0, -9.81))
    with sim.edit("v", "w") as (v, w):
        v[:], w[:] = rng.normal(size=v.shape), rng.normal(scale=1e3, size=w.shape)
    for steps in LAUNCHES:
        sim.run(steps=steps, quiet=True)
    p = sim.particles
    return {"displacement": p.x - made.x, **{name: getattr(p, name) for name in LOOKED_AT[1:]}}


def main() -> None:
    """Compare an engine with the reference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("engine", nargs="?", default="cuda")
    engine = parser.parse_args().engine
    off = difference(run(engine), run("reference"))
    said = ", ".join(f"{name} {value:.1e}" for name, value in off.items())
    print(f"{engine}, blocks of {THREADS} threads, launches of {LAUNCHES} steps: off by {said}")
    sys.exit(0 if max(off.values()) <= ALLOWED else 1)  # NaN is none of these


if __name__ == "__main__":
    main()
