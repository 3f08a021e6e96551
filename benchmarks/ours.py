"""PyBONDEM as a contender: the job built and stepped in a process of its own; see `contender`."""

from time import perf_counter
from typing import Any
from unittest import mock

import cylinder
import memory
import user_law
from contender import SAMPLE, Floats, serve

import pybondem as bd
from pybondem import simulation
from pybondem.engines.cuda_device import usable

LARGE, SAMPLED = 200_000, 10_000  # a larger model has its critical step from one of so many particles
WARM_UP = 100  # particles of the model that brings imports and compiled code into memory first


class Ours:
    """The job on one engine.

    threads None: the engine's own choice; law: None for elastic bonds, or the name of a law; users: its twin in
    `user_law`; active None: the job as it is; else pulled so slowly that no law has anything to do, and True: stretched
    at first so far that laws soften.
    """

    def __init__(self, particles: int, engine: str, threads: int | None, law: str | None = None, users: bool = False,
                 active: bool | None = None) -> None:  # fmt: skip
        self._engine, self._threads = engine, threads
        self._law = None if law is None else user_law.users(law) if users else user_law.built_in(law)
        self._speed = cylinder.SPEED if active is None else cylinder.IDLE * cylinder.SPEED
        self._simulation(self._model(cylinder.packing(WARM_UP))).run(steps=2, quiet=True)
        self._before = memory.resident()
        began = perf_counter()
        grains = cylinder.packing(particles)
        packed = perf_counter()
        rod = self._model(grains)
        bonded = perf_counter()
        self._sim = self._simulation(rod)
        ready = perf_counter()
        if active:
            self._stretch()
        self.facts: dict[str, Any] = {
            "particles": len(rod),
            "bonds": self._sim.bond_count,
            "build_s": ready - began,
            "build": {"packing_s": packed - began, "bonds_s": bonded - packed, "simulation_s": ready - bonded},
            "dt": self._sim.dt,
            "critical_dt": self._sim.limit.dt,
        }
        if engine.startswith("cuda"):
            self.facts["gpu"] = usable().name

    def _model(self, grains: bd.packing.Particles) -> bd.Model:
        return cylinder.model(grains, self._law, self._speed)

    def _stretch(self) -> None:
        with self._sim.edit("x") as x:
            x[:, 2] *= 1.0 + cylinder.ACTIVE

    def _simulation(self, rod: bd.Model) -> bd.Simulation:
        """Return the simulation; the critical step of a large model, which takes long to find, is a smaller one's."""
        options: dict[str, Any] = {"engine": self._engine, "threads": self._threads, "dt": cylinder.DT}
        if len(rod) <= LARGE:
            return bd.Simulation(rod, **options)
        limit = bd.Simulation(self._model(cylinder.packing(SAMPLED)), **options).limit
        with mock.patch.object(simulation, "stability_limit", return_value=limit):
            return bd.Simulation(rod, **options)

    def advance(self, steps: int) -> None:
        """Run so many steps."""
        self._sim.run(steps=steps, quiet=True)

    def velocities(self) -> Floats:
        """Return the velocities of a sample of the particles [m/s]."""
        v: Floats = self._sim.particles.v
        return v[:: max(1, len(v) // SAMPLE)]

    def finish(self) -> dict[str, Any]:
        """Return the memory that the model takes, per particle [bytes], and the share of bonds with damage."""
        n = self.facts["particles"]
        highest, now = memory.peak(), memory.resident()
        found: dict[str, Any] = {"array_bytes_per_particle": memory.array_bytes(self._sim) / n}
        if self._law is not None:
            damage = self._sim.bonds(self._sim.model.bonds[0]).damage
            found["damaged"] = float((damage > 0.0).mean())
        for name, size in (("bytes_per_particle", now), ("peak_bytes_per_particle", highest)):
            found[name] = None if size is None or self._before is None else (size - self._before) / n
        return found


if __name__ == "__main__":
    serve(Ours)
