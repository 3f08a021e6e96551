"""Packings: exact neighbours, density, orientation, order, and the spheres of the published pull-out sample."""

from collections.abc import Callable
from dataclasses import FrozenInstanceError
from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pybondem.errors import InputError
from pybondem.packing import Box, Cylinder, Particles, Shape, Sphere, fcc, hcp, line, sc

Floats = NDArray[np.float64]
AXIS = (0.3, -1.2, 0.7)
# Textbook cells for d = 1: primitive vectors, basis, neighbours, share of space filled.
CELLS = {
    hcp: (
        [[1.0, 0.0, 0.0], [0.5, sqrt(3.0) / 2.0, 0.0], [0.0, 0.0, 2.0 * sqrt(2.0 / 3.0)]],
        [[0.0, 0.0, 0.0], [0.5, 1.0 / (2.0 * sqrt(3.0)), sqrt(2.0 / 3.0)]],
        12,
        pi / sqrt(18.0),
    ),
    fcc: (np.sqrt(0.5) * np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1]]), [[0.0, 0.0, 0.0]], 12, pi / sqrt(18.0)),
    sc: (np.eye(3), [[0.0, 0.0, 0.0]], 6, pi / 6.0),
}
lattice = pytest.mark.parametrize("packing", CELLS, ids=lambda p: p.__name__)


def cell_sites(packing: Callable[..., Particles], diameter: float, radius: float) -> Floats:
    """Return all sites within a distance of the origin, from the cell of the textbook: row along x, axis along z."""
    vectors, basis, _, _ = CELLS[packing]
    n = int(2.5 * radius / diameter) + 2
    steps = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * 3), axis=-1).reshape(-1, 3)
    sites = np.concatenate([steps @ np.array(vectors) + np.array(b) for b in basis]) * diameter
    return sites[np.linalg.norm(sites, axis=1) <= radius * (1.0 + 1e-9)]


def assert_same_points(found: Floats, expected: Floats, within: float) -> None:
    """Hold that two sets of points are the same in any order."""
    assert len(found) == len(expected)
    distance, partner = cKDTree(expected).query(found)
    assert np.max(distance) <= within
    assert len(np.unique(partner)) == len(expected)


# ------------------------------------------------------------------------------------------------------------ lattices
@lattice
@pytest.mark.parametrize("diameter", [1e-6, 0.7, 30.0])
def test_a_lattice_is_that_of_the_textbook(packing: Callable[..., Particles], diameter: float) -> None:
    radius = 4.3 * diameter
    grains = packing(diameter, Sphere(radius))
    assert_same_points(grains.x, cell_sites(packing, diameter, radius), within=1e-14 * diameter)
    np.testing.assert_array_equal(grains.radius, diameter / 2.0)
    assert np.any(np.all(grains.x == 0.0, axis=1))  # one sphere at the origin, exactly


@lattice
def test_axis_and_row_turn_a_lattice(packing: Callable[..., Particles]) -> None:
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7])
    frame = turn.as_matrix()  # columns: row, across, axis
    origin = np.array([0.11, 0.23, -0.31])
    row = 3.0 * frame[:, 0] + 0.4 * frame[:, 2]  # only the part across the axis counts
    grains = packing(0.5, Sphere(2.2, origin), axis=7.0 * frame[:, 2], origin=origin, row=row)
    assert_same_points(grains.x, origin + turn.apply(cell_sites(packing, 0.5, 2.2)), within=1e-14)


@lattice
@pytest.mark.parametrize(("axis", "order"), [("x", [2, 0, 1]), ("y", [1, 2, 0]), ("z", [0, 1, 2])])
def test_a_letter_turns_a_lattice_without_round_off(packing: Callable, axis: str, order: list[int]) -> None:
    upright, turned = packing(0.7, Sphere(4.0)), packing(0.7, Sphere(4.0), axis=axis)
    np.testing.assert_array_equal(turned.x, upright.x[:, order])
    vector = np.eye(3)["xyz".index(axis)]
    np.testing.assert_array_equal(packing(0.7, Sphere(4.0), axis=2.0 * vector).x, turned.x)
    np.testing.assert_array_equal(packing(0.7, Sphere(4.0), axis=axis, row="yzx"["xyz".index(axis)]).x, turned.x)


@lattice
@pytest.mark.parametrize("axis", ["z", AXIS])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (3e4, -2e5, 1e6)])
def test_neighbours_are_one_diameter_apart_to_round_off(
    packing: Callable, axis: ArrayLike, centre: tuple[float, float, float]
) -> None:
    d, expected = 0.3, CELLS[packing][2]
    grains = packing(d, Sphere(2.5, centre), axis=axis)
    tree = cKDTree(grains.x)
    i, j = tree.query_pairs(1.2 * d, output_type="ndarray").T
    distances = np.linalg.norm(grains.x[j] - grains.x[i], axis=1)
    assert np.max(np.abs(distances - d)) <= 4.0 * np.spacing(max(5.0, np.max(np.abs(centre))))
    interior = np.linalg.norm(grains.x - np.array(centre), axis=1) < 2.5 - 1.01 * d
    assert interior.sum() > 500
    neighbours = np.bincount(np.concatenate([i, j]), minlength=len(grains))
    np.testing.assert_array_equal(neighbours[interior], expected)


def test_a_row_almost_along_the_axis_leaves_the_lattice_exact() -> None:
    c, across = np.array([2.0, 3.0, 6.0]) / 7.0, np.array([3.0, -2.0, 0.0])
    grains = sc(1.0, Sphere(3.0), axis=c, row=c + 1e-5 * across)
    distances = cKDTree(grains.x).query(grains.x, k=[2])[0]
    np.testing.assert_allclose(distances, 1.0, rtol=1e-14)
    diagonals = cKDTree(grains.x).query(np.zeros(3), k=list(range(8, 20)))[0]
    np.testing.assert_allclose(diagonals, sqrt(2.0), rtol=1e-14)


@lattice
def test_the_share_of_space_filled(packing: Callable[..., Particles]) -> None:
    grains = packing(0.05, Sphere(2.0, (0.3, 0.1, -0.2)), axis=AXIS)
    filled = len(grains) * 0.025**3 / 2.0**3
    assert filled == pytest.approx(CELLS[packing][3], rel=1e-3)


def test_layers_of_hcp_are_stacked_along_the_axis() -> None:
    height = 10.0 * sqrt(2.0 / 3.0)  # the last layer lies on the face
    axis = np.array(AXIS) / np.linalg.norm(AXIS)
    grains = hcp(1.0, Cylinder(4.2, height, axis=AXIS), axis=AXIS)
    along = grains.x @ axis
    layers = np.rint(along / sqrt(2.0 / 3.0))
    np.testing.assert_allclose(along, layers * sqrt(2.0 / 3.0), atol=1e-13)
    np.testing.assert_array_equal(np.unique(layers), np.arange(11.0))
    first, third = (grains.x[layers == k] - k * sqrt(2.0 / 3.0) * axis for k in (0, 2))
    assert_same_points(first, third, within=1e-13)  # ABAB


def test_fcc_has_its_cube_along_the_axes() -> None:
    edge = 0.4 * sqrt(2.0)
    grains = fcc(0.4, Box((0, 3 * edge), (0, 3 * edge), (0, 3 * edge)))
    assert len(grains) == 4**3 + 3 * 3 * 3 * 4  # corners, and the faces of 27 cells
    halves = grains.x / (edge / 2.0)
    np.testing.assert_allclose(halves, np.rint(halves), atol=1e-13)
    np.testing.assert_array_equal(np.rint(halves).sum(axis=1) % 2, 0.0)


@pytest.mark.parametrize("start", [0.0, 0.3, -7.7, 1e4, 3e7 + 0.37])
def test_sites_on_the_faces_of_a_box_are_inside(start: float) -> None:
    box = Box(*[(start, start + 1.0)] * 3)
    assert len(sc(0.1, box, origin=[start] * 3)) == 11**3  # 10 * 0.1 is not 1 in every double
    assert len(sc(0.1, Box(x=(start, None)) & box, origin=[start + 0.3] * 3)) == 11**3
    assert len(sc(0.1, box - Box(x=(None, start)), origin=[start] * 3)) == 10 * 11**2


@pytest.mark.parametrize("base", [(0.2, 0.3, 0.1), (3e7, -1e7, 2e7)])
def test_layers_on_the_faces_of_a_tilted_cylinder_are_inside(base: tuple[float, float, float]) -> None:
    height = 10.0 * 0.1 * sqrt(2.0 / 3.0)
    grains = hcp(0.1, Cylinder(0.42, height, AXIS, base), axis=AXIS, origin=base)
    assert len(grains) == 6 * 61 + 5 * 69  # points of a triangular lattice within 4.2 of a site, of a hole


def test_the_tolerance_of_a_large_shape_reaches_beyond_its_bounds() -> None:
    for limits in ((0.0, 1e4 - 5e-6), (5e-6, 1e4)):
        assert len(sc(1.0, Box(limits, (0, 0), (0, 0)))) == 10001


@lattice
def test_endless_shapes_may_be_cut_to_an_end(packing: Callable[..., Particles]) -> None:
    endless, slab = Cylinder(3.0, None), Box(z=(-1.0, 4.0))
    larger = packing(0.5, Sphere(6.0), axis=AXIS)
    np.testing.assert_array_equal(packing(0.5, endless & slab, axis=AXIS).x, larger.cut(endless & slab).x)


@lattice
@pytest.mark.parametrize("axis", ["z", AXIS])
def test_spheres_come_layer_by_layer_and_row_by_row(packing: Callable, axis: ArrayLike) -> None:
    grains, again = (packing(0.5, Sphere(3.0), axis=axis, row=(1.0, 0.2, 0.1)) for _ in range(2))
    np.testing.assert_array_equal(grains.x, again.x)
    c = np.array([0.0, 0.0, 1.0]) if axis == "z" else np.array(AXIS) / np.linalg.norm(AXIS)
    a = np.array([1.0, 0.2, 0.1])
    a = (a - (a @ c) * c) / np.linalg.norm(a - (a @ c) * c)
    place = [tuple(np.round(row, 6)) for row in grains.x @ np.stack([c, np.cross(c, a), a], axis=1)]
    assert place == sorted(place)


class Counted(Shape):
    """A shape of a user's own that counts how many points it was asked about."""

    def __init__(self, shape: Shape) -> None:
        self.shape, self.asked = shape, 0

    def gap(self, x: Floats) -> Floats:
        self.asked += len(x)
        return self.shape.gap(x)

    def extent(self, direction: Floats) -> tuple[float, float]:
        return self.shape.extent(direction)


@pytest.mark.parametrize(
    ("shape", "most"),
    [
        (Sphere(20.0), 2.0),
        (Cylinder(4.0, 400.0, axis=(1, 1, 1)), 6.0),  # the box around it is 700 times as large
        (Sphere(200.0) & Sphere(20.0, (180.0, 0.0, 0.0)), 2.0),
    ],
)
def test_few_points_are_looked_at_in_vain(shape: Shape, most: float) -> None:
    counted = Counted(shape)
    grains = hcp(1.0, counted)
    assert len(grains) > 10000
    assert counted.asked < most * len(grains)


length = st.floats(0.5, 4.0)
place = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
body = st.one_of(
    st.builds(lambda s, p: Box(*[(c - h, c + h) for c, h in zip(p, s, strict=True)]), st.tuples(*[length] * 3), place),
    st.builds(Cylinder, length, length, st.sampled_from("xyz") | place.filter(any), place),
    st.builds(Sphere, length, place),
)
joined = st.builds(
    lambda a, b, how: how(a, b), body, body, st.sampled_from([Shape.__or__, Shape.__and__, Shape.__sub__])
)


@settings(deadline=None, max_examples=60)
@given(st.sampled_from(list(CELLS)), body | joined, st.sampled_from("xyz") | place.filter(any), place)
def test_a_packing_in_a_shape_is_the_part_of_a_larger_one(
    packing: Callable[..., Particles], inside: Shape, axis: ArrayLike, origin: tuple[float, float, float]
) -> None:
    larger = packing(0.8, Box(*[(-8.0, 8.0)] * 3), axis=axis, origin=origin)
    if not inside.contains(larger.x).any():
        with pytest.raises(InputError, match="has no sphere"):
            packing(0.8, inside, axis=axis, origin=origin)
    else:
        np.testing.assert_array_equal(packing(0.8, inside, axis=axis, origin=origin).x, larger.cut(inside).x)


# Dressler & Wilke (2021): spheres, bonds (pairs closer than 1.05 d) and interface bonds of their pull-out samples. The
# free length, a by-product of their generator, sets where the fibre ends.
@pytest.mark.parametrize(
    ("d", "free", "spheres", "bonds", "interface"),
    [(1.0, 13.2, 5576, 29943, 960), (0.7, 8.5, 16670, 93063, 1431), (0.5, 5.45, 44863, 255918, 3501)],
)
def test_the_published_pullout_sample(d: float, free: float, spheres: int, bonds: int, interface: int) -> None:
    hole = Cylinder(1.0, None, axis="x") & Box(x=(5.0 - 1.5 * d, None))
    matrix = hcp(d, Cylinder(6.0, 35.0, axis="x") - hole, axis="x")
    fibre = hcp(d, Cylinder(1.0, 30.0 + free, axis="x", base=(5.0, 0.0, 0.0)), axis="x")
    both = matrix + fibre
    pairs = cKDTree(both.x).query_pairs(1.05 * d, output_type="ndarray")
    assert len(both) == spheres
    assert len(pairs) == bonds
    assert np.count_nonzero(np.sum(pairs < len(matrix), axis=1) == 1) == interface


# ---------------------------------------------------------------------------------------------------------------- line
def test_a_line_runs_from_its_start() -> None:
    beads = line(5, 0.25, direction=(0.0, 3.0, 4.0), start=(1.0, 2.0, 3.0))
    np.testing.assert_allclose(beads.x, [[1.0, 2.0 + 0.15 * k, 3.0 + 0.2 * k] for k in range(5)], rtol=1e-15)
    np.testing.assert_array_equal(beads.radius, 0.125)
    np.testing.assert_array_equal(line(3, 2.0, "z").x, [[0, 0, 0], [0, 0, 2], [0, 0, 4]])
    np.testing.assert_array_equal(line(2, 2.0, diameter=1.0).radius, 0.5)
    assert len(line(1, 1.0)) == 1


@pytest.mark.parametrize("start", [0.0, 1e6])
def test_the_spacing_of_a_line_is_exact(start: float) -> None:
    beads = line(10001, 0.1, direction=(1.0, -2.0, 0.5), start=(start, 0.0, 0.0))
    steps = np.linalg.norm(np.diff(beads.x, axis=0), axis=1)
    assert np.max(np.abs(steps - 0.1)) <= 2.0 * np.spacing(start + 1000.0)
    span = np.linalg.norm(beads.x[-1] - beads.x[0])
    assert abs(span - 1000.0) <= 2.0 * np.spacing(start + 1000.0)  # errors do not add up


# ----------------------------------------------------------------------------------------------------------- particles
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64, np.uint8, ">f8"])
def test_particles_take_over_their_values_exactly(dtype: object) -> None:
    x = np.arange(12).reshape(4, 3).astype(dtype)
    for layout in (x, np.asfortranarray(x), np.repeat(x, 2, axis=0)[::2], x.tolist()):
        grains = Particles(layout, x[:, 1])
        assert grains.x.dtype == grains.radius.dtype == np.float64
        np.testing.assert_array_equal(grains.x, np.arange(12.0).reshape(4, 3))
        np.testing.assert_array_equal(grains.radius, [1.0, 4.0, 7.0, 10.0])


def test_particles_are_copies_that_cannot_be_changed() -> None:
    x, radius = np.zeros((2, 3)), np.ones(2)
    x.flags.writeable = False
    grains = Particles(x, radius)
    radius[0] = 9.0
    np.testing.assert_array_equal(grains.radius, [1.0, 1.0])
    with pytest.raises(ValueError, match="read-only"):
        grains.x[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        grains.radius = radius


def test_particles_add_up_in_order() -> None:
    a, b = Particles([[0, 0, 0], [1, 0, 0]], 0.5), Particles([[5, 0, 0]], [0.25])
    both = a + b
    assert (len(a), len(b), len(both)) == (2, 1, 3)
    np.testing.assert_array_equal(both.x, [[0, 0, 0], [1, 0, 0], [5, 0, 0]])
    np.testing.assert_array_equal(both.radius, [0.5, 0.5, 0.25])
    assert repr(a) == "<Particles: 2, radius 0.5 m>"
    assert repr(both) == "<Particles: 3, radius 0.25 to 0.5 m>"
    with pytest.raises(TypeError, match="unsupported operand"):
        a + 1.0


def test_particles_can_be_cut_moved_and_turned() -> None:
    grains = Particles([[0, 0, 0], [1, 0, 0], [2.0 + 1e-10, 0, 0], [3, 0, 0]], [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_array_equal(
        grains.cut(Box(x=(None, 2))).radius, [0.1, 0.2, 0.3]
    )  # 1e-10 is round-off for this radius
    np.testing.assert_array_equal(grains.moved((0, 2, 0)).x, grains.x + np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(grains.turned("z", pi / 2.0, about=(1, 0, 0)).x[3], [1.0, 2.0, 0.0], atol=1e-15)
    vector = np.array([0.3, -0.4, 1.2])
    expected = Rotation.from_rotvec(2.5 * vector / np.linalg.norm(vector)).apply(grains.x.copy())
    np.testing.assert_allclose(grains.turned(vector, 2.5).x, expected, atol=1e-15)
    np.testing.assert_array_equal(grains.turned(vector, 2.5).radius, grains.radius)


# ----------------------------------------------------------------------------------------------------------- bad input
TWO = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
BALL = Sphere(2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Particles([[0, 0, 0], [0, np.nan, np.inf]], 1), r"^x of Particles\[1, 1\] is nan, .* \(2 such values"),
        (lambda: Particles(TWO, [1.0, np.inf]), r"^radius of Particles\[1\] is inf, not finite\.$"),
        (lambda: Particles(TWO, [1.0, 0.0]), r"^radius of Particles\[1\] is 0.0 m; it must be positive\.$"),
        (lambda: Particles(TWO, [-1.0, -2.0]), r"^radius of Particles\[0\] is -1.0 m; .* \(2 such values in all\)\.$"),
        (lambda: Particles(TWO, [1.0, 5e-324]), r"^radius of Particles\[1\] is 5e-324 m; .* smallest normal double"),
        (lambda: Particles(TWO, 0.0), r"^radius of Particles is 0.0 m; it must be positive\.$"),
        (lambda: Particles(TWO, None), r"^radius of Particles is None; it must be a number in m\.$"),
        (lambda: Particles(TWO, [1.0, 1.0, 1.0]), r"^Particles got 2 centres and 3 radii; give one radius each\.$"),
        (lambda: Particles(TWO, [1.0]), r"^Particles got 2 centres and 1 radii"),
        (lambda: Particles(np.ones((3, 2)), 1), r"^x of Particles has shape \(3, 2\); it must be \(n, 3\)\.$"),
        (lambda: Particles(TWO, np.ones((2, 1))), r"^radius of Particles has shape \(2, 1\); it must be \(n,\)\.$"),
        (lambda: Particles(np.array(TWO, dtype=object), 1), r"^x of Particles has dtype object; it must hold real"),
        (lambda: Particles(TWO, np.ma.array([1.0, 1.0], mask=[0, 1])), r"^radius of Particles is a masked array"),
        (lambda: Particles(np.empty((0, 3)), []), r"^x of Particles is empty; give at least one particle\.$"),
        (lambda: Particles(TWO, 1).moved((0, 0, np.nan)), r"^by of moved\[2\] is nan"),
        (lambda: Particles(TWO, 1).moved(1.0), r"^by of moved has shape \(\); it must be \(3,\)\.$"),
        (lambda: Particles(TWO, 1).turned((0, 0, 0), 1.0), r"^axis of turned is the zero vector"),
        (lambda: Particles(TWO, 1).turned("z", np.inf), r"^angle of turned is inf rad; it must be finite\.$"),
        (lambda: Particles(TWO, 1).cut(Sphere(1, (9, 9, 9))), r"^No centre of the 2 particles lies inside Sphere"),
        (lambda: Particles(TWO, 1).cut("all"), r"^inside of cut is 'all'; it must be a shape such as Box"),
        (lambda: line(0, 1.0), r"^count of line is 0; it must be at least 1\.$"),
        (lambda: line(2.5, 1.0), r"^count of line is 2.5; it must be a whole number"),
        (lambda: line(2, -1.0), r"^spacing of line is -1.0 m; it must be positive\.$"),
        (lambda: line(2, 1.0, "u"), r"^direction of line is 'u'; it must be one of 'x', 'y', 'z'\.$"),
        (lambda: line(2, 1.0, diameter=0), r"^diameter of line is 0.0 m"),
        (
            lambda: line(2, 1e-3, start=(0, 1e12, 0)),
            r"^spacing of line is 0.001 m, too small for coordinates up to 1e\+12",
        ),
        (
            lambda: line(2, 1e308, start=(1e308, 0, 0)),
            r"^spacing of line is 1e\+308 m, too small for coordinates up to inf",
        ),
    ],
)
def test_bad_particles_and_lines_are_named(make: Callable, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


@lattice
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"diameter": 0.0}, r"^diameter of \w+ is 0.0 m; it must be positive\.$"),
        ({"diameter": np.nan}, r"^diameter of \w+ is nan m; it must be finite\.$"),
        ({"inside": 3.0}, r"^inside of \w+ is 3.0; it must be a shape such as Box, Cylinder or Sphere\.$"),
        ({"inside": Box(x=(0, 1), z=(0, 1))}, r"^inside of \w+ has no end along y; cut it with a Box"),
        ({"inside": Cylinder(1.0, None)}, r"^inside of \w+ has no end along z"),
        ({"inside": Sphere(0.1, (0.5, 0.4, 0.3))}, r"^\w+ has no sphere of diameter 1 m .* enlarge the shape or move"),
        ({"inside": BALL & Box(z=(3, 4))}, r"^\w+ has no sphere of diameter 1 m centred inside Intersection"),
        ({"inside": Box(z=(0, 1)) & Box(z=(3, 4))}, r"^\w+ has no sphere of diameter 1 m centred inside Intersection"),
        ({"inside": BALL - BALL}, r"^\w+ has no sphere of diameter 1 m centred inside Difference"),
        ({"diameter": 1e-3, "inside": Sphere(5.0)}, r"^\w+ would have more than 1e\+08 spheres .* both in metres\.$"),
        ({"inside": Sphere(3.0, (1e12, 0, 0))}, r"^diameter of \w+ is 1 m, too small for coordinates up to 1e\+12 m"),
        ({"origin": (1e12, 0, 0)}, r"^diameter of \w+ is 1 m, too small for coordinates up to 1e\+12 m"),
        ({"origin": (0, np.inf, 0)}, r"^origin of \w+\[1\] is inf, not finite\.$"),
        ({"axis": "c"}, r"^axis of \w+ is 'c'; it must be one of 'x', 'y', 'z'\.$"),
        ({"axis": (0, 0, 0)}, r"^axis of \w+ is the zero vector"),
        ({"axis": "y", "row": (0, -2, 0)}, r"^row of \w+ is along the axis; it must have a part across it\.$"),
    ],
)
def test_bad_lattices_are_named(packing: Callable, arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        packing(**{"diameter": 1.0, "inside": BALL, **arguments})
