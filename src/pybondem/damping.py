"""Damping of particles. (Dashpots in the bonds are a value of the bond: `Bond(..., damping=0.1)`.)"""

from dataclasses import dataclass

from pybondem.assembly import Drag
from pybondem.check import fraction, nonnegative, whole_number
from pybondem.physics.motion import global_drag, local_drag


@dataclass(frozen=True)
class Kinetic:
    """Kinetic damping: all velocities are zeroed whenever the kinetic energy passes a peak, looked at every k steps."""

    every: int = 10


def local(alpha: float) -> Drag:
    """Return local damping -alpha |F| sign(v) on each free component (Cundall 1987), for quasi-static work.

    alpha: 0 to below 1 [-]. It is not objective: a model in steady flight is damped where forces act on it.
    """
    return Drag(local_drag, fraction("alpha of local damping", alpha, 0.0, 0.999))


def viscous(rate: float) -> Drag:
    """Return global viscous damping -rate m v, -rate I w on each free component; rate [1/s] from 0 up."""
    return Drag(global_drag, nonnegative("rate of viscous damping", rate, "1/s"))


def kinetic(every: int = 10) -> Kinetic:
    """Return kinetic damping (dynamic relaxation; Cundall 1976): velocities zeroed at each peak of kinetic energy.

    every: steps between two looks, from 1 up; raises InputError otherwise.
    """
    return Kinetic(whole_number("every of kinetic damping", every))
