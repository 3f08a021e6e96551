"""Print the seconds from `import pybondem` to the first step done: start.py ENGINE, in a process of its own."""

import sys
from time import perf_counter

began = perf_counter()

import cylinder  # noqa: E402

import pybondem as bd  # noqa: E402

PARTICLES = 100  # start-up, not size, is what is looked at

sim = bd.Simulation(cylinder.model(cylinder.packing(PARTICLES)), engine=sys.argv[1], dt=cylinder.DT)
sim.run(steps=1, quiet=True)
print(perf_counter() - began)
