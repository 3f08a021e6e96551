"""The circular cross-section of a bond."""

from pybondem.ops import Number

PI = 3.141592653589793


def area(radius: Number) -> Number:
    """Return A = pi r^2 [m2]."""
    return PI * radius * radius


def second_moment(radius: Number) -> Number:
    """Return I = pi r^4 / 4 [m4]."""
    return 0.25 * PI * radius * radius * radius * radius


def bending_modulus(radius: Number) -> Number:
    """Return I/r = pi r^3 / 4 [m3]."""
    return 0.25 * PI * radius**3


def polar_moment(radius: Number) -> Number:
    """Return J = pi r^4 / 2 [m4]."""
    return 2.0 * second_moment(radius)
