"""The cylinder job: a hexagonally packed cylinder, clamped at the bottom, pulled at the top; every bond answers in all
six components and has dashpots. The same model on every engine and for every peer, at any size, with any bond law.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

import pybondem as bd
from pybondem.bonds import ValuedLaw

DIAMETER = 1e-3  # of a particle [m]
DENSITY = 2500.0  # [kg/m3]
MODULUS = 1e9  # [Pa]: kn = E A / d with the section of the particle
RATIO = 2.0  # kn / ks; the parallel bond then has kb = kt = kn r^2 / 4
ZETA = 0.1  # damping ratio of the dashpots
SPEED = 0.1  # of the top [m/s]
DT = 1e-7  # [s]
IDLE = 1e-6  # share of the speed at which no law has anything to do
ACTIVE = 0.03  # strain that brings typical laws to soften at once
LAYER = sqrt(2.0 / 3.0) * DIAMETER
ENDS = 1.5 * LAYER  # reaches two layers

# Cylinder diameters, in particle diameters, of the sizes that figures are quoted for: 982, 9 981, 99 488 and 986 326
# particles with 4 944, 55 566, 576 723 and 5 823 204 bonds.
QUOTED = {1_000: 7.5, 10_000: 16.35, 100_000: 35.45, 1_000_000: 76.25}


class Springs(NamedTuple):
    """Springs [N/m, N m] and dashpots [N s/m, N m s] of a bond: normal, shear, twist, bending."""

    kn: float
    ks: float
    kt: float
    kb: float
    cn: float
    cs: float
    ct: float
    cb: float


def packing(particles: int) -> bd.packing.Particles:
    """Return about so many particles: a cylinder twice as high as wide, c axis along z, lowest layer at z = 0."""
    volume_per_particle = 1.0 / sqrt(2.0)  # of the close packing, in diameters cubed
    width = QUOTED.get(particles, (2.0 * particles * volume_per_particle / pi) ** (1.0 / 3.0)) * DIAMETER
    return bd.packing.hcp(DIAMETER, inside=bd.Cylinder(radius=0.5 * width, height=2.0 * width), axis="z")


def bond(law: ValuedLaw | None = None) -> bd.Bond:
    """Return the bond of the job, with dashpots: elastic and unbreakable, or with a law."""
    return bd.Bond(bd.parallel(E=MODULUS, stiffness_ratio=RATIO), law, damping=ZETA)


def model(grains: bd.packing.Particles, law: ValuedLaw | None = None, speed: float = SPEED) -> bd.Model:
    """Return the model: neighbours bonded, two layers fixed, two layers pulled, all six components prescribed."""
    rod = bd.Model(grains, density=DENSITY)
    rod.bond(rod.touching(), bond(law))
    top = float(rod.x[:, 2].max())
    rod.fix(rod.where(z=(None, ENDS)))
    rod.drive(rod.where(z=(top - ENDS, None)), vx=0.0, vy=0.0, vz=speed, wx=0.0, wy=0.0, wz=0.0)
    return rod


def springs() -> Springs:
    """Return the springs and dashpots that the job prescribes, from its definition and not from the package."""
    kn = MODULUS * pi / 4.0 * DIAMETER
    k = np.array([kn, 0.5 * kn, *2 * (kn * DIAMETER**2 / 16.0,)])
    mass = DENSITY * pi / 6.0 * DIAMETER**3
    body = np.array([mass, mass, *2 * (0.1 * mass * DIAMETER**2,)])
    return Springs(*k.tolist(), *(2.0 * ZETA * np.sqrt(0.5 * body * k)).tolist())
