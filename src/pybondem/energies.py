"""The energy book of a run."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pybondem.assembly import Assembly
from pybondem.model import Model

Floats = NDArray[np.float64]


class Running(Protocol):
    """What the energy book reads of a running simulation: gravity (3,) [m/s2], dt [s]."""

    model: Model
    state: Assembly
    gravity: tuple[float, float, float]
    dt: float

    def bond_energy(self) -> Floats:
        """Return the elastic energy of every bond (bonds,) [J]."""


class Energies(NamedTuple):
    """The energy book [J]. The sum of the first six less the work is constant: the residual is what is missing.

    kinetic: of free components, as m v- . v+ / 2 with the velocities half a step before and after: the kinetic energy
    whose balance with the trapezoid work of velocity Verlet is exact (it differs from m v^2 / 2 by dt^2 a^2 m / 8);
    strain: elastic energy of the bonds, damage frozen; gravity: potential of the weight, 0 at the start;
    damage: dissipated by damage and breakage; dashpots: by the dashpots in the bonds; drag: by local, global or kinetic
    damping; work: done on the model by drives and pushes; residual: kinetic + strain + gravity + damage + dashpots +
    drag - work, less its value at the start. It closes to round-off for small strains; dashpots, which act on the
    foreseen velocity, are booked to second order in the step.
    """

    kinetic: float
    strain: float
    gravity: float
    damage: float
    dashpots: float
    drag: float
    work: float
    residual: float


def energies(sim: Running, kinetic_taken: float) -> Energies:
    """Return the energy book now, its residual not yet referred to the start.

    kinetic_taken: energy taken by kinetic damping so far [J].
    """
    p = sim.state.particles
    bonds = sim.state.bonds.values()
    fallen = (p["x"] - p["start"]) * np.broadcast_to(p["mass"], len(sim.model))
    values = {
        "kinetic": leapfrog_kinetic(sim),
        "strain": float(sim.bond_energy().sum()),
        "gravity": -float(np.dot(sim.gravity, fallen.sum(axis=1))),
        "damage": sum(b.total("lost") for b in bonds if "lost" in b),
        "dashpots": sum(b.total("damped") for b in bonds if "damped" in b),
        "drag": (p.total("dragged") if "dragged" in p else 0.0) + kinetic_taken,
        "work": p.total("work"),
    }
    return Energies(**values, residual=sum(values.values()) - 2.0 * values["work"])


def leapfrog_kinetic(sim: Running) -> float:
    """Return the kinetic energy of free components, m v- . v+ / 2 [J]."""
    p, tables = sim.state.particles, sim.state.tables
    total = 0.0
    for v, force, drag, mass, hold in (
        ("v", "force", "drag", p["mass"], tables.hold),
        ("w", "torque", "drag_torque", p["inertia"], tables.turn_hold),
    ):
        force_now = p[force] + p[drag] if drag in p else p[force]
        half_kick = 0.5 * sim.dt / mass * force_now
        free = 1.0 - hold[:, p["group"]]
        total += 0.5 * float((free * mass * (p[v] ** 2 - half_kick**2)).sum())
    return total
