"""The cylinder example: the stiffness it measures, against a direct solve of its lattice and the closed form."""

import contextlib
import io
from math import pi
from typing import NamedTuple

import numpy as np
import pytest
from examples.result_folder import pictures, read_columns, read_series, read_summary
from oracles.lattice_statics import Lattice, held, hexagonal_modulus, hexagonal_springs

from pybondem.errors import InputError
from pybondem.examples import Cylinder, cylinder
from pybondem.examples.cylinder import CylinderResult

BOOK = ("kinetic", "strain", "gravity", "damage", "dashpots", "drag", "work", "residual")


def stiffness(case: Cylinder) -> float:
    """Return EA [N] of the lattice of a case by a direct solve: bottom held, top raised by one height."""
    model = case.build().model
    z = model.x[:, 2]
    low, high = (np.flatnonzero(np.abs(z - end) < 1e-9) for end in (z.min(), z.max()))
    lattice = Lattice(model.x).bond(model.bonds[0].pairs, *hexagonal_springs(case.E, case.nu, case.diameter))
    _, force = lattice.solve(held(low, "x y z") | held(high, "x y") | held(high, "z", float(np.ptp(z))))
    return float(force[high, 2].sum())


class Run(NamedTuple):
    """A finished run: its case, what it gave, the exact stiffness of its lattice [N], and what it printed."""

    case: Cylinder
    result: CylinderResult
    exact: float
    printed: str


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The example with 259 particles on the cpu engine."""
    case = cylinder(diameter=2e-3)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        result = case.run(engine="cpu", folder=tmp_path_factory.mktemp("cylinder"))
    return Run(case, result, stiffness(case), printed.getvalue())


# What it measures -----------------------------------------------------------------------------------------------


def test_the_run_measures_the_stiffness_of_its_lattice(run: Run) -> None:
    strain, force = run.result.strain, run.result.force
    assert strain[-1] == pytest.approx(run.case.strain, rel=1e-3)
    late = strain > 0.5 * run.case.strain
    np.testing.assert_allclose(force[late] / strain[late], run.exact, rtol=1e-3)
    assert run.result.summary["stiffness"]["measured_N"] == pytest.approx(run.exact, rel=1e-4)


def test_the_summary_states_both_errors_as_they_are(run: Run) -> None:
    summary = read_summary(run.result.folder)
    measured, closed = summary["stiffness"]["measured_N"], run.case.E * pi * run.case.radius**2
    assert summary["stiffness"]["static_solve_N"] == pytest.approx(run.exact, rel=1e-9)
    assert summary["stiffness"]["closed_form_N"] == pytest.approx(closed, rel=1e-14)
    assert set(summary["errors"]) == {"stiffness against the static solve", "stiffness against the closed form"}
    assert summary["errors"]["stiffness against the static solve"] == pytest.approx(measured / run.exact - 1, abs=1e-9)
    assert summary["errors"]["stiffness against the closed form"] == pytest.approx(measured / closed - 1, abs=1e-12)
    assert summary["errors"]["stiffness against the closed form"] < -0.1  # five grains across: mostly surface


@pytest.mark.parametrize("nu", [0.0, 0.2])  # at 0.2 bonds have no shear stiffness, and grains can spin
def test_the_tiny_cylinder_on_the_reference_engine(nu: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    case = cylinder(diameter=3.5e-3, nu=nu, E=3e10, density=1800.0, transits=30.0)
    result = case.run(engine="reference", folder=tmp_path_factory.mktemp("tiny"), quiet=True)
    assert result.summary["stiffness"]["measured_N"] == pytest.approx(stiffness(case), rel=1e-3)
    assert result.summary["stiffness"]["static_solve_N"] == pytest.approx(stiffness(case), rel=1e-9)


def test_the_closed_form_is_that_of_the_lattice_and_is_approached_with_smaller_grains() -> None:
    left = []
    for diameter in (3e-3, 1.5e-3, 1e-3):
        case = cylinder(diameter=diameter)
        assert hexagonal_modulus(*hexagonal_springs(case.E, case.nu, diameter), diameter) == pytest.approx(case.E)
        left.append(1.0 - case.build().static_stiffness() / (case.E * pi * case.radius**2))
    assert 0.05 < left[2] < left[1] < left[0] < 0.4
    assert left[2] == pytest.approx(left[0] / 3.0, rel=0.3)  # what is missing is a skin of a fraction of a diameter


# What it leaves -------------------------------------------------------------------------------------------------


def test_the_folder_holds_everything(run: Run) -> None:
    folder = run.result.folder
    drawn = {"energy.png", "force-strain.png", "history-force.png", "history-strain.png", "history-unbalanced.png"}
    assert pictures(folder) == drawn
    files = {"summary.json", "history.csv", "particles.vtkhdf", "bonds.vtkhdf"}
    assert {p.name for p in folder.iterdir()} == files | drawn | {name.replace(".png", ".svg") for name in drawn}


def test_the_summary_says_what_ran_and_whether_to_trust_it(run: Run) -> None:
    summary = read_summary(run.result.folder)
    assert {k: summary[k] for k in ("outcome", "case", "engine", "particles", "bonds", "broken")} == {
        "outcome": "done", "case": "cylinder", "engine": "cpu", "particles": 259, "bonds": 1176, "broken": 0,
    }  # fmt: skip
    assert summary["dt_s"] == pytest.approx(0.5 * summary["critical_dt_s"], rel=1e-12)
    assert summary["time_s"] == pytest.approx(60.0 * 20e-3 / (1e9 / 2500.0) ** 0.5, rel=1e-3)
    assert summary["steps"] == round(summary["time_s"] / summary["dt_s"])
    assert set(summary["energy"]) == set(BOOK)
    assert summary["energy"]["work"] == pytest.approx(0.5 * run.exact * 1e-8 * 2e-2, rel=0.1)  # EA e^2 h / 2
    assert summary["energy_error"] < 1e-6
    assert summary["kinetic_ratio"] < 1e-3
    assert {"pybondem", "git", "python", "numpy", "numba", "cpu", "platform", "date"} <= set(summary["provenance"])


def test_the_history_is_a_table_with_units(run: Run) -> None:
    columns, units = read_columns(run.result.folder / "history.csv")
    energies = {f"energy_{name}": "J" for name in BOOK}
    assert units == {"time": "s", "force": "N", "strain": "1", "unbalanced": "1"} | energies
    np.testing.assert_array_equal(columns["force"], run.result.force)
    np.testing.assert_array_equal(columns["strain"], run.result.strain)
    assert 190 <= len(columns["time"]) <= 220
    assert np.all(np.diff(columns["time"]) > 0.0)
    stored = 0.5 * columns["force"] * columns["strain"] * run.case.build().model.x[:, 2].max()
    late = columns["strain"] > 0.5 * run.case.strain
    np.testing.assert_allclose(columns["energy_strain"][late], stored[late], rtol=1e-2)


def test_paraview_shows_particles_and_bonds_over_time(run: Run) -> None:
    built, folder = run.case.build(), run.result.folder
    particles, bonds = (read_series(folder / f"{name}.vtkhdf") for name in ("particles", "bonds"))
    columns, _ = read_columns(folder / "history.csv")
    assert particles.times == bonds.times
    assert particles.times[0] == 0.0
    assert particles.times[-1] == pytest.approx(run.case.duration, rel=1e-3)
    assert set(particles.times[:-1]) <= set(columns["time"])
    assert 15 <= len(particles.times) <= 30
    assert set(particles.point) == {"radius", "part", "velocity", "spin", "force", "displacement"}
    assert set(bonds.cell) == {"bond_set", "damage", "force", "energy"}
    np.testing.assert_array_equal(bonds.lines, built.model.bonds[0].pairs)
    np.testing.assert_array_equal(particles.point["radius"], built.model.radius)
    np.testing.assert_allclose(particles.points - built.model.x, particles.point["displacement"], atol=1e-12)
    travel = run.case.strain * np.ptp(built.model.x[:, 2])
    np.testing.assert_allclose(particles.point["displacement"][built.top.indices, 2], travel, rtol=1e-3)
    np.testing.assert_array_equal(particles.point["displacement"][built.bottom.indices], 0.0)
    pulled = particles.point["force"][built.top.indices, 2].sum()  # by the specimen: downwards
    assert pulled == pytest.approx(-run.exact * run.case.strain, rel=1e-2)
    assert bonds.cell["energy"].sum() == pytest.approx(read_summary(folder)["energy"]["strain"], rel=1e-5)
    np.testing.assert_array_equal(bonds.cell["damage"], 0.0)
    middle = read_series(folder / "particles.vtkhdf", len(particles.times) // 2)
    k = int(np.argmin(np.abs(columns["time"] - particles.times[len(particles.times) // 2])))
    risen = middle.point["displacement"][built.top.indices, 2] / np.ptp(built.model.x[:, 2])
    np.testing.assert_allclose(risen, columns["strain"][k], rtol=1e-5)


def test_the_closing_block_tells_what_came_out(run: Run) -> None:
    lines = {" ".join(line.split()) for line in run.printed.splitlines()}
    summary = run.result.summary["errors"]
    assert "cylinder done" in lines
    assert f"stiffness against the static solve {100 * summary['stiffness against the static solve']:+.3f} %" in lines
    assert f"stiffness against the closed form {100 * summary['stiffness against the closed form']:+.3f} %" in lines
    assert "broken bonds 0 of 1176" in lines
    assert any(line.startswith("verdict quasi-static") and line.endswith("(good)") for line in lines)
    assert any(line.startswith("verdict energy closes") and line.endswith("(good)") for line in lines)
    assert f"summary {run.result.folder / 'summary.json'}" in lines


# What it refuses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"diameter": 0.0}, "diameter of cylinder"),
        ({"height": float("nan")}, "height of cylinder"),
        ({"nu": 0.25}, "nu of cylinder"),
        ({"E": "1e9"}, "E of cylinder"),
    ],
)
def test_values_that_make_no_cylinder_are_refused(values: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        cylinder(**values)


@pytest.mark.filterwarnings("ignore:no bonds were made")
def test_a_cylinder_that_does_not_hold_together_is_refused(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(InputError):  # three layers of 1, 0 and 1 grains across
        cylinder(diameter=1e-2).run(engine="reference", folder=tmp_path_factory.mktemp("pieces"), quiet=True)


def test_a_run_too_short_to_measure_is_refused(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(InputError):
        cylinder(diameter=3e-3, transits=1e-3).run(
            engine="reference", folder=tmp_path_factory.mktemp("short"), quiet=True
        )
