"""The argument checks: what passes comes back exactly, what does not is named."""

from fractions import Fraction

import numpy as np
import pytest

from pybondem.check import (
    axis_vector,
    choice,
    finite_array,
    finite_number,
    fraction,
    nearest,
    nonnegative,
    positive,
    positive_array,
    vector,
    whole_number,
)
from pybondem.errors import InputError

TINY = 5e-324


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int8(2), np.uint64(2), np.array(2.0), Fraction(2)])
def test_a_number_is_a_number_of_any_type(value: object) -> None:
    for found in (
        finite_number("E", value),
        positive("E", value, "Pa"),
        nonnegative("E", value),
        fraction("E", value, 0, 3),
    ):
        assert type(found) is float
        assert found == 2.0


@pytest.mark.parametrize(
    "value", [None, "2", True, np.True_, 2j, [2.0], np.array([2.0]), np.ma.masked, np.nan, np.inf, -np.inf, 10**400, {}]
)
@pytest.mark.parametrize("check", [finite_number, positive, nonnegative, fraction])
def test_what_is_no_finite_number_is_refused(check: object, value: object) -> None:
    with pytest.raises(InputError, match=r"^E of steel is .*; it must be .*\.$"):
        check("E of steel", value)


def test_the_ranges_of_numbers() -> None:
    assert positive("r", np.finfo(float).tiny, "m") == np.finfo(float).tiny
    assert nonnegative("c", 0) == 0.0
    assert fraction("nu", -1.0, -1.0, 0.5) == -1.0
    for value in (0.0, -0.0, -1.0, -TINY):
        with pytest.raises(InputError, match=rf"^r is {value!r} m; it must be positive\.$"):
            positive("r", value, "m")
    with pytest.raises(InputError, match=r"^r is 5e-324 m; it must be positive and at least 2.23e-308"):
        positive("r", TINY, "m")
    with pytest.raises(InputError, match=r"^c is -5e-324; it must not be negative\.$"):
        nonnegative("c", -TINY)
    for value in (-1.0000001, 0.50000001):
        with pytest.raises(InputError, match=rf"^nu is {value}; it must lie between -1 and 0.5\.$"):
            fraction("nu", value, -1.0, 0.5)


def test_whole_numbers() -> None:
    assert [whole_number("n", value) for value in (1, np.int64(7), np.uint8(3))] == [1, 7, 3]
    assert whole_number("n", 0, least=0) == 0
    for value in (1.0, "1", True, None, np.float64(2)):
        with pytest.raises(InputError, match=r"it must be a whole number of at least 1\.$"):
            whole_number("n", value)
    with pytest.raises(InputError, match=r"^n is 0; it must be at least 1\.$"):
        whole_number("n", 0)


def test_a_choice_names_the_nearest_word() -> None:
    assert choice("engine", "cpu", ("cpu", "cuda")) == "cpu"
    with pytest.raises(
        InputError, match=r"^engine is 'cude'; it must be one of 'cpu', 'cuda' \(did you mean 'cuda'\?\)\.$"
    ):
        choice("engine", "cude", ("cpu", "cuda"))
    with pytest.raises(InputError, match=r"^engine is 7; it must be one of 'cpu', 'cuda'\.$"):
        choice("engine", 7, ("cpu", "cuda"))
    assert nearest("qqqq", ("cpu", "cuda")) == ""


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8", ">f8", "<f4", "i1", "i8", ">i4", "u2", "u8", np.longdouble])
def test_an_array_of_any_real_type_is_taken_over_exactly(dtype: object) -> None:
    given = np.arange(12).reshape(4, 3).astype(dtype)
    for layout in (
        given,
        np.asfortranarray(given),
        given[::-1][::-1],
        given.tolist(),
        np.repeat(given, 2, axis=0)[::2],
    ):
        found = finite_array("x", layout, (None, 3))
        assert found.dtype == np.float64
        assert found.flags.c_contiguous
        assert found.flags.writeable
        np.testing.assert_array_equal(found, np.arange(12.0).reshape(4, 3))


def test_an_array_is_a_copy() -> None:
    given = np.zeros(3)
    given.flags.writeable = False
    finite_array("x", given, (3,))[0] = 1.0
    assert given[0] == 0.0


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([[1.0, 2.0, 3.0], [4.0, np.nan, np.inf]], r"^x\[1, 1\] is nan, not finite \(2 such values in all\)\.$"),
        ([[1.0, 2.0, -np.inf]], r"^x\[0, 2\] is -inf, not finite\.$"),
        (np.ones((2, 4)), r"^x has shape \(2, 4\); it must be \(n, 3\)\.$"),
        (np.ones(3), r"^x has shape \(3,\); it must be \(n, 3\)\.$"),
        (1.0, r"^x has shape \(\); it must be \(n, 3\)\.$"),
        ([[1.0, 2.0, 3.0], [4.0]], r"^x has rows of different lengths; its shape must be \(n, 3\)\.$"),
        ([[1.0, 2.0, None]], r"^x has dtype object; it must hold real numbers"),
        ([["1", "2", "3"]], r"^x has dtype <U1; it must hold real numbers"),
        ([[1j, 2, 3]], r"^x has dtype complex128; it must hold real numbers"),
        ([[True, False, True]], r"^x has dtype bool; it must hold real numbers"),
        (np.zeros((1, 3), dtype="M8[s]"), r"^x has dtype datetime64\[s\]; it must hold real numbers"),
        (np.zeros(1, dtype=[("a", float)]), r"^x has dtype .*; it must hold real numbers"),
        (
            np.ma.array(np.ones((1, 3)), mask=[[0, 1, 0]]),
            r"^x is a masked array; fill or drop its masked values first\.$",
        ),
        ([[0, 2**53 + 1, 0]], r"^x\[0, 1\] is 9007199254740993, beyond 2\^53"),
        ([[0, 0, -(2**63)]], r"^x\[0, 2\] is -9223372036854775808, beyond 2\^53"),
        (np.full((1, 3), 2**64 - 1, dtype=np.uint64), r"^x\[0, 0\] is 18446744073709551615, beyond .* \(3 such values"),
    ],
)
def test_an_array_that_cannot_be_taken_over_exactly_is_refused(value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        finite_array("x", value, (None, 3))


@pytest.mark.skipif(np.finfo(np.longdouble).nmant <= 52, reason="long double is double on this machine")
def test_extended_precision_is_refused_where_it_would_be_lost() -> None:
    with pytest.raises(InputError, match=r"^x\[1\] is .*, more precise than a double"):
        finite_array("x", np.array([1.0, np.longdouble(1) / 3, 2.0]), (3,))
    with pytest.raises(InputError, match=r"^x\[0\] is inf, not finite"):
        finite_array("x", np.array([np.finfo(np.longdouble).max]), (1,))


def test_an_array_of_positive_numbers_names_the_first_that_is_not() -> None:
    np.testing.assert_array_equal(positive_array("k", [1, 2], (None,)), [1.0, 2.0])
    with pytest.raises(InputError, match=r"^k\[1\] is -3.0 N/m; it must be positive \(2 such values in all\)\.$"):
        positive_array("k", [1.0, -3.0, 0.0], (None,), "N/m")
    with pytest.raises(InputError, match=r"^k\[0\] is 5e-324 m; it must be positive and at least 2.23e-308"):
        positive_array("k", [TINY], (None,), "m")


def test_vectors_and_axes() -> None:
    np.testing.assert_array_equal(vector("g", (0, 0, -9.81)), [0.0, 0.0, -9.81])
    np.testing.assert_array_equal([axis_vector("a", letter) for letter in "xyz"], np.eye(3))
    np.testing.assert_array_equal(axis_vector("a", (0, -2, 0)), [0.0, -1.0, 0.0])
    np.testing.assert_allclose(axis_vector("a", [3.0, 0.0, 4.0]), [0.6, 0.0, 0.8], rtol=1e-15)
    for scale in (1e-300, 1e300):  # whose squares under- and overflow
        np.testing.assert_allclose(axis_vector("a", scale * np.array([3.0, 0.0, 4.0])), [0.6, 0.0, 0.8], rtol=1e-15)
    with pytest.raises(InputError, match=r"^a is the zero vector; it must have a direction"):
        axis_vector("a", (0, 0, 0))
    with pytest.raises(InputError, match=r"^a is 'w'; it must be one of 'x', 'y', 'z'\.$"):
        axis_vector("a", "w")
    with pytest.raises(InputError, match=r"^a has shape \(2,\); it must be \(3,\)\.$"):
        axis_vector("a", (1, 2))
