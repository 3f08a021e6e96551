"""The pull-out example: what is built, against geometry and a direct solve of the lattice; what comes out, against the
one-dimensional solution (itself held against separate numerics in tests/oracles) and the energy that debonding takes.
"""

import contextlib
import io
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from examples.result_folder import pictures, read_columns, read_series, read_summary
from numpy.typing import NDArray
from oracles.lattice_statics import Lattice, held, hexagonal_springs
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import pybondem as bd
from pybondem.errors import InputError
from pybondem.examples import PullOutTest, pullout
from pybondem.examples.pullout_result import PullOutResult, run_pullout
from pybondem.examples.pullout_setup import PullOutModel
from pybondem.theory import PullOut

Floats = NDArray[np.float64]
SMALL: dict[str, Any] = {"diameter": 0.8, "matrix_radius": 3.0, "length": 10.0}
FRACTURE_ENERGY = 6e7 * 1e-4 * 4e-4 / 2.0  # G_f of the default interface [J/m2]


def axis_of(built: PullOutModel) -> int:
    return "xyz".index(built.test.axis)


def along(built: PullOutModel, name: str) -> Floats:
    """Return the places along the axis of the particles of a part [m]."""
    return np.asarray(built.model.x[built.model.part(name).indices, axis_of(built)])


def across(built: PullOutModel, name: str) -> Floats:
    """Return the distances from the axis of the particles of a part [m]."""
    return np.linalg.norm(np.delete(built.model.x[built.model.part(name).indices], axis_of(built), axis=1), axis=1)


def bonded_lattice(built: PullOutModel, parts: tuple[str, ...] = ("fibre", "matrix")) -> Lattice:
    """Return the bonds of parts as they are, for a direct solve; fails unless scaled from the closed form."""
    test, lattice = built.test, Lattice(built.model.x)
    for name, E, bonds in zip(("fibre", "matrix"), (test.E_fibre, test.E_matrix), built.model.bonds[:2], strict=True):
        assert isinstance(bonds.bond, bd.Bond)
        k = bonds.bond.elastic.stiffness(0.5 * test.fitted_diameter, test.fitted_diameter)
        closed = hexagonal_springs(E, test.nu, test.fitted_diameter)
        assert tuple(k) == pytest.approx((*(built.scales[name] * c for c in closed), 0.0, 0.0), rel=1e-12)
        if name in parts:
            lattice.bond(bonds.pairs, k.kn, k.ks)
    return lattice


def shear_of(vectors: Floats, built: PullOutModel) -> Floats:
    """Return the size of what lies across the normals of the joints, of vectors (joints, 3)."""
    normal = built.surface.normal
    return np.asarray(np.linalg.norm(vectors - (vectors * normal).sum(axis=1)[:, None] * normal, axis=1))


def elastic_answer(built: PullOutModel, pull: float) -> tuple[float, Floats]:
    """Return load [N] and interface stress (joints,) [Pa] at an end displacement [m] by a direct solve."""
    test, joints, k = built.test, built.joints, built.test.interface.stiffness
    assert k is not None
    area, normal = built.surface.area, built.surface.normal
    lattice = bonded_lattice(built).join(joints.pairs, normal, k * area, k * area)
    end, beside = built.pulled.indices, " ".join(a for a in "xyz" if a != test.axis)
    supports = held(built.face.indices, "x y z") | held(end, beside) | held(end, test.axis, pull)
    u, force = lattice.solve(supports)
    i, j = joints.pairs.T
    turn = 0.5 * (u[i, 3:] + u[j, 3:])
    relative = u[j, :3] - u[i, :3] - np.cross(turn, built.model.x[j] - built.model.x[i])
    return float(force[end, axis_of(built)].sum()), k * shear_of(relative, built)


# What is built --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("diameter", [0.8, 0.6, 0.5])
def test_fibre_and_matrix_fill_their_cylinders(diameter: float) -> None:
    built = pullout(**SMALL | {"diameter": diameter}).build()
    d, (r, R, L) = built.test.fitted_diameter, (1.0, 3.0, 10.0)
    layer = (2.0 / 3.0) ** 0.5 * d
    assert d == pytest.approx(diameter, rel=0.05)
    for name, end in (("fibre", L + built.test.fitted_free_length), ("matrix", L)):
        assert along(built, name).min() == pytest.approx(0.0, abs=1e-12)
        assert along(built, name).max() == pytest.approx(end, rel=1e-12)
        levels = np.unique(np.round(along(built, name) / layer, 6))
        np.testing.assert_array_equal(levels, np.arange(round(end / layer) + 1))
    assert across(built, "fibre").max() <= r
    assert across(built, "fibre").min() == pytest.approx(0.0, abs=1e-12)
    assert r < across(built, "matrix").min() < r + d
    assert R - d < across(built, "matrix").max() <= R
    np.testing.assert_allclose(2.0 * built.model.radius, d, rtol=1e-14)


@pytest.mark.parametrize("diameter", [0.8, 0.5])
def test_each_part_is_one_piece_and_all_that_touch_are_bonded(diameter: float) -> None:
    built = pullout(**SMALL | {"diameter": diameter}).build()
    model, n = built.model, len(built.model)
    near = cKDTree(model.x).query_pairs(1.05 * built.test.fitted_diameter, output_type="ndarray")
    kind = model.part_of[near].sum(axis=1)  # fibre 0, matrix 1
    height = model.x[near, axis_of(built)][np.arange(len(near)), np.argmin(model.part_of[near], axis=1)]
    wanted = [near[kind == 0], near[kind == 2], near[(kind == 1) & (height <= 10.0 + 1e-9)]]
    for bonds, pairs in zip(model.bonds, wanted, strict=True):
        assert {frozenset(p) for p in bonds.pairs.tolist()} == {frozenset(p) for p in pairs.tolist()}
    for part in (0, 1):
        pairs = wanted[part]
        _, label = connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)), directed=False)
        assert len(set(label[model.part_of == part])) == 1


def test_the_free_length_is_the_same_for_every_diameter() -> None:
    for diameter in (1.2, 1.0, 0.8, 0.7, 0.5, 0.3):
        test = pullout(diameter=diameter)
        assert test.fitted_free_length == pytest.approx(2.0, abs=0.5 * diameter)  # to half a layer
        assert test.fitted_diameter == pytest.approx(diameter, rel=0.02)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_the_interface_is_a_cylinder(axis: str) -> None:
    built = pullout(**SMALL, axis=axis).build()
    x, (i, j) = built.model.x, built.joints.pairs.T
    assert np.all(built.model.part_of[i] == 0)
    assert np.all(built.model.part_of[j] == 1)
    assert built.joints.area is not None
    assert built.joints.normal is not None
    area, normal = built.surface.area, built.surface.normal
    np.testing.assert_array_equal(built.joints.pairs, built.surface.pairs)
    np.testing.assert_array_equal(built.joints.area, area)
    np.testing.assert_allclose(built.joints.normal, normal, atol=1e-15)
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(2.0 * pi * 1.0 * 10.0, rel=1e-12)
    height = x[i, axis_of(built)]
    layer = (2.0 / 3.0) ** 0.5 * built.test.fitted_diameter
    for level in np.unique(np.round(height, 9)):  # inner layers stand for a layer, the two at the ends for half of one
        share = area[np.abs(height - level) < 1e-6].sum() / (2.0 * pi * layer)
        assert share == pytest.approx(0.5 if level in (0.0, 10.0) else 1.0, rel=1e-5)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(normal[:, axis_of(built)], 0.0, atol=1e-14)
    middle = 0.5 * (x[i] + x[j])
    middle[:, axis_of(built)] = 0.0
    np.testing.assert_allclose(np.cross(middle, normal), 0.0, atol=1e-12)
    assert np.all((middle * normal).sum(axis=1) > 0.0)


def test_every_axis_gives_the_same_test_turned() -> None:
    first = pullout(**SMALL, axis="x").build()
    for axis, turn in (("y", [1, 2, 0]), ("z", [2, 0, 1])):
        other = pullout(**SMALL, axis=axis).build()
        np.testing.assert_allclose(other.model.x[:, turn], first.model.x, atol=1e-12)
        np.testing.assert_array_equal(other.model.part_of, first.model.part_of)
        for mine, theirs in zip(first.model.bonds, other.model.bonds, strict=True):
            np.testing.assert_array_equal(theirs.pairs, mine.pairs)
        np.testing.assert_allclose(other.surface.area, first.surface.area, rtol=1e-12)
        np.testing.assert_allclose(other.surface.normal[:, turn], first.surface.normal, atol=1e-12)
        assert other.scales == pytest.approx(first.scales, rel=1e-8)
        np.testing.assert_array_equal(other.face.indices, first.face.indices)
        np.testing.assert_array_equal(other.pulled.indices, first.pulled.indices)


def test_the_matrix_is_held_at_its_far_face_and_the_fibre_pulled_at_its_end() -> None:
    built = pullout(**SMALL, axis="y").build()
    y = built.model.x[:, 1]
    part = built.model.part_of
    np.testing.assert_array_equal(built.face.indices, np.flatnonzero((part == 1) & (y < 1e-9)))
    np.testing.assert_array_equal(built.pulled.indices, np.flatnonzero((part == 0) & (y > y.max() - 1e-9)))


@pytest.mark.parametrize(("E_fibre", "E_matrix", "nu"), [(1e10, 1e10, 0.1), (5e10, 5e9, 0.19), (2e10, 3e9, 0.0)])
def test_both_parts_have_their_nominal_stiffness(E_fibre: float, E_matrix: float, nu: float) -> None:
    built = pullout(**SMALL, E_fibre=E_fibre, E_matrix=E_matrix, nu=nu, axis="z").build()
    nominal = {"fibre": E_fibre * pi * 1.0**2, "matrix": E_matrix * pi * (3.0**2 - 1.0**2)}
    for name, EA in nominal.items():
        here = built.model.part(name).indices
        z = built.model.x[here, 2]
        low, high = here[z < 1e-9], here[z > z.max() - 1e-9]
        lattice = bonded_lattice(built, (name,))
        _, force = lattice.solve(held(low, "z") | held(high, "z", float(z.max())))  # a unit strain
        assert force[high, 2].sum() == pytest.approx(EA, rel=1e-8), name


# The elastic stage ----------------------------------------------------------------------------------------------


def test_the_elastic_stage_is_that_of_the_lattice(tmp_path: Path) -> None:
    test = pullout(**SMALL, axis="z", pull=1e-5, damping=0.5)
    built, result = test.build(), test.run(folder=tmp_path, quiet=True)
    assert result.displacement[-1] == pytest.approx(1e-5, rel=5e-3)
    load, stress = elastic_answer(built, float(result.displacement[-1]))
    assert result.load[-1] == pytest.approx(load, rel=2e-3)
    shown = read_series(tmp_path / "bonds.vtkhdf")
    tau = shear_of(shown.cell["force"][shown.cell["bond_set"] == 2], built) / built.surface.area
    np.testing.assert_allclose(tau, stress, atol=5e-3 * stress.max())
    assert result.summary["errors"].keys() == {"load up to the turning point"}  # no stage of softening is reached


def test_pulling_along_any_axis_takes_the_same_load() -> None:
    loads = {}
    for axis in "xyz":
        built = pullout(**SMALL, axis=axis, pull=1e-5, transits=3.0).build()
        # Without local damping: it goes by the sign of velocities, even of those that are nothing but round-off.
        sim = bd.Simulation(built.model, engine="reference", dt=1.2e-4)
        record = sim.record(every=10, load=bd.applied(built.pulled, axis))
        sim.run(time=built.test.duration, quiet=True)
        loads[axis] = record["load"].values
    assert loads["x"].max() > 1e3
    for axis in "yz":
        np.testing.assert_allclose(loads[axis], loads["x"], atol=1e-6 * loads["x"].max())


# The whole test, coarse -----------------------------------------------------------------------------------------


class Run(NamedTuple):
    """A finished pull-out: the model, what came out, what it printed, and the one-dimensional solution."""

    built: PullOutModel
    result: PullOutResult
    printed: str
    theory: PullOut
    summary: dict[str, Any]


def pulled_out(test: PullOutTest, folder: Path) -> Run:
    built = test.build()
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        result = run_pullout(built, "cpu", None, folder, False)
    free = along(built, "fibre").max() - test.length
    theory = PullOut(1e10, 1e10, 1.0, 6.0, 30.0, 6e7, 1e-4, 4e-4, extra_compliance=free / (1e10 * pi))
    return Run(built, result, printed.getvalue(), theory, read_summary(result.folder))


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The test with particles of 1 m: 5 000 of them."""
    return pulled_out(pullout(diameter=1.0), tmp_path_factory.mktemp("coarse"))


@pytest.fixture(scope="module")
def default(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The test as it is run without a word."""
    return pulled_out(pullout(), tmp_path_factory.mktemp("default"))


def curve_error(run: Run) -> float:
    """Return the largest difference of the load up to 99 % of the turning point, over the peak load."""
    u, load = run.result.displacement, run.result.load
    turn = run.theory.turning_point()
    assert turn is not None
    before = u <= 0.99 * turn.displacement
    assert before.sum() > 150
    exact = np.array([run.theory.state_at_displacement(float(v)).load for v in u[before]])
    return float(np.abs(load[before] - exact).max() / run.theory.peak().load)


def shear_errors(run: Run) -> list[float]:
    """Return the largest difference of the interface stress at each compared stage, over tau_max = 6 kPa."""
    errors = []
    for profile in run.result.profiles:
        assert len(profile.shear) == len(run.built.joints.pairs)
        state = run.theory.state_at_displacement(profile.displacement)
        assert state.zones == profile.zones
        errors.append(float(np.abs(profile.shear - state.shear(profile.height)).max() / 6e3))
    return errors


def check_against_theory(run: Run, curve: float, shear: float) -> None:
    assert run.result.load.max() == pytest.approx(run.theory.peak().load, rel=curve)
    assert curve_error(run) < curve
    assert [p.zones for p in run.result.profiles][:3] == ["E", "E", "ES"]
    assert run.result.profiles[-1].zones == "ESD"
    assert len(run.result.profiles) == 6
    assert max(shear_errors(run)) < shear


def check_energies(run: Run) -> None:
    columns, _ = read_columns(run.result.folder / "history.csv")
    joints = len(run.built.joints.pairs)
    assert run.summary["broken"] == columns["broken"][-1] == joints
    taken = 2.0 * pi * 1.0 * 30.0 * FRACTURE_ENERGY  # p L G_f
    assert run.summary["energy"]["damage"] == pytest.approx(taken, rel=5e-3)
    assert columns["energy_damage"][-1] == pytest.approx(taken, rel=5e-3)
    terms = [columns[f"energy_{n}"] for n in ("kinetic", "strain", "gravity", "damage", "dashpots", "drag")]
    assert np.abs(sum(terms) - columns["energy_work"]).max() < 1e-6 * columns["energy_work"].max()
    mean = 0.5 * (run.result.load[1:] + run.result.load[:-1])
    work = np.append(0.0, np.cumsum(mean * np.diff(run.result.displacement)))
    np.testing.assert_allclose(columns["energy_work"], work, atol=5e-3 * work.max())
    turn = run.theory.turning_point()
    assert turn is not None
    slow = run.result.displacement < 0.98 * turn.displacement
    assert columns["energy_kinetic"][slow].max() < 1e-3 * columns["energy_strain"][slow].max()
    assert "quasi-static: Ek/Es stayed under 1e-3 (good)" in run.printed


def test_load_and_shear_follow_the_analytic_solution(coarse: Run) -> None:
    check_against_theory(coarse, curve=0.02, shear=0.05)


def test_debonding_takes_its_fracture_energy_and_the_book_closes(coarse: Run) -> None:
    check_energies(coarse)


def test_the_elastic_stage_of_the_coarse_run_is_that_of_its_lattice(coarse: Run) -> None:
    profile = coarse.result.profiles[0]
    load, stress = elastic_answer(coarse.built, profile.displacement)
    at = int(np.argmin(np.abs(coarse.result.displacement - profile.displacement)))
    assert coarse.result.load[at] == pytest.approx(load, rel=5e-3)
    np.testing.assert_allclose(profile.shear, stress, atol=1e-2 * stress.max())


def test_the_summary_states_the_errors_as_they_are(coarse: Run) -> None:
    stated = coarse.summary["errors"]
    assert stated["peak load"] == pytest.approx(coarse.result.load.max() / coarse.theory.peak().load - 1.0, abs=1e-9)
    assert stated["load up to the turning point"] == pytest.approx(curve_error(coarse), abs=1e-9)
    shear = [value for name, value in stated.items() if name.startswith("shear stress")]
    assert shear == pytest.approx(shear_errors(coarse), abs=1e-9)
    taken = 2.0 * pi * 30.0 * FRACTURE_ENERGY
    assert stated["energy of debonding"] == pytest.approx(coarse.summary["energy"]["damage"] / taken - 1.0, abs=1e-9)
    assert coarse.summary["energy_error"] < 1e-6
    assert coarse.summary["outcome"] == "done"
    assert coarse.summary["theory"]["peak_load_N"] == pytest.approx(coarse.theory.peak().load, rel=1e-9)
    assert coarse.summary["theory"]["lam_L"] == pytest.approx(3.333, rel=1e-3)
    assert coarse.summary["geometry"]["interface_area_m2"] == pytest.approx(60.0 * pi, rel=1e-12)
    lines = {" ".join(line.split()) for line in coarse.printed.splitlines()}
    assert f"peak load {100 * stated['peak load']:+.2f} %" in lines
    assert f"energy of debonding {100 * stated['energy of debonding']:+.2f} %" in lines


def test_the_folder_shows_the_debonding(coarse: Run) -> None:
    folder = coarse.result.folder
    drawn = {"load-displacement.png", "shear-profiles.png", "energy.png"}
    assert drawn < pictures(folder)
    bonds = read_series(folder / "bonds.vtkhdf")
    joints = bonds.cell["bond_set"] == 2
    np.testing.assert_array_equal(bonds.lines[joints], coarse.built.joints.pairs)
    np.testing.assert_array_equal(bonds.cell["damage"][joints], 1.0)
    np.testing.assert_array_equal(bonds.cell["damage"][~joints], 0.0)
    slip_force = shear_of(bonds.cell["force"][joints], coarse.built)
    np.testing.assert_allclose(slip_force, 0.0, atol=1e-6 * np.abs(bonds.cell["force"]).max())
    particles = read_series(folder / "particles.vtkhdf")
    assert particles.times == bonds.times
    moved = particles.point["displacement"][coarse.built.pulled.indices, 0]
    np.testing.assert_allclose(moved, coarse.built.test.end, rtol=1e-4)
    early = read_series(folder / "bonds.vtkhdf", 2)
    np.testing.assert_array_equal(early.cell["damage"], 0.0)


@pytest.mark.slow
def test_the_default_size_is_within_three_percent(default: Run) -> None:
    check_against_theory(default, curve=0.01, shear=0.03)
    check_energies(default)


# What it refuses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"diameter": -1.0}, "diameter of pullout"),
        ({"free_length": -1.0}, "free_length of pullout"),
        ({"nu": 0.3}, "nu of pullout"),
        ({"axis": "u"}, "axis of pullout"),
        ({"matrix_radius": 1.2}, "matrix_radius of pullout"),
        ({"interface": bd.bilinear(slip_peak=1e-4, slip_end=4e-4)}, "interface of pullout"),
    ],
)
def test_values_that_make_no_pull_out_are_refused(values: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        pullout(**values)


@pytest.mark.filterwarnings("ignore:no bonds were made")
def test_grains_too_large_for_the_fibre_are_refused() -> None:
    with pytest.raises(InputError, match=r"fibre falls into .* pieces"):
        pullout(diameter=2.0).build()


def test_an_interface_that_is_no_law_is_refused() -> None:
    with pytest.raises(InputError, match="interface of pullout"):
        pullout(interface=1.0)
