"""Beams between the centres of two particles.

Timoshenko (Brown, Chen & Ooi, Granular Matter 16, 2014): kn = E A/L, ks = 12 E I / (L^3 (1 + phi)), kt = G J/L,
kb = E I/L with phi = 12 E I / (G A k L^2). Euler-Bernoulli (Andre et al., Comput. Methods Appl. Mech. Eng. 213, 2012):
the same with phi = 0.
"""

from pybondem.ops import Number
from pybondem.physics.elastic.section import area, polar_moment, second_moment
from pybondem.physics.types import Stiffness


def beam_stiffness(E: Number, G: Number, phi: Number, radius: Number, length: Number) -> Stiffness:
    """Return the stiffness of a beam of moduli E, G [Pa], shear parameter phi [-], radius and length [m]."""
    EI = E * second_moment(radius)
    return Stiffness(
        E * area(radius) / length,
        12.0 * EI / (length * length * length * (1.0 + phi)),
        G * polar_moment(radius) / length,
        EI / length,
    )


def timoshenko_stiffness(E: Number, G: Number, shear_factor: Number, radius: Number, length: Number) -> Stiffness:
    """Return the stiffness of a Timoshenko beam: E, G [Pa], shear correction factor k [-], radius and length [m]."""
    phi = 12.0 * E * second_moment(radius) / (G * area(radius) * shear_factor * length * length)
    return beam_stiffness(E, G, phi, radius, length)


def euler_bernoulli_stiffness(E: Number, G: Number, radius: Number, length: Number) -> Stiffness:
    """Return the stiffness of an Euler-Bernoulli beam: E, G [Pa], radius and length [m]."""
    return beam_stiffness(E, G, 0.0, radius, length)
