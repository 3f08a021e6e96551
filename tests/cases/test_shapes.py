"""Shapes: what they hold, where they end, and the algebra of union, difference and intersection."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pybondem.errors import InputError
from pybondem.packing import Box, Cylinder, Shape, Sphere

whole = st.integers(-4, 4).map(float)  # so that points fall on faces
any_place = st.floats(-5.0, 5.0)
place = st.tuples(*[whole | any_place] * 3)
size = st.integers(1, 4).map(float) | st.floats(0.1, 4.0)
direction = place.filter(lambda v: max(map(abs, v)) > 0.1)
side = st.none() | st.tuples(whole | any_place, whole | any_place).map(lambda s: (min(s), max(s)))
one_sided = st.tuples(st.none(), whole) | st.tuples(whole, st.none())
axes = st.sampled_from("xyz") | direction
simple = st.one_of(
    st.builds(Box, side | one_sided, side, side),
    st.builds(Cylinder, size, size | st.none(), axes, place),
    st.builds(Sphere, size, place),
)
shapes = st.recursive(
    simple,
    lambda s: st.one_of(
        st.builds(lambda a, b: a | b, s, s), st.builds(lambda a, b: a & b, s, s), st.builds(lambda a, b: a - b, s, s)
    ),
    max_leaves=5,
)
quick = settings(deadline=None, max_examples=200)


def some_points(seed: int) -> np.ndarray:
    """Return 200 points (n, 3) about the shapes, half of them on whole numbers."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-5.0, 5.0, (100, 3)), rng.integers(-4, 5, (100, 3))])


points = st.integers(0, 2**32).map(some_points)


# ---------------------------------------------------------------------------------------------------------- each shape
def test_a_box_holds_what_lies_between_its_limits() -> None:
    x = np.random.default_rng(1).uniform(-3.0, 3.0, (2000, 3))
    box = Box(x=(-1.0, 2.0), y=(None, 0.5), z=None)
    np.testing.assert_array_equal(box.contains(x), (x[:, 0] >= -1.0) & (x[:, 0] <= 2.0) & (x[:, 1] <= 0.5))
    np.testing.assert_array_equal(box.bounds(), [[-1.0, -np.inf, -np.inf], [2.0, 0.5, np.inf]])
    assert Box().contains(x).all()


def test_a_sphere_holds_what_is_near_its_centre() -> None:
    x = np.random.default_rng(2).uniform(-3.0, 3.0, (2000, 3))
    ball = Sphere(1.5, (0.5, -0.5, 1.0))
    distance = [np.sqrt(sum((p - c) ** 2 for p, c in zip(row, (0.5, -0.5, 1.0), strict=True))) for row in x]
    np.testing.assert_array_equal(ball.contains(x), np.array(distance) <= 1.5)
    np.testing.assert_array_equal(ball.bounds(), [[-1.0, -2.0, -0.5], [2.0, 1.0, 2.5]])


@pytest.mark.parametrize("height", [2.5, None])
def test_a_cylinder_along_any_axis_is_a_turned_upright_cylinder(height: float | None) -> None:
    rng = np.random.default_rng(3)
    turn, base = Rotation.from_rotvec([0.4, -1.1, 0.7]), np.array([0.3, -0.2, 0.1])
    upright = rng.uniform(-3.0, 3.0, (4000, 3))
    expected = upright[:, 0] ** 2 + upright[:, 1] ** 2 <= 1.3**2
    if height is not None:
        expected &= (upright[:, 2] >= 0.0) & (upright[:, 2] <= height)
    tilted = Cylinder(1.3, height, axis=5.0 * turn.apply([0.0, 0.0, 1.0]), base=base)
    assert 100 < expected.sum() < 3000
    np.testing.assert_array_equal(tilted.contains(base + turn.apply(upright)), expected)


@pytest.mark.parametrize("axis", ["x", "y", "z", (0.0, 0.0, -2.0), (1.0, 2.0, 3.0)])
def test_the_bounds_of_a_cylinder_touch_its_rims(axis: object) -> None:
    cylinder = Cylinder(2.0, 3.0, axis, base=(1.0, -1.0, 0.5))
    along = np.array(
        {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}.get(axis, axis) if isinstance(axis, str) else axis
    )
    along = along / np.linalg.norm(along)
    turn = Rotation.align_vectors([along], [[0.0, 0.0, 1.0]])[0]
    angle = np.linspace(0.0, 2.0 * np.pi, 100001)
    circle = 2.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    rim = turn.apply(circle) + np.array([1.0, -1.0, 0.5])
    rims = np.concatenate([rim, rim + 3.0 * along])
    low, high = cylinder.bounds()
    np.testing.assert_allclose(low, rims.min(axis=0), atol=1e-8)
    np.testing.assert_allclose(high, rims.max(axis=0), atol=1e-8)


def test_a_cylinder_without_ends_is_bounded_across_its_axis() -> None:
    low, high = Cylinder(2.0, None, "y", base=(1.0, 7.0, 0.0)).bounds()
    np.testing.assert_array_equal(low, [-1.0, -np.inf, -2.0])
    np.testing.assert_array_equal(high, [3.0, np.inf, 2.0])


def test_a_plane_is_a_box() -> None:
    x = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.5, 0.5, 1e-8]])
    np.testing.assert_array_equal(Box((0, 1), (0, 1), (0, 0)).contains(x), [True, True, False])


# --------------------------------------------------------------------------------------------------------- its surface
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize(
    ("shape", "on", "outwards"),
    [
        (lambda s: Box((0, 2 * s), (0, s), (0, s)), (1, 1, 0.5), (0, 1, 0)),
        (lambda s: Box((0, 2 * s), (0, s), (0, s)), (0, 1, 0.5), (-1, 0, 0)),
        (lambda s: Cylinder(s / 2, 2 * s), (0.3, 0.4, 1), (0.6, 0.8, 0)),
        (lambda s: Cylinder(s / 2, 2 * s), (0.1, 0.2, 2), (0, 0, 1)),
        (lambda s: Cylinder(s, s), (0.1, 0.2, 0), (0, 0, -1)),
        (lambda s: Cylinder(s, None), (0.6, 0.8, -50), (0.6, 0.8, 0)),
        (lambda s: Sphere(s), (0, 0.6, -0.8), (0, 0.6, -0.8)),
    ],
)
def test_a_surface_is_inside_to_a_billionth_of_the_size(shape: object, on: tuple, outwards: tuple, unit: float) -> None:
    body, surface, normal = shape(unit), unit * np.array(on, dtype=float), np.array(outwards, dtype=float)
    tolerance = 1e-9 * 2.0 * unit  # the largest dimension of each is 2
    offsets = np.array([-2.0, -0.5, 0.0, 0.9, 1.1])[:, None] * tolerance
    expected = [True, True, True, True, False]
    np.testing.assert_array_equal(body.contains(surface + offsets * normal), expected)
    np.testing.assert_array_equal((Box() - body).contains(surface + offsets * normal), np.logical_not(expected))
    wider = body.contains(surface + np.array([[0.9], [1.1]]) * 1e-3 * unit * normal, slack=1e-3 * unit)
    np.testing.assert_array_equal(wider, [True, False])


def test_slack_may_differ_from_point_to_point() -> None:
    x = np.array([[1.5, 0.0, 0.0], [1.5, 0.0, 0.0]])
    np.testing.assert_array_equal(Sphere(1.0).contains(x, slack=np.array([0.4, 0.6])), [False, True])


def test_a_tube_and_its_core_share_no_point_and_lose_none() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 1000)
    x = np.stack([np.cos(angle), np.sin(angle), 0.5 + 0.0 * angle], axis=1)  # on the wall between them, to round-off
    whole_rod, core = Cylinder(3.0, 1.0), Cylinder(1.0, 1.0)
    assert core.contains(x).all()
    assert not (whole_rod - core).contains(x).any()


# --------------------------------------------------------------------------------------------------------- the algebra
@quick
@given(shapes, shapes, points, st.sampled_from([0.0, 0.5]))
def test_union_intersection_and_difference_are_those_of_sets(a: Shape, b: Shape, x: np.ndarray, slack: float) -> None:
    in_a, in_b = a.contains(x, slack), b.contains(x, slack)
    np.testing.assert_array_equal((a | b).contains(x, slack), in_a | in_b)
    np.testing.assert_array_equal((a & b).contains(x, slack), in_a & in_b)
    np.testing.assert_array_equal((a - b).contains(x, slack), in_a & ~in_b)


@quick
@given(shapes, points, direction)
def test_what_is_inside_lies_within_the_bounds(a: Shape, x: np.ndarray, e: tuple[float, float, float]) -> None:
    held = x[a.contains(x)]
    low, high = a.bounds()
    unit = np.array(e) / np.linalg.norm(e)
    start, end = a.extent(unit)
    margin = 1e-7  # far above the tolerance of these shapes
    assert np.all(held >= low - margin)
    assert np.all(held <= high + margin)
    assert np.all(held @ unit >= start - margin)
    assert np.all(held @ unit <= end + margin)


@quick
@given(shapes, points, points)
def test_the_gap_never_exceeds_the_distance(a: Shape, x: np.ndarray, other: np.ndarray) -> None:
    other = x + 0.1 * other
    here, there = a.gap(x), a.gap(other)
    finite = np.isfinite(here) & np.isfinite(there)
    change = np.abs(here[finite] - there[finite])
    assert np.all(change <= np.linalg.norm(x - other, axis=1)[finite] * (1.0 + 1e-12) + 1e-12)
    assert not np.any(a.contains(x) & (here > 0.0))


@quick
@given(st.tuples(whole, size).map(lambda s: (s[0], s[0] + s[1])), size)
def test_the_extent_of_a_box_is_reached_at_a_corner(limits: tuple[float, float], height: float) -> None:
    box = Box(limits, (-1.0, 2.0), (0.0, height))
    corners = np.array([[x, y, z] for x in limits for y in (-1.0, 2.0) for z in (0.0, height)])
    unit = np.array([2.0, -3.0, 6.0]) / 7.0
    np.testing.assert_allclose(box.extent(unit), [np.min(corners @ unit), np.max(corners @ unit)], atol=1e-12)


def test_disjoint_shapes_have_reversed_bounds_that_do_not_spoil_a_union() -> None:
    nothing = Box(z=(2, 3)) & Box(z=(5, 6))
    low, high = nothing.bounds()
    assert low[2] > high[2]
    np.testing.assert_array_equal((nothing | Sphere(1.0)).bounds()[1][2], 1.0)
    assert not nothing.contains(np.zeros((1, 3))).any()


def test_shapes_are_values() -> None:
    assert Cylinder(1, 2, "z") == Cylinder(1.0, 2.0, (0, 0, 5))
    assert Box(x=[0, 1]) == Box(x=(0.0, 1.0))
    assert len({Sphere(1), Sphere(1.0), Sphere(2)}) == 2
    with pytest.raises(FrozenInstanceError):
        Sphere(1.0).radius = 2.0
    assert repr(Box(z=(0, None)) - Sphere(1)) == (
        "Difference(first=Box(x=None, y=None, z=(0.0, None)), second=Sphere(radius=1.0, centre=(0.0, 0.0, 0.0)))"
    )


@pytest.mark.parametrize("other", [1, None, "Box"])
def test_shapes_combine_only_with_shapes(other: object) -> None:
    for combine in (lambda a: a | other, lambda a: a & other, lambda a: a - other):
        with pytest.raises(TypeError, match="unsupported operand"):
            combine(Sphere(1.0))


# ----------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(0.0), r"^radius of Sphere is 0.0 m; it must be positive\.$"),
        (lambda: Sphere(-1), r"^radius of Sphere is -1.0 m"),
        (lambda: Sphere(np.nan), r"^radius of Sphere is nan m; it must be finite\.$"),
        (lambda: Sphere(5e-324), r"^radius of Sphere is 5e-324 m; .* smallest normal double"),
        (lambda: Sphere("1 mm"), r"^radius of Sphere is '1 mm'; it must be a number in m\.$"),
        (lambda: Sphere(1, (0, 0)), r"^centre of Sphere has shape \(2,\); it must be \(3,\)\.$"),
        (lambda: Sphere(1, (0, 0, np.inf)), r"^centre of Sphere\[2\] is inf, not finite\.$"),
        (lambda: Cylinder(-1, 1), r"^radius of Cylinder is -1.0 m"),
        (lambda: Cylinder(1, 0), r"^height of Cylinder is 0.0 m"),
        (lambda: Cylinder(1, np.inf), r"^height of Cylinder is inf m; it must be finite\.$"),
        (lambda: Cylinder(1, 1, "w"), r"^axis of Cylinder is 'w'; it must be one of 'x', 'y', 'z'\.$"),
        (lambda: Cylinder(1, 1, (0, 0, 0)), r"^axis of Cylinder is the zero vector"),
        (lambda: Cylinder(1, 1, "z", (0, np.nan, 0)), r"^base of Cylinder\[1\] is nan"),
        (lambda: Box(x=(1, 0)), r"^x of Box runs from 1 m to 0 m; the upper limit must not be below the lower\.$"),
        (lambda: Box(y=(0, np.nan)), r"^y of Box is nan m; it must be finite\.$"),
        (lambda: Box(y=(0, np.inf)), r"^y of Box is inf m; it must be finite\.$"),
        (lambda: Box(z=1.0), r"^z of Box is 1.0; it must be \(lower, upper\) in m, None for no limit\.$"),
        (lambda: Box(z=(0, 1, 2)), r"^z of Box is \(0, 1, 2\); it must be"),
        (lambda: Box(z="01"), r"^z of Box is '01'; it must be"),
        (lambda: Sphere(1).contains([0, 0, 0]), r"^x of contains has shape \(3,\); it must be \(n, 3\)\.$"),
        (lambda: Sphere(1).contains([[0, np.nan, 0]]), r"^x of contains\[0, 1\] is nan, not finite\.$"),
    ],
)
def test_bad_input_is_named(make: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
