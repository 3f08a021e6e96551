"""Linear statics: against a direct solve of separately assembled matrices, and closed forms of beams and bars."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import DP0
from oracles.lattice_statics import COMPONENTS, Lattice, held

import pybondem as bd
from pybondem.errors import InputError
from pybondem.statics import axial_stiffness, solve

Floats = NDArray[np.float64]
Make = Callable[..., tuple[bd.Model, Any]]


class Cloud(NamedTuple):
    """A model, the same as a lattice, values of its held components (n, 6), loads (n, 6) on the others."""

    model: bd.Model
    lattice: Lattice
    prescribed: Floats
    supports: dict[int, float]
    load: Floats


def cloud(seed: int) -> Cloud:
    """Return some forty spheres of random size at random places, with every kind of bond, held and loaded at random."""
    random, d = np.random.default_rng(seed), 1e-2
    x = bd.packing.fcc(d, bd.Sphere(1.75 * d)).x
    x = x + random.uniform(-0.06 * d, 0.06 * d, x.shape)
    model = bd.Model(bd.packing.Particles(x, random.uniform(0.42 * d, 0.5 * d, len(x))), density=2000.0)
    pairs = random.permutation(model.touching(gap=0.2))
    pairs = np.where(random.random(len(pairs))[:, None] < 0.5, pairs[:, ::-1], pairs)
    springs, beams, joined = np.split(pairs, [len(pairs) // 3, 2 * len(pairs) // 3])
    k = np.array([[1e6], [5e5], [2.0], [3.0]]) * 10 ** random.uniform(-0.7, 0.7, (4, len(springs)))
    normal = random.normal(size=(len(joined), 3))
    area = random.uniform(2e-5, 8e-5, len(joined))
    model.bond(springs, bd.Bond(bd.springs(*k)))
    model.bond(beams, bd.Bond(bd.timoshenko(E=1e9, nu=0.2, shear_factor=0.9, radius_ratio=0.6), damping=0.1))
    law = bd.bilinear(stiffness=1e10, slip_peak=1e-5, slip_end=4e-5)
    model.join(joined, bd.Joint(law, normal_stiffness=4e10), normal=normal, area=area)

    length = np.linalg.norm(x[beams[:, 1]] - x[beams[:, 0]], axis=1)
    r = 0.6 * model.radius[beams].min(axis=1)
    A, I, E, G = np.pi * r**2, np.pi * r**4 / 4.0, 1e9, 1e9 / 2.4
    phi = 12.0 * E * I / (G * A * 0.9 * length**2)
    lattice = Lattice(x).bond(springs, *k)
    lattice.bond(beams, E * A / length, 12.0 * E * I / (length**3 * (1.0 + phi)), 2.0 * G * I / length, E * I / length)
    lattice.join(joined, normal / np.linalg.norm(normal, axis=1)[:, None], 4e10 * area, 1e10 * area)

    prescribed = np.zeros((len(x), 6))
    supports: dict[int, float] = {}
    for particle in random.choice(len(x), 8, replace=False):
        components = [c for c in COMPONENTS if random.random() < 0.6] or ["x"]
        model.fix(model.select([particle]), components)
        for c in components:
            value = random.normal() * (1e-5 if c in "xyz" else 1e-3)
            prescribed[particle, COMPONENTS.index(c)] = value
            supports |= held(particle, c, value)
    free = np.ones(6 * len(x))
    free[list(supports)] = 0.0
    load = free.reshape(-1, 6) * random.normal(size=(len(x), 6)) * np.array([10.0] * 3 + [0.05] * 3)
    return Cloud(model, lattice, prescribed, supports, load)


# Against a direct solve -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_random_clouds_come_to_the_equilibrium_of_a_direct_solve(seed: int) -> None:
    compare(cloud(seed), "reference")


def test_every_engine_comes_to_the_same_equilibrium(engine: str) -> None:
    compare(cloud(4), engine)


def compare(case: Cloud, engine: str) -> None:
    """Hold the equilibria of a cloud against a direct solve: held at a displacement, loaded, both."""
    for prescribed, load in ((case.prescribed, None), (None, case.load), (case.prescribed, case.load)):
        supports = case.supports if prescribed is not None else dict.fromkeys(case.supports, 0.0)
        u, force = case.lattice.solve(supports, load)
        found = solve(case.model, prescribed, load, engine=engine)
        np.testing.assert_allclose(found.displacement, u[:, :3], atol=1e-7 * np.abs(u[:, :3]).max())
        np.testing.assert_allclose(found.rotation, u[:, 3:], atol=1e-7 * np.abs(u[:, 3:]).max())
        np.testing.assert_allclose(found.force, force[:, :3], atol=1e-7 * np.abs(force[:, :3]).max())


def test_loads_on_held_components_change_nothing() -> None:
    case = cloud(7)
    anywhere = case.load.copy()
    anywhere.ravel()[list(case.supports)] = 1e6
    quiet, loud = (solve(case.model, case.prescribed, load, engine="reference") for load in (case.load, anywhere))
    np.testing.assert_array_equal(loud.displacement, quiet.displacement)


def test_a_rigid_motion_of_everything_held_costs_nothing() -> None:
    case = cloud(5)
    spin, shift = np.array([1e-4, -2e-4, 3e-4]), np.array([1e-5, 0.0, -2e-5])
    model = bd.Model(bd.packing.Particles(case.model.x, case.model.radius), density=2000.0)
    model.bonds = case.model.bonds
    model.fix(model.select([0, 3, 11]), "x y z rx ry rz")
    moved = np.concatenate([shift + np.cross(spin, model.x), np.broadcast_to(spin, model.x.shape)], axis=1)
    found = solve(model, moved, engine="reference")
    np.testing.assert_allclose(found.displacement, moved[:, :3], atol=1e-9 * np.abs(moved[:, :3]).max())
    np.testing.assert_allclose(found.rotation, moved[:, 3:], atol=1e-8 * np.abs(spin).max())
    np.testing.assert_allclose(found.force, 0.0, atol=1e-3)  # of bonds of 1e6 N/m moved by 1e-5 m


# Closed forms ---------------------------------------------------------------------------------------------------


def test_a_cantilever_bends_like_a_chain_of_short_beams(chain: Make) -> None:
    n = 10
    model, _ = chain(n + 1, (1.0, 0.0, 0.0))
    model.fix(model.select([0]))
    load = np.zeros((n + 1, 6))
    load[n, 1], l = 1.0, DP0.length
    tip = solve(model, load=load, engine="reference")
    deflection = n / DP0.ks + l**2 * n * (4 * n**2 - 1) / (12.0 * DP0.kb)
    assert deflection == pytest.approx(1.658140e-3, rel=1e-6)
    assert tip.displacement[n, 1] == pytest.approx(deflection, rel=1e-7)
    assert tip.rotation[n, 2] == pytest.approx(24.86796e-3, rel=1e-6)
    np.testing.assert_allclose(tip.force[0], [0.0, -1.0, 0.0], atol=1e-7)
    load[n] = [100.0, 0.0, 0.0, 1.0, 0.0, 0.05]
    tip = solve(model, load=load, engine="reference")
    assert tip.displacement[n, 0] == pytest.approx(100.0 * n / DP0.kn, rel=1e-7)
    assert tip.displacement[n, 1] == pytest.approx(0.05 * n**2 * l / (2.0 * DP0.kb), rel=1e-7)
    assert tip.rotation[n, 0] == pytest.approx(n / DP0.kt, rel=1e-7)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("n", [1, 7, 60])
def test_a_chain_has_the_axial_stiffness_of_its_bonds(axis: Any, n: int, chain: Make) -> None:
    model, _ = chain(n + 1, np.eye(3)["xyz".index(axis)])
    stiffness = axial_stiffness(model, model.select([0]), model.select([n]), axis, engine="reference")
    assert stiffness == pytest.approx(DP0.kn * DP0.length, rel=1e-9)


def test_unequal_bonds_of_a_chain_add_their_compliances() -> None:
    kn = np.array([1e6, 3e5, 7e6, 2e6])
    model = bd.Model(bd.packing.line(5, spacing=1e-2, direction=(0, 1, 0), diameter=1e-2), density=2500.0)
    model.bond([[0, 1], [1, 2], [2, 3], [3, 4]], bd.Bond(bd.springs(kn, 0.0)))
    stiffness = axial_stiffness(model, model.select([0]), model.select([4]), "y", engine="reference")
    assert stiffness == pytest.approx(4e-2 / np.sum(1.0 / kn), rel=1e-9)


def test_axial_stiffness_leaves_the_model_and_its_supports_alone(chain: Make) -> None:
    model, _ = chain(4, (0.0, 0.0, 1.0))
    model.fix(model.select([1]))  # of no account: it would halve the length
    before = list(model.boundaries.conditions)
    stiffness = axial_stiffness(model, model.select([0]), model.select([3]), "z", engine="reference")
    assert stiffness == pytest.approx(DP0.kn * DP0.length, rel=1e-9)
    assert model.boundaries.conditions == before


# Refusals -------------------------------------------------------------------------------------------------------


def test_a_model_that_nothing_holds_is_refused(chain: Make) -> None:
    model, _ = chain(3, (1.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"1 of 1 connected pieces have nothing held.* particle [012];"):
        solve(model, engine="reference")
    model.fix(model.select([0]), "rx ry rz")  # it can still float away
    with pytest.raises(InputError, match="1 of 1 connected pieces have nothing held"):
        solve(model, engine="reference")


def test_a_loose_piece_is_named() -> None:
    model = bd.Model(bd.packing.line(5, spacing=1e-2, direction=(1, 0, 0), diameter=1e-2), density=2500.0)
    model.bond([[0, 1], [3, 4]], bd.Bond(bd.springs(1e6, 1e6)))
    model.fix(model.select([0]))
    model.fix(model.select([2]), "y")
    with pytest.raises(InputError, match=r"1 of 3 connected pieces have nothing held.* particle [34];"):
        solve(model, engine="reference")


def test_a_load_that_nothing_resists_is_refused(chain: Make) -> None:
    model, _ = chain(3, (1.0, 0.0, 0.0))
    model.fix(model.select([0]), "x")
    load = np.zeros((3, 6))
    load[2, 1] = 1.0
    with pytest.raises(InputError, match="did not converge"):
        solve(model, load=load, engine="reference")


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({"prescribed": np.zeros((3, 3))}, r"prescribed has shape \(3, 3\); it must be \(3, 6\)"),
        ({"load": np.full((3, 6), np.nan)}, r"load\[0, 0\] is nan, not finite"),
        ({"engine": "cup"}, "engine is 'cup'.*did you mean 'cpu'"),
    ],
)
def test_bad_arguments_of_solve_are_refused(arrays: dict[str, Any], says: str, chain: Make) -> None:
    model, _ = chain(3, (1.0, 0.0, 0.0))
    model.fix(model.select([0]))
    with pytest.raises(InputError, match=says):
        solve(model, **{"engine": "reference"} | arrays)


def test_an_axis_that_is_none_is_refused(chain: Make) -> None:
    model, _ = chain(3, (1.0, 0.0, 0.0))
    with pytest.raises(InputError, match="axis is 'w'"):
        axial_stiffness(model, model.select([0]), model.select([2]), "w", engine="reference")
