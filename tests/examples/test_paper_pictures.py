"""Figure 2 of the paper: stresses of particles against closed forms, and the paused pull-out against its theory."""

import re

import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.paper import make
from pybondem.paper.effort import Effort
from pybondem.paper.particle_stress import particle_stress


def neighbours(x, distance):
    i, j = np.triu_indices(len(x), 1)
    near = np.linalg.norm(x[j] - x[i], axis=1) < 1.01 * distance
    return np.stack([i[near], j[near]], axis=1)


def central_forces(x, pairs, stiffness, u):
    """Forces (m, 3) on the first ends of springs along the branches, in small displacements u (n, 3)."""
    branch = x[pairs[:, 1]] - x[pairs[:, 0]]
    n = branch / np.linalg.norm(branch, axis=1)[:, None]
    return stiffness * np.einsum("ij,ij->i", u[pairs[:, 1]] - u[pairs[:, 0]], n)[:, None] * n


def test_a_stretched_bar_of_cubes_carries_the_load_over_its_area():
    d, k, strain = 0.2, 3e7, 1e-4
    x = d * np.stack(np.meshgrid(range(3), range(4), range(9), indexing="ij"), axis=-1).reshape(-1, 3)
    pairs = neighbours(x, d)
    force = central_forces(x, pairs, k, strain * x * (0, 0, 1))
    stress = particle_stress(x, pairs, force, d**3)
    load, area = 12 * k * strain * d, 12 * d**2
    middle = (x[:, 2] > 0.5 * d) & (x[:, 2] < 7.5 * d)
    np.testing.assert_allclose(stress[middle, 2, 2], load / area, rtol=1e-12)
    np.testing.assert_allclose(stress[~middle, 2, 2], 0.5 * load / area, rtol=1e-12)
    stress[:, 2, 2] = 0.0
    assert np.abs(stress).max() < 1e-9 * load / area


def test_the_inner_particle_of_a_close_packing_has_the_stress_of_the_continuum():
    """Cubic close packing of central springs: C11 = sqrt(2) k/d, C12 = C44 = C11/2 (Born & Huang 1954)."""
    d, k = 0.5, 2e8
    corner = d / np.sqrt(2.0) * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]])
    steps = np.stack(np.meshgrid(*[range(-2, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    x = steps @ corner
    pairs = neighbours(x, d)
    strain = 1e-5 * np.array([[3.0, 0.7, 0.0], [0.7, -1.0, 0.4], [0.0, 0.4, 0.2]])
    stress = particle_stress(x, pairs, central_forces(x, pairs, k, x @ strain), d**3 / np.sqrt(2.0))
    C11 = np.sqrt(2.0) * k / d
    exact = C11 * strain + 0.5 * C11 * (np.trace(strain) * np.eye(3) - np.diag(np.diag(strain)))
    exact[~np.eye(3, dtype=bool)] = (C11 * strain)[~np.eye(3, dtype=bool)]  # 2 C44 times the shear
    np.testing.assert_allclose(stress[np.argmin(np.linalg.norm(x, axis=1))], exact, atol=1e-9 * np.abs(exact).max())


def test_stress_times_volume_is_force_times_place():
    """For forces of any kind in equilibrium with what loads the body; whichever end of a bond is called the first."""
    rng = np.random.default_rng(5)
    x, volume = rng.uniform(size=(30, 3)), rng.uniform(0.5, 2.0, 30)
    pairs = neighbours(x, 0.4)
    force = rng.normal(size=(len(pairs), 3))
    load = np.zeros((30, 3))  # what must act from outside to keep each particle at rest
    np.add.at(load, pairs[:, 0], -force)
    np.add.at(load, pairs[:, 1], force)
    stress = particle_stress(x, pairs, force, volume)
    np.testing.assert_allclose(np.einsum("i,ijk->jk", volume, stress), load.T @ x, atol=1e-12)
    np.testing.assert_allclose(particle_stress(x, pairs[:, ::-1], -force, volume), stress, atol=1e-13)


@pytest.mark.parametrize(
    ("pairs", "force", "volume", "says"),
    [
        ([[0, 1]], [[np.nan, 0, 0]], 1.0, "not finite"),
        ([[0, 2]], [[1.0, 0, 0]], 1.0, "there are 2"),
        ([[0, -1]], [[1.0, 0, 0]], 1.0, "there are 2"),
        ([[0, 1], [1, 0]], [[1.0, 0, 0]], 1.0, "must be whole numbers"),
        ([[0.0, 1.0]], [[1.0, 0, 0]], 1.0, "must be whole numbers"),
        ([[0, 1]], [[1.0, 0, 0]], 0.0, "positive"),
        ([[0, 1]], [[1.0, 0, 0]], [1.0], "shape"),
    ],
)
def test_what_has_no_stress_is_refused(pairs, force, volume, says):
    with pytest.raises(InputError, match=says):
        particle_stress([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], pairs, force, volume)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper") / "fig2"
    return folder, make("fig2", folder, Effort(quick=True, threads=1, quiet=True))


@pytest.mark.slow
def test_the_paused_model_is_where_theory_says(quick):
    facts = quick[1].facts
    load, exact = np.array(facts["load"]), np.array(facts["load of theory"])
    assert np.abs(load - exact).max() < 0.05 * exact.max()
    assert exact.argmax() < len(exact) - 1  # past the peak
    assert facts["mean damage"] == pytest.approx(facts["mean damage of theory"], abs=0.03)
    assert 0.3 < facts["mean damage"] < 0.8
    inside, outside = np.array(facts["force in the fibre"]), np.array(facts["force in the fibre of theory"])
    assert np.abs(inside - outside).max() < 0.05 * outside.max()
    assert inside[-1] == pytest.approx(load[-1], rel=0.02)


@pytest.mark.slow
def test_the_page_has_its_pictures_tables_and_view(quick):
    folder, sheet = quick
    text = (folder / "fig2.md").read_text(encoding="utf-8")
    linked = re.findall(r"\]\(([^)]+)\)", text)
    assert {"fig2.png", "fig2-view.html"} <= set(linked)
    assert all((folder / name).stat().st_size > 10_000 for name in linked)
    for name in ("fig2", "fig2-fibre-and-matrix", "fig2-cut-open", "fig2-stress", "fig2-damage"):
        head = (folder / f"{name}.png").read_bytes()[:24]
        assert int.from_bytes(head[16:20], "big") >= 1600
        assert (folder / f"{name}.svg").exists()
    assert len(sheet.tables) == 3
    assert {"four pictures", "view for the browser"} <= set(sheet.facts["seconds"])
