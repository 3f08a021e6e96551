"""The critical step: closed forms, eigenvalues of separately assembled matrices, and runs on either side of it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import DP0
from oracles.lattice_statics import Lattice, dofs
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh

import pybondem as bd
from pybondem.errors import InputError, UnstableError

Floats = NDArray[np.float64]
Make = Callable[..., tuple[bd.Model, Any]]
SLIPPERY = {"slip_peak": 1.0, "slip_end": 2.0}


class Cloud(NamedTuple):
    """A model, the same as a lattice with its dashpots, and the degrees of freedom that are held."""

    model: bd.Model
    lattice: Lattice
    dashpots: Lattice
    fixed: list[int]

    @property
    def critical_step(self) -> float:
        """The true one [s]."""
        dashpots = self.dashpots if self.model.bonds[0].bond.damping > 0.0 else None
        return self.lattice.critical_step(self.model.mass, self.model.inertia, self.fixed, dashpots)


def cloud(seed: int, zeta: float = 0.0, spread: float = 1.0, fix: bool = True) -> Cloud:
    """Return some forty spheres of random size at random places: bonds and joints whose stiffness varies by
    10^(2 spread), dashpots of ratio zeta in all of them, four spheres partly held."""
    random, d = np.random.default_rng(seed), 1e-2
    x = bd.packing.fcc(d, bd.Sphere(1.75 * d)).x
    x = x + random.uniform(-0.06 * d, 0.06 * d, x.shape)
    model = bd.Model(bd.packing.Particles(x, random.uniform(0.42 * d, 0.5 * d, len(x))), density=2000.0)
    pairs = random.permutation(model.touching(gap=0.2))
    bonded, joined = np.split(pairs, [2 * len(pairs) // 3])
    k = np.array([[1e6], [5e5], [2.0], [3.0]]) * 10 ** random.uniform(-spread, spread, (4, len(bonded)))
    normal = random.normal(size=(len(joined), 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    area, stiff, soft = 10 ** random.uniform(-5.0, -4.0, len(joined)), 3e10, 1e10
    model.bond(bonded, bd.Bond(bd.springs(*k), damping=zeta))
    joint = bd.Joint(bd.bilinear(stiffness=soft, **SLIPPERY), normal_stiffness=stiff, damping=zeta)
    model.join(joined, joint, normal=normal, area=area)
    fixed: list[int] = []
    if fix:
        some = model.select([0, 1, 2, 5])
        model.fix(some, "x z ry")
        fixed = dofs(some.indices, "x z ry")
    lattice = Lattice(x).bond(bonded, *k).join(joined, normal, stiff * area, soft * area)
    c = dashpots(model, bonded, k, zeta)
    sliding = dashpots(model, joined, np.array([stiff * area, soft * area, 0.0 * area, 0.0 * area]), zeta)
    return Cloud(model, lattice, Lattice(x).bond(bonded, *c).join(joined, normal, *sliding[:2]), fixed)


def dashpots(model: bd.Model, pairs: NDArray[np.int64], k: Floats, zeta: float) -> Floats:
    """Return the dashpots c = 2 zeta sqrt(k m m'/(m + m')) (4, m) of bonds with stiffness k (4, m)."""
    i, j = pairs.T
    bodies = (model.mass, model.mass, model.inertia, model.inertia)
    return np.array([2.0 * zeta * np.sqrt(s * b[i] * b[j] / (b[i] + b[j])) for s, b in zip(k, bodies, strict=True)])


def growth(model: bd.Model, dt: float, steps: int) -> float:
    """Return how many times the largest speed has grown after some steps of `dt`, above the critical one or not."""
    sim, random = bd.Simulation(model, engine="reference"), np.random.default_rng(0)
    sim.dt = dt
    with sim.edit("v") as v:
        v[:] = 1e-9 * random.normal(size=v.shape)

    def fastest() -> float:
        p = sim.particles
        return max(float(np.abs(p.v).max()), 5e-3 * float(np.abs(p.w).max()))

    before = fastest()
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            sim.run(steps=steps, quiet=True)
    except UnstableError:
        return np.inf
    return fastest() / before


# Closed forms ---------------------------------------------------------------------------------------------------


def test_a_free_pair_has_the_limit_of_its_shear_mode(engine: str, pair: Make) -> None:
    model, _ = pair((1.0, 2.0, 3.0))
    limit = bd.Simulation(model, engine=engine).limit.dt
    exact = 2.0 / np.sqrt(DP0.ks * (2.0 / DP0.mass + DP0.length**2 / (2.0 * DP0.inertia)))
    assert exact == pytest.approx(18.18482e-6, rel=1e-6)
    assert exact * (1.0 - 1e-2) < limit <= exact * (1.0 + 1e-12)


def test_a_long_chain_has_the_limit_of_its_transverse_branch(
    engine: str, chain: Make, sized: Callable[[Any, Any], Any]
) -> None:
    model, bonds = chain(sized(60, 20), (3.0, -1.0, 2.0))
    limit = bd.Simulation(model, engine=engine).limit.dt
    endless = 2.0 / np.sqrt(DP0.ks * DP0.length**2 / DP0.inertia)
    assert endless == pytest.approx(15.21452e-6, rel=1e-6)
    assert limit == pytest.approx(endless, rel=1e-2)
    lattice = Lattice(model.x).bond(bonds.pairs, DP0.kn, DP0.ks, DP0.kt, DP0.kb)
    assert limit <= lattice.critical_step(model.mass, model.inertia) * (1.0 + 1e-12)


@pytest.mark.parametrize("zeta", [0.1, 0.3, 1.0])
def test_a_pair_with_a_dashpot_has_the_limit_of_one_oscillator(zeta: float) -> None:
    model = bd.Model(bd.packing.line(2, spacing=1e-2, direction=(1, 2, 3), diameter=1e-2), density=2500.0)
    model.bond([[0, 1]], bd.Bond(bd.springs(kn=1e6, ks=0.0), damping=zeta))
    omega = np.sqrt(2.0 * 1e6 / model.mass[0])  # dt^2 omega^2/4 + 2 zeta omega dt = 1
    exact = 2.0 / omega * (np.sqrt(1.0 + 4.0 * zeta**2) - 2.0 * zeta)
    limit = bd.Simulation(model, engine="reference").limit.dt
    assert exact * (1.0 - 1e-2) < limit <= exact * (1.0 + 1e-12)
    assert growth(model, 0.99 * exact, 500) < 1.0
    assert growth(model, 1.05 * exact, 500) > 1e6


# Random clouds --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(10))
def test_the_limit_is_that_of_the_dense_eigenvalue_problem(seed: int) -> None:
    case = cloud(seed, fix=seed % 2 == 0)
    limit = bd.Simulation(case.model, engine="reference").limit
    true = case.critical_step
    assert 0.99 * true < limit.dt <= true * (1.0 + 1e-12)
    assert limit.omega == pytest.approx(2.0 / true, rel=1e-2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("zeta", [0.02, 0.3])
def test_dashpots_lower_the_limit_at_least_as_far_as_they_must(seed: int, zeta: float) -> None:
    case = cloud(seed, zeta, spread=0.2, fix=seed % 2 == 0)
    limit, true = bd.Simulation(case.model, engine="reference").limit.dt, case.critical_step
    assert limit <= true * (1.0 + 1e-12)
    assert limit > (0.5 if zeta == 0.02 else 0.1) * true  # the slowest dashpot is taken to act on the fastest mode


@pytest.mark.parametrize(("seed", "zeta"), [(0, 0.0), (1, 0.3)])
def test_runs_stay_bounded_below_the_limit_and_blow_up_above_it(seed: int, zeta: float) -> None:
    case = cloud(seed, zeta, spread=0.2, fix=seed % 2 == 0)
    limit, true = bd.Simulation(case.model, engine="reference").limit.dt, case.critical_step
    assert growth(case.model, 0.99 * limit, 500) < 3.0
    assert growth(case.model, 0.99 * true, 500) < 3.0
    assert growth(case.model, 1.05 * true, 500) > 1e6
    if zeta == 0.0:
        assert growth(case.model, 1.05 * limit, 500) > 1e6


def test_held_and_unbonded_particles_set_no_limit() -> None:
    line = bd.packing.line(3, spacing=1e-2, direction=(1, 0, 0), diameter=1e-2)
    model = bd.Model(line, density=2500.0)
    assert bd.Simulation(model, engine="reference").limit.dt == np.inf
    model.bond([[0, 1]], bd.Bond(bd.springs(kn=1e6, ks=0.0)))
    free = bd.Simulation(model, engine="reference").limit.dt
    model.fix(model.select([0]))
    held = bd.Simulation(model, engine="reference").limit.dt
    assert free == pytest.approx(2.0 / np.sqrt(2.0 * 1e6 / model.mass[0]), rel=1e-2)
    assert held == pytest.approx(2.0 / np.sqrt(1.0 * 1e6 / model.mass[0]), rel=1e-2)
    model.fix(model.select([1]))
    assert bd.Simulation(model, engine="reference").limit.dt == np.inf


# One stiff bond in many -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("stiffer", [1.5, 4.0])
def test_one_stiff_bond_in_a_long_chain_is_seen(stiffer: float) -> None:
    n, k = 400, np.full(399, 1e6)
    k[137] *= stiffer
    model = bd.Model(bd.packing.line(n, spacing=1e-2, direction=(0, 1, 0), diameter=1e-2), density=2500.0)
    model.bond(np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), bd.Bond(bd.springs(k, 0.0)))
    # its two ends swing against each other, their neighbours less and less, by s = 1/(2 f - 1) from one to the next
    squared = (2.0 * stiffer + 1.0 + 1.0 / (2.0 * stiffer - 1.0)) * 1e6 / model.mass[0]
    limit = bd.Simulation(model, engine="reference").limit
    assert 0.99 * 2.0 / np.sqrt(squared) < limit.dt <= 2.0 / np.sqrt(squared)
    if stiffer == 4.0:
        assert limit.particle in (137, 138)


def test_one_stiff_bond_in_a_packing_is_seen() -> None:
    model = bd.Model(bd.packing.hcp(1e-3, bd.Cylinder(radius=3e-3, height=10e-3), axis="z"), density=2500.0)
    pairs = model.touching()
    for bond, stiffer in ((100, 2.0), (1966, 3.5), (1033, 4.0), (1033, 5.0), (1033, 6.0)):
        kn = np.full(len(pairs), 1e6)
        kn[bond] *= stiffer
        stiff = bd.Model(bd.packing.Particles(model.x, model.radius), density=2500.0)
        stiff.bond(pairs, bd.Bond(bd.springs(kn, 0.45 * kn)))
        body = diags_array(np.repeat(np.stack([model.mass, model.inertia], axis=1), 3, axis=1).ravel() ** -0.5)
        K = body @ Lattice(model.x).bond(pairs, kn, 0.45 * kn).stiffness @ body
        true = 2.0 / np.sqrt(eigsh(K, k=1, which="LA", tol=1e-10, return_eigenvectors=False)[0])
        assert 0.98 * true < bd.Simulation(stiff, engine="reference").limit.dt <= true, (bond, stiffer)


# Refusals -------------------------------------------------------------------------------------------------------


def test_a_step_above_the_limit_is_refused_with_the_limit_and_its_particle(pair: Make) -> None:
    model, _ = pair((0.0, 1.0, 0.0))
    limit = bd.Simulation(model, engine="reference").limit.dt
    bd.Simulation(model, engine="reference", dt=limit)
    with pytest.raises(UnstableError, match=rf"dt is .* above the critical step {limit:.4g} s.* particle [01];"):
        bd.Simulation(model, engine="reference", dt=1.0001 * limit)


@pytest.mark.parametrize("safety", [0.0, 1.1, float("nan")])
def test_a_safety_that_is_no_fraction_is_refused(pair: Make, safety: float) -> None:
    model, _ = pair((0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="safety"):
        bd.Simulation(model, engine="reference", safety=safety)
    assert bd.Simulation(model, engine="reference", safety=0.25).dt == pytest.approx(
        0.25 * bd.Simulation(model, engine="reference").limit.dt, rel=1e-14
    )
