"""Elastic constants of lattices against sums over the bonds of a periodic cell whose spheres shift and turn freely."""

from itertools import product

import numpy as np
import pytest
from numpy import sqrt

from pybondem.errors import InputError
from pybondem.theory import ElasticConstants, calibrate, elastic_constants, volume_per_sphere

D = 0.7  # diameter of the spheres [m]

# Edges of a box that repeats, and the spheres in it, in diameters.
CELLS = {
    "sc": ((1, 1, 1), [(0, 0, 0)]),
    "fcc": (
        (sqrt(2), sqrt(2), sqrt(2)),
        sqrt(2) * np.array([(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)]),
    ),
    "hcp": (
        (1, sqrt(3), sqrt(8 / 3)),
        [
            (0, 0, 0),
            (1 / 2, sqrt(3) / 2, 0),
            (1 / 2, sqrt(3) / 6, sqrt(2 / 3)),
            (0, 2 * sqrt(3) / 3, sqrt(2 / 3)),
        ],
    ),
}
NEIGHBOURS = {"sc": 6, "fcc": 12, "hcp": 12}


def bonds(lattice):
    """Every bond of the cell from both its ends: sphere i, sphere j, unit vector from i to j."""
    edges, spheres = (np.array(a, dtype=float) for a in CELLS[lattice])
    for i, j in product(range(len(spheres)), repeat=2):
        for image in product((-1, 0, 1), repeat=3):
            apart = spheres[j] + image * edges - spheres[i]
            if abs(np.linalg.norm(apart) - 1.0) < 1e-9:
                yield i, j, apart


def strain(voigt):
    e11, e22, e33, g23, g13, g12 = voigt
    return np.array([[e11, g12 / 2, g13 / 2], [g12 / 2, e22, g23 / 2], [g13 / 2, g23 / 2, e33]])


def summed_constants(lattice, kn, ks):
    """Return C (6, 6): energy per volume of all bonds, least over shifts and turns of the spheres in the cell."""
    edges, spheres = CELLS[lattice]
    n = len(spheres)
    energy, count = np.zeros((6 + 6 * n, 6 + 6 * n)), 0
    for i, j, normal in bonds(lattice):
        count += 1
        stretch = np.zeros((3, 6 + 6 * n))  # u_j - u_i - (d/2)(th_i + th_j) x n, per unit of each unknown
        stretch[:, :6] = np.column_stack([strain(unit) @ normal * D for unit in np.eye(6)])
        shift = 6 + np.arange(3)
        stretch[:, shift + 3 * i] -= np.eye(3)
        stretch[:, shift + 3 * j] += np.eye(3)
        for sphere in (i, j):
            turned = np.column_stack([np.cross(axis, normal) for axis in np.eye(3)])
            stretch[:, shift + 3 * n + 3 * sphere] -= D / 2 * turned
        along = np.outer(normal, normal)
        energy += 0.5 * stretch.T @ (kn * along + ks * (np.eye(3) - along)) @ stretch  # half: each bond comes twice
    assert count == n * NEIGHBOURS[lattice]
    inner = energy[6:, 6:]
    relaxed = energy[:6, :6] - energy[:6, 6:] @ np.linalg.pinv(inner, rcond=1e-12) @ energy[6:, :6]
    return relaxed / (np.prod(edges) * D**3)


def random_stiffnesses(seed, n=8):
    rng = np.random.default_rng(seed)
    yield from zip(10 ** rng.uniform(3, 9, n), 10 ** rng.uniform(-3, 0.5, n), strict=True)


@pytest.mark.parametrize("lattice", CELLS)
def test_constants_are_those_of_the_relaxed_sum_over_bonds(lattice):
    for kn, ratio in random_stiffnesses(1):
        ours = elastic_constants(lattice, kn, ratio * kn, D)
        np.testing.assert_allclose(
            ours.stiffness, summed_constants(lattice, kn, ratio * kn), rtol=0, atol=1e-12 * kn / D
        )


@pytest.mark.parametrize("lattice", CELLS)
def test_volume_per_sphere_is_the_cell_shared_out(lattice):
    edges, spheres = CELLS[lattice]
    assert volume_per_sphere(lattice, D) == pytest.approx(np.prod(edges) * D**3 / len(spheres), rel=1e-14)


def strain_under_pull(lattice, kn, ks, along):
    """Strain (3, 3) under unit uniaxial stress along a unit vector, from the summed constants."""
    pull = np.outer(along, along)
    return strain(np.linalg.solve(summed_constants(lattice, kn, ks), pull[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]))


@pytest.mark.parametrize(
    ("lattice", "along", "vector", "across"),
    [
        ("sc", "100", (1, 0, 0), (0, 1, 0)),
        ("sc", "110", (1, 1, 0), (0, 0, 1)),
        ("sc", "111", (1, 1, 1), (1, -1, 0)),
        ("fcc", "100", (1, 0, 0), (0, 0, 1)),
        ("fcc", "110", (1, 1, 0), (1, -1, 0)),
        ("fcc", "110", (1, 1, 0), (0, 0, 1)),
        ("fcc", "111", (1, 1, 1), (1, 1, -2)),
        ("fcc", "row", (0, 1, 1), (1, 0, 0)),
        ("hcp", "c", (0, 0, 1), (1, 0, 0)),
        ("hcp", "row", (1, 0, 0), (0, 1, 0)),
        ("hcp", "row", (1, 0, 0), (0, 0, 1)),
        ("hcp", (0.3, -0.2, 0.9), (0.3, -0.2, 0.9), (2, 3, 0)),
    ],
)
def test_moduli_along_directions_are_those_of_the_summed_lattice(lattice, along, vector, across):
    n, m = (np.array(v) / np.linalg.norm(v) for v in (vector, across))
    for kn, ratio in random_stiffnesses(2, 4):
        e = strain_under_pull(lattice, kn, ratio * kn, n)
        ours = elastic_constants(lattice, kn, ratio * kn, D)
        assert ours.young(along) == pytest.approx(1 / (n @ e @ n), rel=1e-8)
        across_n = np.cross(n, m)
        both = [-(v @ e @ v) / (n @ e @ n) for v in (m, across_n)]
        assert ours.poisson(along) == pytest.approx(np.mean(both), abs=1e-9)
        direction = vector if along == "row" else along
        assert ours.poisson(direction, tuple(m)) == pytest.approx(both[0], abs=1e-9)


def test_moduli_in_closed_form():
    for kn, ratio in random_stiffnesses(3):
        ks = ratio * kn
        hcp, fcc = elastic_constants("hcp", kn, ks, D), elastic_constants("fcc", kn, ks, D)
        Q = 3 * kn**2 + 22 * kn * ks + 23 * ks**2
        S = 18 * kn**3 + 119 * kn**2 * ks + 128 * kn * ks**2 + 23 * ks**3
        along_c = 6 * sqrt(2) * kn * (kn + ks) / (D * (5 * kn + ks))
        assert (hcp.young("c"), fcc.young("111")) == pytest.approx((along_c, along_c), rel=1e-12)
        assert hcp.young() == hcp.young("c")
        nu_c = (kn - ks) / (5 * kn + ks)
        assert (hcp.poisson(), fcc.poisson("111")) == pytest.approx((nu_c, nu_c), abs=1e-12)
        assert hcp.young("row") == pytest.approx(6 * sqrt(2) * kn * (kn + ks) * Q / (D * S), rel=1e-12)
        in_layer = (kn - ks) * (6 * kn**2 + 31 * kn * ks + 23 * ks**2) / S
        assert hcp.poisson("row", (0, 1, 0)) == pytest.approx(in_layer, abs=1e-12)
        assert hcp.poisson("row", "c") == pytest.approx((kn - ks) * Q / S, abs=1e-12)
        E100 = 2 * sqrt(2) * kn * (kn + 3 * ks) / (D * (3 * kn + ks))
        assert fcc.young("100") == pytest.approx(E100, rel=1e-12)
        assert fcc.poisson() == pytest.approx((kn - ks) / (3 * kn + ks), abs=1e-12)
        E110 = 2 * sqrt(2) * kn * (kn + ks) * (kn + 3 * ks) / (D * (2 * kn**2 + 5 * kn * ks + ks**2))
        assert fcc.young("110") == pytest.approx(E110, rel=1e-12)
        bulk = 2 * sqrt(2) * kn / (3 * D)
        assert (hcp.bulk, fcc.bulk) == pytest.approx((bulk, bulk), rel=1e-12)
        assert elastic_constants("sc", kn, ks, D).bulk == pytest.approx(kn / (3 * D), rel=1e-12)


def test_known_constants_of_central_forces():
    hcp = elastic_constants("hcp", 24.0 / sqrt(2), 0.0, 1.0)
    hexagonal = [hcp.C11, hcp.C12, hcp.C13, hcp.C33, hcp.C44]
    assert hexagonal == pytest.approx([29, 11, 8, 32, 8], rel=1e-14)
    fcc = elastic_constants("fcc", 1.0, 0.0, 1.0)
    cubic = [fcc.C11, fcc.C12, fcc.C44]
    assert cubic == pytest.approx([sqrt(2), sqrt(1 / 2), sqrt(1 / 2)], rel=1e-14)  # C12 = C44, Cauchy's relation


def test_a_worked_example():
    kn, ks, d = 5.026548e6, 2.261947e6, 0.01  # bonds of 4 mm radius, E 1 GPa, G 0.45 GPa
    sc, fcc = elastic_constants("sc", kn, ks, d), elastic_constants("fcc", kn, ks, d)
    cubic = [(of.C11, of.C12, of.C44) for of in (sc, fcc)]
    assert cubic[0] == pytest.approx((0.5026548e9, 0.0, 0.1130973e9), rel=1e-6)
    assert cubic[1] == pytest.approx((1.030749e9, 0.1954868e9, 0.5153744e9), rel=1e-6)
    assert fcc.young("100") == pytest.approx(0.9684197e9, rel=1e-6)


@pytest.mark.parametrize(
    ("lattice", "lowest", "highest"),
    [("hcp", -0.9, 1 / 5), ("fcc", -0.9, 1 / 3), ("sc", 0.0, 0.0)],
)
def test_calibrated_lattice_has_the_wanted_modulus_and_ratio(lattice, lowest, highest):
    along = np.array((0.0, 0.0, 1.0))
    for nu in np.linspace(lowest, highest, 7):
        kn, ks = calibrate(lattice, 7.3e9, float(nu), D)
        assert ks >= 0.0
        e = strain_under_pull(lattice, kn, ks, along)
        assert 1 / e[2, 2] == pytest.approx(7.3e9, rel=1e-9)
        assert [-e[0, 0] / e[2, 2], -e[1, 1] / e[2, 2]] == pytest.approx([nu, nu], abs=1e-9)
    assert ks == pytest.approx(0.0 if highest > 0.0 else kn, abs=1e-12 * kn)


@pytest.mark.parametrize("lattice", CELLS)
def test_at_nu_zero_every_lattice_is_isotropic(lattice):
    C = summed_constants(lattice, *calibrate(lattice, 3e9, 0.0, D))
    np.testing.assert_allclose(C, np.diag([3e9, 3e9, 3e9, 1.5e9, 1.5e9, 1.5e9]), rtol=0, atol=1.0)


def test_axial_shear_modulus_of_hcp_against_the_isotropic_one():
    for nu, share in ((0.2, 2 / 3), (0.0, 1.0)):
        kn, ks = calibrate("hcp", 1e9, nu, D)
        assert share == pytest.approx(2 * (kn + 2 * ks) / (3 * (kn + ks)), rel=1e-12)
        summed, ours = summed_constants("hcp", kn, ks)[3, 3], elastic_constants("hcp", kn, ks, D).C44
        assert ours == pytest.approx(summed, rel=1e-12)
        assert summed / (1e9 / (2 * (1 + nu))) == pytest.approx(share, rel=1e-12)


@pytest.mark.parametrize(
    ("lattice", "nu", "reach"), [("hcp", 0.21, "0.2"), ("fcc", 0.34, "0.333333"), ("sc", 0.1, "0")]
)
def test_a_ratio_out_of_reach_is_refused_with_the_reach_of_the_lattice(lattice, nu, reach):
    with pytest.raises(InputError, match=rf"{lattice}.* reaches .*nu <?= {reach}"):
        calibrate(lattice, 1e9, nu, D)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), "1", None, True])
@pytest.mark.parametrize(
    "call",
    [
        lambda v: elastic_constants("hcp", v, 1.0, 1.0),
        lambda v: elastic_constants("hcp", 1.0, 1.0, v),
        lambda v: calibrate("hcp", v, 0.1, 1.0),
        lambda v: calibrate("fcc", 1e9, 0.1, v),
        lambda v: volume_per_sphere("sc", v),
    ],
)
def test_numbers_that_are_not_positive_are_refused(call, bad):
    with pytest.raises(InputError):
        call(bad)


@pytest.mark.parametrize(
    "call",
    [
        lambda: elastic_constants("bcc", 1.0, 1.0, 1.0),
        lambda: calibrate("HCP", 1.0, 0.1, 1.0),
        lambda: volume_per_sphere("", 1.0),
        lambda: elastic_constants("hcp", 1.0, -0.1, 1.0),
        lambda: calibrate("hcp", 1e9, -1.0, 1.0),
        lambda: calibrate("fcc", 1e9, float("nan"), 1.0),
        lambda: elastic_constants("hcp", 1.0, 1.0, 1.0).young("100"),
        lambda: elastic_constants("fcc", 1.0, 1.0, 1.0).young((0, 0, 0)),
        lambda: elastic_constants("fcc", 1.0, 1.0, 1.0).young((1, 0)),
        lambda: elastic_constants("fcc", 1.0, 1.0, 1.0).poisson("100", "110"),
        lambda: elastic_constants("sc", 1.0, 0.0, 1.0).young(),
    ],
)
def test_questions_without_an_answer_are_refused(call):
    with pytest.raises(InputError):
        call()


def test_stiffness_matrix_is_laid_out_as_said():
    C = ElasticConstants("hcp", C11=1.0, C12=2.0, C13=3.0, C33=4.0, C44=5.0, C66=6.0).stiffness
    expected = np.diag([1.0, 1, 4, 5, 5, 6])
    expected[:3, :3] = [[1, 2, 3], [2, 1, 3], [3, 3, 4]]
    np.testing.assert_array_equal(C, expected)
