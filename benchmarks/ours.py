"""PyBONDEM as a contender: the job built and stepped in a process of its own; see `contender`."""

from time import perf_counter
from typing import Any

import cylinder
import memory
from contender import SAMPLE, Floats, serve

import pybondem as bd

WARM_UP = 100  # particles of the model that brings imports and compiled code into memory first


class Ours:
    """The job on one engine. threads None: the engine's own choice."""

    def __init__(self, particles: int, engine: str, threads: int | None) -> None:
        self._engine, self._threads = engine, threads
        self._simulation(cylinder.model(cylinder.packing(WARM_UP))).run(steps=2, quiet=True)
        self._before = memory.resident()
        began = perf_counter()
        grains = cylinder.packing(particles)
        packed = perf_counter()
        rod = cylinder.model(grains)
        bonded = perf_counter()
        self._sim = self._simulation(rod)
        ready = perf_counter()
        self.facts: dict[str, Any] = {
            "particles": len(rod),
            "bonds": self._sim.bond_count,
            "build_s": ready - began,
            "build": {"packing_s": packed - began, "bonds_s": bonded - packed, "simulation_s": ready - bonded},
            "dt": self._sim.dt,
            "critical_dt": self._sim.limit.dt,
        }

    def _simulation(self, rod: bd.Model) -> bd.Simulation:
        return bd.Simulation(rod, engine=self._engine, threads=self._threads, dt=cylinder.DT)

    def advance(self, steps: int) -> None:
        """Run so many steps."""
        self._sim.run(steps=steps, quiet=True)

    def velocities(self) -> Floats:
        """Return the velocities of a sample of the particles [m/s]."""
        v: Floats = self._sim.particles.v
        return v[:: max(1, len(v) // SAMPLE)]

    def finish(self) -> dict[str, Any]:
        """Return the memory that the model takes, per particle [bytes]."""
        n = self.facts["particles"]
        highest, now = memory.peak(), memory.resident()
        found: dict[str, Any] = {"array_bytes_per_particle": memory.array_bytes(self._sim) / n}
        for name, size in (("bytes_per_particle", now), ("peak_bytes_per_particle", highest)):
            found[name] = None if size is None or self._before is None else (size - self._before) / n
        return found


if __name__ == "__main__":
    serve(Ours)
