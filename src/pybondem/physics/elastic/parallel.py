"""The parallel bond: a disc of glue of radius Rb between two particles.

Potyondy & Cundall, Int. J. Rock Mech. Min. Sci. 41 (2004), section 2.2, with springs per area kbar_n = E/L and
kbar_s = kbar_n / ratio:  kn = kbar_n A, ks = kbar_s A, kt = kbar_s J, kb = kbar_n I.
"""

from pybondem.ops import Number
from pybondem.physics.elastic.section import area, polar_moment, second_moment
from pybondem.physics.types import Stiffness


def parallel_stiffness(E: Number, ratio: Number, radius: Number, length: Number) -> Stiffness:
    """Return the stiffness of a parallel bond: modulus E [Pa], normal-to-shear ratio, radius and length [m]."""
    normal, shear = E / length, E / length / ratio
    return Stiffness(
        normal * area(radius), shear * area(radius), shear * polar_moment(radius), normal * second_moment(radius)
    )
