"""The words that physics may use.

A vector is a tuple of components; a component is a float (plain Python, Numba, CUDA) or an array (NumPy). The eight
words below that are not plain arithmetic are replaced by each engine's own versions (`engines/binding.py`); all
the others are built from them, so one text serves every engine.
"""

from math import exp, log, sqrt
from typing import Any

__all__ = [
    "Number", "Quaternion", "Vector",
    "absolute", "add", "cross", "dot", "exp", "log", "maximum", "minimum", "minus", "norm", "normal_to", "power",
    "quaternion_product", "rotate", "sqrt", "times", "where",
]  # fmt: skip

Number = Any  # a float, or an array of floats in the reference engine
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]  # scalar first


def where(condition: Any, a: Number, b: Number) -> Number:
    """Return a where the condition holds, else b."""
    return a if condition else b


def minimum(a: Number, b: Number) -> Number:
    """Return the smaller of two numbers, nan where one is."""
    smaller = b if b <= a else a + b
    return a if a < b else smaller


def maximum(a: Number, b: Number) -> Number:
    """Return the larger of two numbers, nan where one is."""
    larger = b if b >= a else a + b
    return a if a > b else larger


def absolute(a: Number) -> Number:
    """Return |a|."""
    return a if a >= 0.0 else -a


def power(a: Number, b: Number) -> Number:
    """Return a^b, a >= 0: faster in compiled loops than a**b, unless b is a whole number."""
    return a**b


def add(a: Vector, b: Vector) -> Vector:
    """Return the vector a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Return the vector a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(factor: Number, a: Vector) -> Vector:
    """Return the vector factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> Number:
    """Return the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def norm(a: Vector) -> Number:
    """Return |a|."""
    return sqrt(dot(a, a))


def normal_to(n: Vector, a: Vector) -> Vector:
    """Return the part of a that is normal to the unit vector n."""
    return minus(a, times(dot(a, n), n))


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return p q, each as (scalar, x, y, z)."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    )


def rotate(scalar: Number, vector: Vector, inverse: Number, a: Vector) -> Vector:
    """Turn a by the quaternion (scalar, vector) of any length, with inverse = 2 / length^2."""
    first = cross(vector, a)
    return add(a, times(inverse, add(times(scalar, first), cross(vector, first))))
