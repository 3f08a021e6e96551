"""The geometry of a cylindrical interface: which pairs cross it, its normals, and the area each pair stands for."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

import pybondem as bd
from pybondem.errors import InputError
from pybondem.interface import cylindrical, stretches

LENGTH, RADIUS, D = 6.0, 1.0, 0.6
AXES = [
    ("x", (0.0, 0.0, 0.0)),
    ("y", (5.0, -40.0, 2.0)),
    ((1.0, 2.0, 3.0), (-3.0, 0.5, 7.0)),
    ((0.0, -1.0, 1e-3), (0, 0, 9)),
]


def fibre_in_matrix(
    along: ArrayLike = (0.0, 0.0, 1.0), base: ArrayLike = (0.0, 0.0, 0.0), shake: float = 0.0
) -> bd.Model:
    """Return a model of a fibre, longer than the matrix around it, both cut from one packing, turned and shifted."""
    inside = {
        "fibre": bd.Cylinder(RADIUS, 1.3 * LENGTH),
        "matrix": bd.Cylinder(2.0, LENGTH) - bd.Cylinder(RADIUS, LENGTH),
    }
    to = np.asarray(along, float) / np.linalg.norm(along)
    turn, _ = Rotation.align_vectors([to], [[0.0, 0.0, 1.0]])
    model, random = bd.Model(), np.random.default_rng(1)
    for name, shape in inside.items():
        grains = bd.packing.hcp(D, shape)
        x = turn.apply(grains.x + random.uniform(-shake * D, shake * D, grains.x.shape)) + base
        model.add(bd.packing.Particles(x, grains.radius), name=name, density=2500.0)
    return model


def unit(axis: str | ArrayLike) -> NDArray[np.float64]:
    given = np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else np.asarray(axis, float)
    return np.asarray(given / np.linalg.norm(given))


# The whole interface --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "base"), AXES)
@pytest.mark.parametrize("shake", [0.0, 0.05])
def test_normals_are_radial_and_areas_fill_the_cylinder(axis: Any, base: Any, shake: float) -> None:
    model = fibre_in_matrix(unit(axis), base, shake)
    found = cylindrical(model, "fibre", "matrix", radius=RADIUS, length=LENGTH, axis=axis, base=base, gap=0.15)
    assert found.area.min() > 0.0
    assert found.area.sum() == pytest.approx(2.0 * np.pi * RADIUS * LENGTH, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(found.normal @ unit(axis), 0.0, atol=1e-14)
    i, j = found.pairs.T
    middle = 0.5 * (model.x[i] + model.x[j]) - base
    radial = middle - (middle @ unit(axis))[:, None] * unit(axis)
    np.testing.assert_allclose((radial * found.normal).sum(axis=1), np.linalg.norm(radial, axis=1), rtol=1e-12)
    np.testing.assert_allclose(found.height, (model.x[i] - base) @ unit(axis), atol=1e-12)


@pytest.mark.parametrize(("axis", "base"), AXES)
def test_it_is_made_of_the_pairs_that_cross_within_its_length(axis: Any, base: Any) -> None:
    model = fibre_in_matrix(unit(axis), base)
    found = cylindrical(model, "fibre", "matrix", radius=RADIUS, length=LENGTH, axis=axis, base=base)
    distance = np.linalg.norm(model.x[:, None] - model.x[None], axis=2)
    inner, outer = np.nonzero((distance < 1.05 * D) & (model.part_of[:, None] == 0) & (model.part_of[None] == 1))
    height = (model.x[inner] - base) @ unit(axis)
    within = (height > -1e-9) & (height < LENGTH + 1e-9)
    assert {tuple(p) for p in found.pairs} == set(zip(inner[within], outer[within], strict=True))
    assert not within.all()  # the fibre goes on, and its next layer still touches the matrix


@pytest.mark.parametrize(("axis", "base"), AXES[1:])
def test_it_does_not_depend_on_where_it_points(axis: Any, base: Any) -> None:
    upright = cylindrical(fibre_in_matrix(), "fibre", "matrix", radius=RADIUS, length=LENGTH, axis="z")
    found = cylindrical(
        fibre_in_matrix(unit(axis), base), "fibre", "matrix", radius=RADIUS, length=LENGTH, axis=axis, base=base
    )
    turn, _ = Rotation.align_vectors([unit(axis)], [[0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(found.pairs, upright.pairs)
    np.testing.assert_allclose(found.normal, turn.apply(upright.normal), atol=1e-12)
    np.testing.assert_allclose(found.area, upright.area, rtol=1e-9)


def test_the_axis_may_have_any_length() -> None:
    model = fibre_in_matrix()
    one, other = (
        cylindrical(model, "fibre", "matrix", radius=RADIUS, length=LENGTH, axis=axis) for axis in ("z", (0, 0, 3e-7))
    )
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


# Stretches of the axis ------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=150)
@given(
    st.lists(st.integers(0, 2000), min_size=1, max_size=40),
    st.floats(1e-3, 1e3),
)
def test_stretches_fill_the_length_and_go_to_the_nearest(steps: list[int], length: float) -> None:
    height = np.array(steps) / 2000.0 * length
    share = stretches(height, length)
    assert share.shape == height.shape
    assert share.min() > 0.0
    assert share.sum() == pytest.approx(length, rel=1e-12)
    levels = np.unique(height)
    points = (np.arange(100_000) + 0.5) / 100_000 * length
    border = 0.5 * (levels[1:] + levels[:-1])
    count = np.bincount(np.searchsorted(border, points), minlength=len(levels))  # how much lies nearest to each level
    for level, n in zip(levels, count, strict=True):
        mine = share[height == level]
        np.testing.assert_allclose(mine, mine[0], rtol=1e-12)
        assert mine.sum() == pytest.approx(n / 100_000 * length, abs=3e-5 * length)


def test_heights_that_differ_by_round_off_share_a_stretch() -> None:
    share = stretches(np.array([0.0, 2.0, 2.0 + 1e-13, 2.0 - 1e-13, 5.0]), 6.0)
    np.testing.assert_allclose(share, [1.0, 2.5 / 3, 2.5 / 3, 2.5 / 3, 2.5], rtol=1e-5)


# Refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"inner": "fiber"}, "did you mean 'fibre'"),
        ({"base": (0.0, 0.0, 100.0)}, "no neighbours cross from part 'fibre' to part 'matrix' between 0 and 6 m"),
        ({"radius": 0.0}, "radius of the interface"),
        ({"length": float("inf")}, "length of the interface"),
        ({"axis": "w"}, "axis is 'w'"),
        ({"axis": (0.0, 0.0, 0.0)}, "axis is the zero vector"),
        ({"base": (0.0, 0.0)}, "base has shape"),
        ({"gap": -0.1}, "gap of touching"),
    ],
)
def test_what_makes_no_interface_is_refused(arguments: dict[str, Any], says: str) -> None:
    good: dict[str, Any] = {"inner": "fibre", "outer": "matrix", "radius": RADIUS, "length": LENGTH, "axis": "z"}
    with pytest.raises(InputError, match=says):
        cylindrical(fibre_in_matrix(), **good | arguments)


def test_an_interface_of_a_part_with_itself_is_refused() -> None:
    with pytest.raises(InputError, match="fibre"):
        cylindrical(fibre_in_matrix(), "fibre", "fibre", radius=RADIUS, length=LENGTH, axis="z")


def test_a_pair_on_the_axis_has_no_normal() -> None:
    model = bd.Model()
    for name, z in (("fibre", 1.0), ("matrix", 2.0)):
        model.add(bd.packing.Particles([[0.0, 0.0, z]], [0.5]), name=name, density=2500.0)
    with pytest.raises(InputError, match=r"the bond of particles \[0, 1\] lies on the axis"):
        cylindrical(model, "fibre", "matrix", radius=1.0, length=3.0, axis="z")
