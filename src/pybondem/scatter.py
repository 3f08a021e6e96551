"""Values that differ from bond to bond: strengths and the like drawn from a distribution.

    bd.strength(tension=bd.scatter.weibull(scale=5e6, modulus=8.0, seed=1), shear=10e6)
    bd.strength(tension=bd.scatter.normal(mean=5e6, deviation=1e6, low=1e6, seed=1, length=2e-3), shear=10e6)

**Independent values** (no `length`): every bond has its own, by its row: row k is the same in a set of any size.

**Correlated values** (with `length` [m]): a field in space, so that the value belongs to the place, whichever other
places are asked. A standard normal field g is mapped to the distribution by u = Phi(g) (a Gaussian copula): the values
are distributed as the independent ones are, and g has the covariance exp(-r^2 / (2 length^2)) at distance r. g is the
sum of 1000 cosine waves of equal amplitude, their wave vectors drawn from the spectrum of that covariance and their
phases at random (Shinozuka & Deodatis, Applied Mechanics Reviews 44, 191-204, 1991; with random wave vectors Rahimi &
Recht, Advances in Neural Information Processing Systems 20, 2007). Over many seeds mean, variance and covariance of g
are exact and its excess kurtosis is -0.0015; in one field the correlation at a given lag is off by some 0.02.

**Seeds.** A seed gives the same bits on every machine. Quantities with the same seed rise and fall together; give each
a seed of its own to make them independent.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from pybondem.check import Floats, finite_array, finite_number, positive, whole_number
from pybondem.errors import InputError
from pybondem.portable import cosine_of_turns, exp, log, normal_distribution, normal_quantile

MODES = 1000
CHUNK = 16384  # places at a time: the arrays stay in the cache
FARTHEST = 1e9  # correlation lengths from the origin: beyond, round-off of the place shows in the field
TWO_PI = 6.283185307179586
ENDS = np.array([1.0, 2**53 - 1]) / 2**53  # no probability is drawn outside
NEXT_TO_NOTHING = 1e-290  # of a distribution: less is lost to underflow


class Distribution(Protocol):
    """A distribution, by its inverse."""

    def quantile(self, u: Floats) -> Floats:
        """Return the values that a share u of all values stays below, 0 < u < 1."""


@dataclass(frozen=True)
class Scatter:
    """Values drawn from a distribution, one per bond: made by `weibull`, `normal` or `uniform`.

    seed: a whole number from 0; length: correlation length [m], None for independent values.
    """

    distribution: Distribution
    seed: int
    length: float | None = None

    def values(self, x: ArrayLike) -> Floats:
        """Return one value for each place x (m, 3) [m], (m,), in the unit of the distribution.

        x: the mid-points of the bonds, row k for bond k; independent values do not depend on them. Raises InputError
        unless x is finite (m, 3), and for places more than 1e9 correlation lengths from the origin.
        """
        x = finite_array("x of scatter", x, (None, 3))
        if self.length is None:
            return self.distribution.quantile(_uniform(self.seed, len(x)))
        with np.errstate(over="ignore"):
            x = x / self.length
        far = np.abs(x).max(axis=1, initial=0.0) > FARTHEST
        if np.any(far):
            raise InputError(
                f"x[{int(np.argmax(far))}] of scatter lies more than {FARTHEST:g} correlation lengths from the origin; "
                f"check that length, {self.length:g}, is in metres."
            )
        return self.distribution.quantile(_correlated(self.seed, x))


@dataclass(frozen=True)
class Weibull:
    """P(value < v) = 1 - exp(-((v - low) / scale)^modulus) for v > low."""

    scale: float
    modulus: float
    low: float

    def quantile(self, u: Floats) -> Floats:
        """Return the values that a share u of all values stays below."""
        return self.low + self.scale * exp(log(-log(1.0 - u)) / self.modulus)


@dataclass(frozen=True)
class Normal:
    """A normal distribution, cut off (and scaled up in between) below low and above high, which may be infinite."""

    mean: float
    deviation: float
    low: float
    high: float

    def quantile(self, u: Floats) -> Floats:
        """Return the values that a share u of all values stays below."""
        below, between, above = self.shares()
        p, q = below + u * between, above + (1.0 - u) * between
        z = normal_quantile(np.minimum(p, q))  # the smaller of both has all its digits
        return np.clip(self.mean + self.deviation * np.where(p < q, z, -z), self.low, self.high)

    def shares(self) -> tuple[float, float, float]:
        """Return which shares of the distribution before it is cut off lie below low, in between and above high."""
        low, high = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        ends = np.clip([low, -low, high, -high], -40.0, 40.0)  # beyond, a probability is 0 or 1
        below_low, above_low, below_high, above_high = normal_distribution(ends).tolist()
        between = above_low - above_high if low > 0.0 else below_high - below_low
        return below_low, between, above_high


@dataclass(frozen=True)
class Uniform:
    """All values between low and high are equally likely."""

    low: float
    high: float

    def quantile(self, u: Floats) -> Floats:
        """Return the values that a share u of all values stays below."""
        return np.clip(self.low * (1.0 - u) + self.high * u, self.low, self.high)


def weibull(scale: float, modulus: float, seed: int, low: float = 0.0, length: float | None = None) -> Scatter:
    """Return values with the distribution 1 - exp(-((v - low) / scale)^modulus) of Weibull (1951).

    Journal of Applied Mechanics 18, 293-297. low: threshold that no value falls below; scale: 63.2 % of the values are
    smaller than low + scale, both in the unit of the value; modulus: the larger, the less scatter (with low = 0 the
    coefficient of variation is about 1.2 / modulus). seed: a whole number from 0; length: correlation length [m].
    Raises InputError unless scale, modulus and length are positive and all values fit a double.
    """
    scale, modulus = positive("scale of weibull", scale), positive("modulus of weibull", modulus)
    return _scatter("weibull", Weibull(scale, modulus, finite_number("low of weibull", low)), seed, length)


def normal(
    mean: float,
    deviation: float,
    seed: int,
    low: float | None = None,
    high: float | None = None,
    length: float | None = None,
) -> Scatter:
    """Return normally distributed values, within low and high where given (a truncated normal distribution).

    mean, deviation: of the distribution before it is cut off, in the unit of the value; without `low` some values may
    be negative. seed: a whole number from 0; length: correlation length [m]. Raises InputError unless deviation and
    length are positive, low < high, some of the distribution lies in between, and all values fit a double.
    """
    mean, deviation = finite_number("mean of normal", mean), positive("deviation of normal", deviation)
    low = -np.inf if low is None else finite_number("low of normal", low)
    high = np.inf if high is None else finite_number("high of normal", high)
    if low >= high:
        raise InputError(f"low of normal is {low!r}; it must be below high, {high!r}.")
    distribution = Normal(mean, deviation, low, high)
    if distribution.shares()[1] < NEXT_TO_NOTHING:
        raise InputError(
            f"low and high of normal are {low!r} and {high!r}; next to nothing of a normal distribution with mean "
            f"{mean!r} and deviation {deviation!r} lies in between."
        )
    return _scatter("normal", distribution, seed, length)


def uniform(low: float, high: float, seed: int, length: float | None = None) -> Scatter:
    """Return values that lie between low and high with equal probability.

    low, high: in the unit of the value; seed: a whole number from 0; length: correlation length [m]. Raises InputError
    unless low < high and length is positive.
    """
    low, high = finite_number("low of uniform", low), finite_number("high of uniform", high)
    if low >= high:
        raise InputError(f"low of uniform is {low!r}; it must be below high, {high!r}.")
    return _scatter("uniform", Uniform(low, high), seed, length)


def _scatter(name: str, distribution: Distribution, seed: int, length: float | None) -> Scatter:
    seed = whole_number(f"seed of {name}", seed, 0)
    length = None if length is None else positive(f"length of {name}", length, "m")
    with np.errstate(over="ignore"):
        largest = np.abs(distribution.quantile(ENDS)).max()
    if not np.isfinite(largest):
        raise InputError(f"{name} has values too large for a double, being {distribution}; give it less scatter.")
    return Scatter(distribution, seed, length)


def _uniform(seed: int, count: int) -> Floats:
    """Return numbers (count,) between 0 and 1, all equally likely: the middles of 2^52 equal steps."""
    raw = np.random.PCG64(seed).random_raw(count)
    return ((raw >> np.uint64(12)).astype(np.float64) + 0.5) / 2**52


def _correlated(seed: int, x: Floats) -> Floats:
    """Return the probabilities u (m,) of the normal field at the places x (m, 3) in correlation lengths."""
    random = _uniform(seed, 4 * MODES).reshape(MODES, 4)
    waves, phases = normal_quantile(random[:, :3]) / TWO_PI, random[:, 3]  # in turns per length, in turns
    u = np.empty(len(x))
    for start in range(0, len(x), CHUNK):
        part = slice(start, start + CHUNK)
        x0, x1, x2 = np.ascontiguousarray(x[part].T)
        g = np.zeros_like(x0)
        for (w0, w1, w2), phase in zip(waves.tolist(), phases.tolist(), strict=True):
            g += cosine_of_turns(w0 * x0 + w1 * x1 + w2 * x2 + phase)
        u[part] = normal_distribution(g * np.sqrt(2.0 / MODES))
    return np.clip(u, *ENDS)  # where g is beyond 8, u could be 1 and the value infinite
