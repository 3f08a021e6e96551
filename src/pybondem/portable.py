"""Logarithm, exponential, cosine and the normal distribution, with the same bits on every machine.

The last bits of np.log or np.cos depend on the processor and on the mathematical library. These functions are made of
+, -, *, /, square root, floor, frexp and ldexp, which IEEE 754 rounds in one way only; NumPy does each as an operation
of its own, never fused. Their coefficients are rounded from fractions of whole numbers. They take and return float64
arrays of any shape, element by element, and are right to about 1e-15 of the value.
"""

from collections.abc import Sequence
from fractions import Fraction
from math import factorial

import numpy as np

from pybondem.check import Floats

PI = Fraction(31415926535897932384626433832795028841972, 10**40)
LN2 = Fraction(6931471805599453094172321214581765680755, 10**40)
LN2_HIGH = float(Fraction(int(LN2 * 2**32), 2**32))  # 32 bits: its product with any binary exponent is exact
LN2_LOW = float(LN2 - Fraction(LN2_HIGH))
ROOT_HALF = 0.7071067811865476

# Taylor coefficients, lowest power first: of (log((1 + s) / (1 - s)) - 2 s) / s^3 and sin(2 pi s) / s in s^2, of exp(r)
# in r, of (normal distribution function - 1/2) / (normal density * z) in z^2.
LOG = [float(Fraction(2, 2 * k + 3)) for k in range(11)]
SINE = [float((2 * PI) ** (2 * k + 1) * Fraction((-1) ** k, factorial(2 * k + 1))) for k in range(13)]
EXP = [float(Fraction(1, factorial(k))) for k in range(15)]
CENTRE = [float(Fraction(2**k * factorial(k), factorial(2 * k + 1))) for k in range(18)]
CENTRE_END = 1.0  # where the series of the normal distribution function hands over to the continued fraction ...
TAIL_TERMS = 200  # ... which has converged to the last bit there with so many terms
ROOT_TWO_PI = 2.5066282746310002

# Wichura (1988), algorithm AS 241, PPND16: numerator and denominator, lowest power first, in 0.180625 - (p - 1/2)^2 for
# p within 0.425 of 1/2, else in r - 1.6 for r = sqrt(-log(min(p, 1 - p))) up to 5, else in r - 5.
MIDDLE = (
    [3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
     4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3],
    [1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
     2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3],
)  # fmt: skip
NEAR = (
    [1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
     1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4],
    [1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
     1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9],
)  # fmt: skip
FAR = (
    [6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
     2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7],
    [1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
     7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15],
)  # fmt: skip


def log(x: Floats) -> Floats:
    """Return the natural logarithm of x > 0."""
    m, e = np.frexp(x)
    low = m < ROOT_HALF
    f = np.where(low, m + m, m) - 1.0
    e = (e - low).astype(np.float64)
    s = f / (2.0 + f)  # log(1 + f) = log((1 + s) / (1 - s)), and 2 s = f - s f
    return e * LN2_HIGH + (f - s * (f - s * s * _polynomial(LOG, s * s)) + e * LN2_LOW)


def exp(x: Floats) -> Floats:
    """Return e^x for finite x: 0 where it is too small for a double, infinite where it is too large."""
    x = np.clip(x, -800.0, 800.0)
    k = np.floor(x * (1.0 / float(LN2)) + 0.5)
    with np.errstate(over="ignore", under="ignore"):
        return np.ldexp(_polynomial(EXP, (x - k * LN2_HIGH) - k * LN2_LOW), k.astype(np.int32))


def cosine_of_turns(t: Floats) -> Floats:
    """Return cos(2 pi t) for t up to 2^50 or so."""
    s = 0.25 - np.abs(t - np.floor(t + 0.5))  # cos(2 pi t) = sin(2 pi s), s in [-1/4, 1/4]
    return s * _polynomial(SINE, s * s)


def normal_distribution(z: Floats) -> Floats:
    """Return the probability that a standard normal number is below z.

    A series about 0 (Marsaglia, Journal of Statistical Software 11 (4), 2004, page 5), and further out the continued
    fraction of Laplace, 1 / (z + 1 / (z + 2 / (z + 3 / ...))), of the ratio of tail to density.
    """
    size = np.abs(z)
    coarse = np.floor(16.0 * size) / 16.0  # its square is exact, where the square of z would lose digits
    density = exp(-0.5 * coarse * coarse) * exp(-0.5 * (size - coarse) * (size + coarse)) / ROOT_TWO_PI
    inner = np.minimum(size, CENTRE_END)
    centre = density * inner * _polynomial(CENTRE, inner * inner)
    outer = np.maximum(size, CENTRE_END)
    fraction = 0.5 * (outer + np.sqrt(outer * outer + (4 * TAIL_TERMS + 2)))  # about what all further terms make
    for k in range(TAIL_TERMS, 0, -1):
        fraction = outer + k / fraction
    below = np.where(size < CENTRE_END, 0.5 - centre, density / fraction)  # the probability below -|z|
    return np.where(z < 0.0, below, 1.0 - below)


def normal_quantile(p: Floats) -> Floats:
    """Return the standard normal number that another is below with probability p, 0 < p < 1.

    Wichura, algorithm AS 241, Applied Statistics 37, 477-484 (1988).
    """
    q = p - 0.5
    r = np.sqrt(-log(np.minimum(p, 1.0 - p)))
    tail = np.where(r <= 5.0, _ratio(NEAR, r - 1.6), _ratio(FAR, r - 5.0))
    return np.where(np.abs(q) <= 0.425, q * _ratio(MIDDLE, 0.180625 - q * q), np.where(q < 0.0, -tail, tail))


def _polynomial(coefficients: Sequence[float], x: Floats) -> Floats:
    value = np.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        value *= x
        value += c
    return value


def _ratio(fraction: tuple[list[float], list[float]], x: Floats) -> Floats:
    return _polynomial(fraction[0], x) / _polynomial(fraction[1], x)
