"""Scattered values: held against decimals of 60 digits, closed forms and scipy; the same bits everywhere."""

import ast
import math
import os
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import special, stats

from pybondem import portable, scatter
from pybondem.errors import InputError

Floats = NDArray[np.float64]
inf, nan = math.inf, math.nan
NORMAL = {"mean": 5e6, "deviation": 1e6}
WEIBULL = {"scale": 5e6, "modulus": 8.0}


# The truth: decimals -----------------------------------------------------------------------------------------------

PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803")


def exact(number: float | Fraction) -> Decimal:
    return Decimal(number.numerator) / Decimal(number.denominator) if isinstance(number, Fraction) else Decimal(number)


def cosine_of_turns(t: Decimal) -> Decimal:
    """cos(2 pi t), by its Taylor series."""
    y = 2 * PI * (t - t.to_integral_value())
    total = term = Decimal(1)
    for k in range(2, 100, 2):
        term *= -y * y / (k * (k - 1))
        total += term
    return total


def distribution(z: Decimal) -> Decimal:
    """The probability that a standard normal number is below z: its Taylor series, integrated term by term."""
    with localcontext() as context:
        context.prec += int(z * z / 2)  # what cancels
        total = power = z
        k = 0
        while abs(power) > Decimal(10) ** -context.prec:
            k += 1
            power *= -z * z / (2 * k)
            total += power / (2 * k + 1)
        below = Decimal("0.5") + total / (2 * PI).sqrt()
    return +below


def quantile(p: Decimal) -> Decimal:
    """The inverse, by Newton's method from a double."""
    if p > Decimal("0.5"):
        return -quantile(1 - p)
    z = Decimal(float(special.ndtri(float(p))))
    for _ in range(3):
        z -= (distribution(z) - p) * (2 * PI).sqrt() * (z * z / 2).exp()
    return z


@pytest.fixture(autouse=True)
def _sixty_digits() -> Any:
    with localcontext() as context:
        context.prec = 60
        yield


def off(got: Floats, truth: list[Decimal]) -> float:
    """The largest error of `got`, as a share of the value."""
    return float(max(abs(exact(float(g)) - t) / abs(t) for g, t in zip(got, truth, strict=True)))


def ulps(got: Floats, truth: list[Decimal]) -> float:
    """The largest error of `got`, in units of the last place."""
    return float(max(abs(exact(float(g)) - t) / exact(math.ulp(float(t))) for g, t in zip(got, truth, strict=True)))


@pytest.mark.parametrize(
    ("function", "truth", "low", "high"),
    [
        (portable.log, Decimal.ln, 0.4, 2.5),
        (portable.log, Decimal.ln, 1e-16, 1e-14),
        (portable.log, Decimal.ln, 1.0, 1e300),
        (portable.exp, Decimal.exp, -1.0, 1.0),
        (portable.exp, Decimal.exp, -700.0, 700.0),
        (portable.cosine_of_turns, cosine_of_turns, -2.0, 2.0),
        (portable.cosine_of_turns, cosine_of_turns, -1e6, 1e6),
        (portable.normal_distribution, distribution, -1.1, 1.1),
        (portable.normal_distribution, distribution, -8.0, 3.0),
        (portable.normal_quantile, quantile, 1e-15, 1e-11),
        (portable.normal_quantile, quantile, 1e-11, 0.08),
        (portable.normal_quantile, quantile, 0.07, 0.93),
        (portable.normal_quantile, quantile, 0.92, 1.0),
    ],
)
def test_functions_are_right_to_1e_15(function: Any, truth: Any, low: float, high: float) -> None:
    x = np.random.default_rng(0).uniform(low, high, 200)
    assert off(function(x), [truth(exact(float(v))) for v in x]) < 1e-15


def test_exp_ends_in_zero_and_infinity() -> None:
    assert np.array_equal(portable.exp(np.array([-inf, -1e9, -800.0, 0.0, 710.0, inf])), [0, 0, 0, 1, inf, inf])


# Values, one by one ------------------------------------------------------------------------------------------------


def drawn(seed: int, count: int) -> list[Fraction]:
    """The probabilities that a seed draws: PCG64 (XSL RR 128/64) in whole numbers, from the state that it starts in."""
    at: Any = np.random.PCG64(seed).state["state"]
    state, found = at["state"], []
    for _ in range(count):
        state = (state * 0x2360ED051FC65DA44385DF649FCCF645 + at["inc"]) % 2**128
        word, turn = (state >> 64 ^ state) % 2**64, state >> 122
        word = (word >> turn | word << 64 - turn) % 2**64
        found.append(Fraction(2 * (word >> 12) + 1, 2**53))
    return found


def cut(u: Fraction, low: float | None, high: float | None) -> Decimal:
    """Quantile of a truncated standard normal distribution."""
    below = Decimal(0) if low is None else distribution(exact(low))
    above = Decimal(1) if high is None else distribution(exact(high))
    return quantile(below + exact(u) * (above - below))


def weibull(u: Fraction, scale: int, modulus: int) -> Decimal:
    return scale * ((-exact(1 - u).ln()).ln() / modulus).exp()


@pytest.mark.parametrize(
    ("made", "truth", "units"),
    [
        (scatter.weibull(**WEIBULL, seed=1), lambda u: weibull(u, 5_000_000, 8), 2),
        (scatter.weibull(**WEIBULL, seed=0, low=1e6), lambda u: 1_000_000 + weibull(u, 5_000_000, 8), 2),
        (scatter.weibull(2.0, 1, seed=2**70), lambda u: weibull(u, 2, 1), 5),
        (scatter.normal(**NORMAL, seed=1), lambda u: 5_000_000 + 1_000_000 * cut(u, None, None), 2),
        (scatter.normal(**NORMAL, seed=1, low=4e6), lambda u: 5_000_000 + 1_000_000 * cut(u, -1.0, None), 2),
        (scatter.normal(**NORMAL, seed=1, high=5.5e6), lambda u: 5_000_000 + 1_000_000 * cut(u, None, 0.5), 2),
        (scatter.normal(**NORMAL, seed=1, low=4e6, high=8e6), lambda u: 5_000_000 + 1_000_000 * cut(u, -1.0, 3.0), 2),
        (scatter.normal(0.0, 1.0, seed=1, low=7.0), lambda u: cut(u, 7.0, None), 4),
        (scatter.normal(0.0, 1.0, seed=1, low=7.0, high=7.5), lambda u: cut(u, 7.0, 7.5), 4),
        (scatter.normal(0.0, 1.0, seed=1, high=-8.0), lambda u: cut(u, None, -8.0), 4),
        (scatter.uniform(4e6, 6e6, seed=7), lambda u: 4_000_000 + 2_000_000 * exact(u), 2),
    ],
    ids=lambda value: "-" if callable(value) else str(value),
)
def test_values_are_right_to_the_last_digits(
    made: scatter.Scatter, truth: Callable[[Fraction], Decimal], units: int
) -> None:
    """Within so many units of the last place: 2 but for a modulus of 1 and far out in a tail."""
    got = made.values(np.zeros((200, 3)))
    assert got.dtype == np.float64
    assert got.shape == (200,)
    assert ulps(got, [truth(u) for u in drawn(made.seed, 200)]) <= units


def test_extreme_draws_stay_exact() -> None:
    ends = np.array([2.0**-53, 1.0 - 2.0**-53])
    truth = [weibull(Fraction(float(u)), 5_000_000, 8) for u in ends]
    assert ulps(scatter.Weibull(5e6, 8.0, 0.0).quantile(ends), truth) <= 4.0
    assert ulps(scatter.Normal(0.0, 1.0, -inf, inf).quantile(ends), [quantile(exact(float(u))) for u in ends]) <= 4.0


# Values, many together ---------------------------------------------------------------------------------------------

SHARED: list[tuple[Callable[..., scatter.Scatter], dict[str, float], Any]] = [
    (scatter.weibull, WEIBULL, stats.weibull_min(8.0, scale=5e6)),
    (scatter.weibull, {"scale": 5e6, "modulus": 2.0, "low": 1e6}, stats.weibull_min(2.0, loc=1e6, scale=5e6)),
    (scatter.normal, NORMAL, stats.norm(5e6, 1e6)),
    (scatter.normal, NORMAL | {"low": 4e6, "high": 7e6}, stats.truncnorm(-1.0, 2.0, 5e6, 1e6)),
    (scatter.uniform, {"low": 4e6, "high": 6e6}, stats.uniform(4e6, 2e6)),
]
every_distribution = pytest.mark.parametrize(("make", "values", "truth"), SHARED, ids=[repr(v) for _, v, _ in SHARED])


def places(count: int, size: float, seed: int = 0) -> Floats:
    return np.random.default_rng(seed).uniform(-0.5 * size, 0.5 * size, (count, 3))


@every_distribution
def test_independent_values_have_the_distribution(make: Any, values: dict[str, float], truth: Any) -> None:
    v = make(**values, seed=3).values(np.zeros((100_000, 3)))
    assert stats.kstest(v, truth.cdf).pvalue > 0.01
    error = truth.std() / math.sqrt(len(v))
    assert v.mean() == pytest.approx(truth.mean(), abs=3.0 * error)
    assert v.std() == pytest.approx(truth.std(), abs=5.0 * error)
    assert np.corrcoef(v[1:], v[:-1])[0, 1] == pytest.approx(0.0, abs=0.01)


@every_distribution
def test_correlated_values_have_the_same_distribution(make: Any, values: dict[str, float], truth: Any) -> None:
    """Places 30 lengths apart on average, so that the test may take them as independent."""
    v = make(**values, seed=3, length=1e-3).values(places(20_000, 1.0))
    assert stats.kstest(v, truth.cdf).pvalue > 0.01


def test_moments_of_the_weibull_distribution() -> None:
    v = scatter.weibull(**WEIBULL, seed=5).values(np.zeros((100_000, 3)))
    first, second = math.gamma(1 + 1 / 8), math.gamma(1 + 2 / 8)
    assert v.mean() == pytest.approx(5e6 * first, rel=2e-3)
    assert v.std() == pytest.approx(5e6 * math.sqrt(second - first**2), rel=1e-2)
    assert np.mean(v < 5e6) == pytest.approx(1.0 - math.exp(-1.0), abs=5e-3)


@pytest.mark.parametrize("length", [None, 1e-3])
def test_limits_hold(length: float | None) -> None:
    v = scatter.normal(**NORMAL, seed=1, low=4.9e6, high=5.2e6, length=length).values(places(5000, 1.0))
    assert 4.9e6 <= v.min() < 4.901e6
    assert 5.199e6 < v.max() <= 5.2e6
    assert len(np.unique(v)) == len(v)


def test_seeds_are_independent_and_repeat() -> None:
    x = places(2000, 1.0)
    for length in (None, 1e-3):
        one, again, other = (scatter.normal(0.0, 1.0, seed=s, length=length).values(x) for s in (1, 1, 2))
        assert np.array_equal(one, again)
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.07


# Rows and places ---------------------------------------------------------------------------------------------------


def test_independent_values_go_by_row() -> None:
    made = scatter.weibull(**WEIBULL, seed=1)
    all_rows = made.values(np.zeros((1000, 3)))
    for m in (0, 1, 17, 1000):
        assert np.array_equal(made.values(places(m, 1.0)), all_rows[:m])


def test_correlated_values_go_by_place() -> None:
    made = scatter.weibull(**WEIBULL, seed=1, length=2e-3)
    x = places(scatter.CHUNK + 5, 0.1)
    field = made.values(x)
    some = np.random.default_rng(1).permutation(len(x))[:500]
    assert np.array_equal(made.values(x[some]), field[some])
    assert np.array_equal(made.values(x[-1:]), field[-1:])
    assert made.values(np.zeros((0, 3))).shape == (0,)
    assert made.values([[0, 0, 0]]) == made.values([[0.0, -0.0, 0.0]])


def test_field_is_the_sum_of_its_waves() -> None:
    """Again, with the functions of NumPy and scipy."""
    length, x = 2e-3, places(50, 0.1)
    random = np.array([float(u) for u in drawn(9, 4 * scatter.MODES)]).reshape(-1, 4)
    waves = special.ndtri(random[:, :3]) / length
    g = math.sqrt(2.0 / scatter.MODES) * np.cos(x @ waves.T + 2.0 * np.pi * random[:, 3]).sum(axis=1)
    assert scatter.normal(0.0, 1.0, seed=9, length=length).values(x) == pytest.approx(g, abs=1e-10)
    share = special.ndtr(g)
    assert scatter.uniform(4.0, 6.0, seed=9, length=length).values(x) == pytest.approx(4.0 + 2.0 * share, abs=1e-10)


def test_correlation_falls_off_as_the_kernel_says() -> None:
    """Mean over 32 seeds, 300 places each, in three directions; that of one field alone is off by some 0.06."""
    length, x = 2e-3, places(300, 1.0)
    lags, directions = np.array([0.0, 0.5, 1.0, 2.0, 4.0]), np.array([[1, 0, 0], [0, 1, 0], [2 / 3, -1 / 3, 2 / 3]])
    moved = x + length * lags[:, None, None, None] * directions[:, None, :]  # (lag, direction, place, axis)
    found = []
    for seed in range(32):
        g = scatter.normal(0.0, 1.0, seed=seed, length=length).values(moved.reshape(-1, 3)).reshape(moved.shape[:3])
        found.append((g[0] * g).mean(axis=2))
    kernel = np.exp(-0.5 * lags**2)
    assert np.abs(np.mean(found, axis=0) - kernel[:, None]).max() < 0.03


# The same bits -----------------------------------------------------------------------------------------------------

DIGESTS = """
import hashlib
import numpy as np
from pybondem import scatter
x = np.arange(900.0).reshape(300, 3) / 2**14
for length in (None, 2.0**-9):
    for made in (
        scatter.weibull(scale=5e6, modulus=8.0, seed=1, length=length),
        scatter.normal(mean=5e6, deviation=1e6, low=1e6, high=9e6, seed=1, length=length),
        scatter.uniform(low=4e6, high=6e6, seed=1, length=length),
    ):
        print(hashlib.sha256(made.values(x).astype("<f8").tobytes()).hexdigest()[:16])
"""
PINNED = [
    "8ed43e44583fd4b1", "837d7c97eaa8eef4", "811d78570acd4bd3",
    "70dc47eabb40a759", "aead437a5b639b3c", "c56be666cbe0db32",
]  # fmt: skip


def test_same_bits_without_the_extensions_of_the_processor() -> None:
    """Held against what one machine found; also with all vector instructions off that NumPy can do without."""
    extensions: Any = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    for off in ("", " ".join(extensions)):
        run = subprocess.run(
            [sys.executable, "-c", DIGESTS],
            env=os.environ | {"NPY_DISABLE_CPU_FEATURES": off},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.stdout.split() == PINNED, run.stderr


def test_only_operations_that_round_in_one_way_are_used() -> None:
    """What a processor or a library may do in its own way (np.log, np.sum, powers of doubles) appears nowhere."""
    exact_ones = {"abs", "clip", "floor", "frexp", "ldexp", "maximum", "minimum", "sqrt", "where"}
    shapes = {"array", "ascontiguousarray", "empty", "full_like", "zeros_like", "float64", "int32", "uint64"}
    rest = {"any", "argmax", "errstate", "inf", "isfinite", "random"}
    methods = {"sum", "std", "dot", "prod", "cumsum", "normal", "uniform", "standard_normal", "log", "exp"}
    for module in (portable, scatter):
        nodes = list(ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))))
        attributes = [n for n in nodes if isinstance(n, ast.Attribute)]
        assert {n.attr for n in attributes if ast.unparse(n.value) == "np"} <= exact_ones | shapes | rest
        assert not {n.attr for n in attributes} & methods
        assert not any(isinstance(n, ast.MatMult) for n in nodes)
        powers = {ast.unparse(n.left) for n in nodes if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Pow)}
        assert powers <= {"2", "10", "-1", "2 * PI"}  # whole numbers and fractions
        assert {a.name for n in nodes if isinstance(n, ast.ImportFrom) and n.module == "math" for a in n.names} <= {
            "factorial"
        }
        sources = {n.module for n in nodes if isinstance(n, ast.ImportFrom)}
        own = {"pybondem.check", "pybondem.errors", "pybondem.portable"}
        assert sources <= own | {"collections.abc", "dataclasses", "fractions", "math", "numpy.typing", "typing"}


# Bad input ---------------------------------------------------------------------------------------------------------

loose: Any = scatter  # to give what a type checker would refuse


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: loose.weibull(0.0, 8.0, seed=1), "scale of weibull is 0.0; it must be positive"),
        (lambda: loose.weibull(5e6, -8.0, seed=1), "modulus of weibull is -8.0; it must be positive"),
        (lambda: loose.weibull(5e6, "8", seed=1), "modulus of weibull is '8'; it must be a number"),
        (lambda: loose.weibull(5e6, 1e-3, seed=1), "weibull has values too large for a double"),
        (lambda: loose.weibull(1e308, 1.0, seed=1), "weibull has values too large for a double"),
        (lambda: loose.weibull(5e6, 8.0, seed=1, low=nan), "low of weibull is nan; it must be finite"),
        (lambda: loose.weibull(5e6, 8.0, seed=-1), "seed of weibull is -1; it must be at least 0"),
        (lambda: loose.weibull(5e6, 8.0, seed=1.0), "seed of weibull is 1.0; it must be a whole number"),
        (lambda: loose.weibull(5e6, 8.0, seed=True), "seed of weibull is True; it must be a whole number"),
        (lambda: loose.weibull(5e6, 8.0, seed=1, length=0.0), "length of weibull is 0.0 m; it must be positive"),
        (lambda: loose.normal(inf, 1e6, seed=1), "mean of normal is inf; it must be finite"),
        (lambda: loose.normal(5e6, 0.0, seed=1), "deviation of normal is 0.0; it must be positive"),
        (lambda: loose.normal(0.0, 1e308, seed=1), "normal has values too large for a double"),
        (lambda: loose.normal(5e6, 1e6, seed=1, low="a"), "low of normal is 'a'; it must be a number"),
        (lambda: loose.normal(5e6, 1e6, seed=1, high=nan), "high of normal is nan; it must be finite"),
        (
            lambda: loose.normal(5e6, 1e6, seed=1, low=2.0, high=2.0),
            "low of normal is 2.0; it must be below high, 2.0",
        ),
        (lambda: loose.normal(0.0, 1.0, seed=1, low=40.0), "next to nothing .* lies in between"),
        (lambda: loose.normal(0.0, 1.0, seed=1, high=-1e308), "next to nothing .* lies in between"),
        (lambda: loose.normal(5e6, 1e6, seed=1, length=-1.0), "length of normal is -1.0 m; it must be positive"),
        (lambda: loose.uniform(2.0, 1.0, seed=1), "low of uniform is 2.0; it must be below high, 1.0"),
        (lambda: loose.uniform(nan, 1.0, seed=1), "low of uniform is nan; it must be finite"),
        (lambda: loose.uniform(0.0, 1.0, seed="1"), "seed of uniform is '1'; it must be a whole number"),
        (lambda: loose.uniform(0.0, 1.0, seed=1).values([[0.0, 1.0]]), r"x of scatter has shape \(1, 2\)"),
        (
            lambda: loose.uniform(0.0, 1.0, seed=1).values([[0.0, nan, 0.0]]),
            r"x of scatter\[0, 1\] is nan, not finite",
        ),
        (
            lambda: loose.uniform(0.0, 1.0, seed=1, length=1e-9).values([[0.0, 0.0, 0.0], [0.0, 0.0, -2.0]]),
            r"x\[1\] of scatter lies more than 1e\+09 correlation lengths from the origin; .* 1e-09",
        ),
        (
            lambda: loose.uniform(0.0, 1.0, seed=1, length=1e-300).values([[1e300, 0.0, 0.0]]),
            r"x\[0\] of scatter lies",
        ),
    ],
)
def test_bad_input_is_refused(make: Callable[[], Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


def test_seed_is_required() -> None:
    for make in (
        lambda: loose.weibull(1.0, 2.0),
        lambda: loose.normal(1.0, 2.0),
        lambda: loose.uniform(1.0, 2.0),
    ):
        with pytest.raises(TypeError, match="seed"):
            make()


def test_widest_ranges_are_held() -> None:
    v = scatter.uniform(-1.7e308, 1.7e308, seed=1).values(np.zeros((100, 3)))
    assert np.all(np.isfinite(v))
    assert v.min() < -1e308 < 1e308 < v.max()
