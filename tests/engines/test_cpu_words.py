"""exp, log and power of the cpu engine against those of the C library, on plain numbers and compiled."""

import math

import numba
import numpy as np
import pytest

from pybondem import ops
from pybondem.engines import cpu
from pybondem.engines.cpu_words import exp, log, power

EPS = np.finfo(float).eps


def compiled(word, *columns):
    """Return a word of the cpu engine on arrays, item by item, in a loop like those of a program."""
    function = cpu.WORDS[word]

    @numba.njit(parallel=True, error_model="numpy")
    def loop(columns, out):
        for k in numba.prange(out.shape[0]):
            out[k] = function(columns[k, 0]) if one else function(columns[k, 0], columns[k, 1])

    one, out = len(columns) == 1, np.empty(len(columns[0]))
    loop(np.stack(columns, axis=1), out)
    (assembly,) = loop.inspect_asm().values()
    return out, assembly


@pytest.fixture(scope="module")
def random():
    return np.random.default_rng(7)


def test_exp(random):
    x = np.concatenate([random.uniform(-708.0, 709.4, 20_000), random.uniform(-1.0, 1.0, 20_000), [0.0, -0.0, 1.0]])
    found, assembly = compiled(ops.exp, x)
    expected = np.array([math.exp(a) for a in x])
    assert np.max(np.abs(found / expected - 1.0)) <= 2.0 * EPS
    assert "exp@" not in assembly
    assert np.array_equal(found[:100], [exp(a) for a in x[:100]])


def test_log(random):
    x = np.concatenate([np.exp(random.uniform(-708.0, 709.0, 20_000)), random.uniform(0.5, 2.0, 20_000)])
    found, assembly = compiled(ops.log, x)
    expected = np.array([math.log(a) for a in x])
    assert np.max(np.abs(found / expected - 1.0)) <= 2.0 * EPS
    assert "log@" not in assembly
    assert np.array_equal(found[:100], [log(a) for a in x[:100]])
    assert compiled(ops.log, np.ones(3))[0].tolist() == [0.0, 0.0, 0.0]


def test_power(random):
    a, b = random.uniform(0.0, 1.0, 20_000), random.uniform(0.1, 4.0, 20_000)
    found, _ = compiled(ops.power, a, b)
    expected = np.array([math.pow(x, y) for x, y in zip(a, b, strict=True)])
    allowed = (2.0 + np.abs(b * np.log(a))) * EPS
    assert np.all(np.abs(found / expected - 1.0) <= allowed)
    assert np.array_equal(found[:100], [power(x, y) for x, y in zip(a[:100], b[:100], strict=True)])


def test_the_ends_of_the_range():
    inf, nan = np.inf, np.nan
    assert compiled(ops.exp, np.array([-inf, -1e4, 1e4, inf]))[0].tolist() == [0.0, 0.0, inf, inf]
    assert compiled(ops.log, np.array([0.0, 1e-310, inf]))[0].tolist() == [-inf, -inf, inf]
    assert np.isnan(compiled(ops.exp, np.array([nan]))[0]).all()
    assert np.isnan(compiled(ops.log, np.array([-1.0, -inf, nan]))[0]).all()
    given = np.array([[0.0, 2.0], [0.0, 0.0], [3.0, 0.0], [1.0, 9.0], [0.0, 0.5]])
    assert compiled(ops.power, *given.T)[0].tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]
    assert np.isnan(compiled(ops.power, np.array([-1.0]), np.array([2.0]))[0]).all()
