"""The circular cross-section of a bond."""

PI = 3.141592653589793


def area(radius):
    """Return A = pi r^2 [m2]."""
    return PI * radius * radius


def second_moment(radius):
    """Return I = pi r^4 / 4 [m4]."""
    return 0.25 * PI * radius * radius * radius * radius


def polar_moment(radius):
    """Return J = pi r^4 / 2 [m4]."""
    return 2.0 * second_moment(radius)
