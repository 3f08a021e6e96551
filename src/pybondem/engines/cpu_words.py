"""exp, log and power for the cpu engine, of nothing but arithmetic and bits, so that loops which call them vectorise.

Calls of the C library would hold a loop to one bond at a time. Right to about one unit in the last place: reduction by
powers of two (Cody & Waite, Software Manual for the Elementary Functions, 1980) and a series, whose terms are paired
(Estrin's way): in a long loop body it is the longest chain of operations that counts.
"""

from typing import Any

import numpy as np

from pybondem.ops import maximum, minimum

LOG2_E = 1.4426950408889634
LN2_HIGH, LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10  # the first has 20 bits to spare
SHIFTER = 6755399441055744.0  # 1.5 * 2^52: what is added to it ends up as a whole number in the lowest bits
ONE = np.int64(0x3FF0000000000000)
MANTISSA = np.int64(0x000FFFFFFFFFFFFF)
BIAS, FRACTION_BITS = np.int64(1023), np.int64(52)
TINY = 2.2250738585072014e-308
SMALLEST, LARGEST = -708.0, 709.4  # of the arguments whose exponential is made of a power of two that is normal
E2, E3, E4, E5, E6, E7 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040
E8, E9, E10, E11, E12, E13 = 1 / 40320, 1 / 362880, 1 / 3628800, 1 / 39916800, 1 / 479001600, 1 / 6227020800
L1, L2, L3, L4, L5 = 1 / 3, 1 / 5, 1 / 7, 1 / 9, 1 / 11
L6, L7, L8, L9, L10 = 1 / 13, 1 / 15, 1 / 17, 1 / 19, 1 / 21


def exp(x: Any) -> Any:
    """Return e^x; 0 below 3e-308, inf above 1.2e308."""
    shifted = x * LOG2_E + SHIFTER
    n = shifted - SHIFTER
    r = (x - n * LN2_HIGH) - n * LN2_LOW
    r2, r4 = r * r, (r * r) * (r * r)
    first = (1.0 + r) + r2 * (E2 + r * E3) + r4 * ((E4 + r * E5) + r2 * (E6 + r * E7))
    last = (E8 + r * E9) + r2 * (E10 + r * E11) + r4 * (E12 + r * E13)
    series = first + (r4 * r4) * last
    power = np.int64((np.float64(shifted).view(np.int64) << FRACTION_BITS) + ONE).view(np.float64)
    value = series * power
    value = 0.0 if x < SMALLEST else value
    return np.inf if x > LARGEST else value


def log(x: Any) -> Any:
    """Return the natural logarithm of x; -inf below the smallest normal number, nan below 0."""
    bits = np.float64(x).view(np.int64)
    m = np.int64((bits & MANTISSA) | ONE).view(np.float64)
    shifter = np.float64(SHIFTER)
    n = np.int64(shifter.view(np.int64) + (bits >> FRACTION_BITS) - BIAS).view(np.float64) - SHIFTER
    large = m > 1.4142135623730951
    m = 0.5 * m if large else m
    n = n + 1.0 if large else n
    f = (m - 1.0) / (m + 1.0)
    z = f * f
    z2, z4 = z * z, (z * z) * (z * z)
    first = (L1 + z * L2) + z2 * (L3 + z * L4) + z4 * ((L5 + z * L6) + z2 * (L7 + z * L8))
    series = first + (z4 * z4) * (L9 + z * L10)
    value: Any = n * LN2_HIGH + (2.0 * f + (2.0 * f * z * series + n * LN2_LOW))
    value = value if x < np.inf else x
    value = value if x > 0.0 else np.nan
    return -np.inf if 0.0 <= x < TINY else value


def power(a: Any, b: Any) -> Any:
    """Return a^b for a >= 0, to |b log a| units in the last place."""
    value = exp(b * log(a))
    return 1.0 if b == 0.0 else value


def clip(a: Any, low: Any, high: Any) -> Any:
    """Return a kept between two limits."""
    return minimum(maximum(a, low), high)


def largest(a: Any, b: Any, c: Any = -np.inf, d: Any = -np.inf) -> Any:
    """Return the largest of two to four numbers, nan where one is: what `max` of Python means in a law."""
    return maximum(maximum(a, b), maximum(c, d))


def smallest(a: Any, b: Any, c: Any = np.inf, d: Any = np.inf) -> Any:
    """Return the smallest of two to four numbers, nan where one is: what `min` of Python means in a law."""
    return minimum(minimum(a, b), minimum(c, d))
