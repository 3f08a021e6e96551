"""The cylinder of figure 1, ready to be stepped on an engine: the job of the benchmarks, so that results compare.

The paper (section 3.1): a cylinder of hexagonally packed, bonded spheres, one end fixed, the other moved at constant
speed; more particles by a larger cylinder.
"""

from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem.assembly import assemble, step_program
from pybondem.bonds import Bond, parallel
from pybondem.engines.base import Engine
from pybondem.model import Model
from pybondem.packing import hcp
from pybondem.packing.shapes import Cylinder

Floats = NDArray[np.float64]

DIAMETER, DENSITY, MODULUS = 1e-3, 2500.0, 1e9  # of a particle [m], [kg/m3]; kn = E A / d [Pa]
STIFFNESS_RATIO, DAMPING = 2.0, 0.1  # kn / ks; damping ratio of the dashpots
SPEED = 0.1  # of the moved end [m/s]
DT = 1e-7  # [s], 0.4 of the critical step, which does not depend on the size of the cylinder
ENDS = 1.5 * sqrt(2.0 / 3.0) * DIAMETER  # reaches two layers [m]
# Diameters of cylinders, in particle diameters, that bring the number of particles close to what is asked for.
WIDTHS = {1_000: 7.5, 10_000: 16.35, 100_000: 35.45, 1_000_000: 76.25}
SHAKEN, SPUN = 10.0, 1e4  # standard deviations of the first velocities and spins [m/s], [rad/s]


def cylinder(particles: int) -> Model:
    """Return the model with about so many particles: twice as high as wide, elastic bonds that resist all six motions.

    Two layers at the bottom are fixed, two at the top are moved, all six components prescribed.
    """
    width = DIAMETER * WIDTHS.get(particles, (2.0 * particles / (pi * sqrt(2.0))) ** (1.0 / 3.0))
    model = Model(hcp(DIAMETER, inside=Cylinder(radius=0.5 * width, height=2.0 * width)), density=DENSITY)
    model.bond(model.touching(), Bond(parallel(E=MODULUS, stiffness_ratio=STIFFNESS_RATIO), damping=DAMPING))
    top = float(model.x[:, 2].max())
    model.fix(model.where(z=(None, ENDS)))
    model.drive(model.where(z=(top - ENDS, None)), vx=0.0, vy=0.0, vz=SPEED, wx=0.0, wy=0.0, wz=0.0)
    return model


class Stepper:
    """A model on an engine, with nothing around the steps: forces, integration and the motion of the ends.

    The model is what a `Simulation` steps, but its critical time step is not looked for, which takes longer than
    everything else where there are millions of particles. Every particle starts with a random velocity and spin, the
    same on every engine, so that every bond outside the held ends carries all six loads. records: whether particles
    and bonds are records of NumPy structured arrays, as in the paper; the engine then works on views of their fields.
    """

    def __init__(self, model: Model, engine: Engine, records: bool = False) -> None:
        self._state = assemble(model)
        if records:
            into_records(self._state.particles, len(model))
            for block in self._state.blocks:
                into_records(self._state.bonds[block.name], block.count)
        shake(self._state.particles["v"], self._state.particles["w"], self._state.position)
        self._runner = engine.prepare(step_program(self._state, (0.0, 0.0, 0.0), None))
        self._step = 0
        still = self._state.tables.schedule(0, 0, DT)  # a step of no length: it compiles, and evaluates the first loads
        self._runner.advance(1, 0.0, {name: np.concatenate([row, row]) for name, row in still.items()})

    def advance(self, steps: int) -> None:
        """Run so many steps, and return when the last one is done."""
        self._runner.advance(steps, DT, self._state.tables.schedule(self._step, steps, DT))
        self._step += steps

    @property
    def loads(self) -> tuple[Floats, Floats]:
        """Forces [N] and torques [N m] on the particles now, (n, 3) each, in the model's order."""
        fields, place = self._state.particles, self._state.position
        return fields["force"].T[place], fields["torque"].T[place]

    @property
    def array_bytes(self) -> int:
        """Size of the arrays that are stepped on [bytes]."""
        held = (self._state.particles, self._state.shared, *self._state.bonds.values())
        return sum(a.nbytes for group in held for a in group.values() if isinstance(a, np.ndarray))


def shake(v: Floats, w: Floats, place: NDArray[Any]) -> None:
    """Set velocities and spins (3, n), kept in another order, to random ones; place (n,): where each particle is."""
    random = np.random.default_rng(2021)
    for field, size in ((v, SHAKEN), (w, SPUN)):
        field[:, place] = random.normal(scale=size, size=field.shape)


def into_records(fields: dict[str, Any], n: int) -> None:
    """Move the arrays of n items, (n,) or (components, n), into one structured array, and put views in their places."""
    arrays = {name: a for name, a in fields.items() if isinstance(a, np.ndarray) and a.shape[-1] == n}
    table = np.zeros(n, np.dtype([(name, a.dtype, a.shape[:-1]) for name, a in arrays.items()]))
    for name, a in arrays.items():
        table[name] = a.T
        fields[name] = table[name].T
