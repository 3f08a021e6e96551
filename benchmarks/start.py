"""Print the seconds from `import pybondem` to the first step done: start.py ENGINE [LAW], in a process of its own."""

import sys
from time import perf_counter

began = perf_counter()

import cylinder  # noqa: E402
import user_law  # noqa: E402

import pybondem as bd  # noqa: E402

PARTICLES = 100  # start-up, not size, is what is looked at

law = user_law.built_in(sys.argv[2]) if len(sys.argv) > 2 else None
sim = bd.Simulation(cylinder.model(cylinder.packing(PARTICLES), law), engine=sys.argv[1], dt=cylinder.DT)
sim.run(steps=1, quiet=True)
print(perf_counter() - began)
