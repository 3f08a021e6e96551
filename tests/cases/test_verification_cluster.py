"""Verification D06-D08 and D18: clusters and lattices, through the public API, on every engine."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import (
    DP0,
    LATTICES,
    STRAINS,
    cubic_invariants,
    frame,
    lattice_constants,
    periodic_constants,
    plane_net,
    quaternion,
    quaternion_product,
    rotation_matrix,
    young_100,
)

import pybondem as bd

Floats = NDArray[np.float64]
Make = Callable[..., Any]
CONSTANTS = {kind: lattice_constants(kind, DP0.kn, DP0.ks, DP0.length) for kind in LATTICES}
DIGITS = {
    "sc C11": (CONSTANTS["sc"]["C11"], 0.5026548e9),
    "sc C44": (CONSTANTS["sc"]["C44"], 0.1130973e9),
    "fcc C11": (CONSTANTS["fcc"]["C11"], 1.030749e9),
    "fcc C12": (CONSTANTS["fcc"]["C12"], 0.1954868e9),
    "fcc C44": (CONSTANTS["fcc"]["C44"], 0.5153744e9),
    "fcc E[100]": (young_100(CONSTANTS["fcc"]["C11"], CONSTANTS["fcc"]["C12"]), 0.9684197e9),
    "bcc C11": (CONSTANTS["bcc"]["C11"], 0.551395e9),
    "bcc C12": (CONSTANTS["bcc"]["C12"], 0.1596143e9),
    "bcc C44": (CONSTANTS["bcc"]["C44"], 0.3555047e9),
    "triangular nu": (plane_net(DP0.kn, DP0.ks)[0], 0.1594203),
    "triangular E": (plane_net(DP0.kn, DP0.ks)[1], 7.318286e6),
}


@pytest.mark.parametrize("name", DIGITS)
def test_the_closed_forms_give_the_known_digits(name: str) -> None:
    value, digits = DIGITS[name]
    assert value == pytest.approx(digits, rel=1e-6)


@pytest.mark.parametrize("kind", LATTICES)
def test_d18_the_periodic_lattice_has_the_closed_constants(kind: str) -> None:
    for kn, ks in ((DP0.kn, DP0.ks), (1.0, 0.0), (1.0, 3.0)):
        found, wanted = periodic_constants(kind, kn, ks, 0.7), lattice_constants(kind, kn, ks, 0.7)
        for name, value in wanted.items():
            assert found[name] == pytest.approx(value, abs=1e-9 * wanted["C11"])


# Rigid motions --------------------------------------------------------------------------------------------------


def put(sim: bd.Simulation, **fields: Floats) -> None:
    """Set particle fields."""
    for name, values in fields.items():
        with sim.edit(name) as now:
            now[:] = values


def test_d06_rigid_rotation_gives_nothing(engine: str, cluster: Make) -> None:
    """Two turns about (1, 2, 3) in steps of 24 degrees, and a shift at each: no energy, no force, no moment.

    Every other sphere is given minus the quaternion, which is the same orientation.
    """
    model, bonds = cluster()
    assert (len(model), len(bonds.pairs)) == (13, 36)
    sim = bd.Simulation(model, engine=engine)
    axis, _, _ = frame((1.0, 2.0, 3.0))
    signs = (-1.0) ** np.arange(13)[:, None]
    for step in range(1, 31):
        turn = 2.0 * np.pi * step / 15 * axis
        shift = 1e-2 * step * np.array([1.0, -0.5, 0.3])
        put(sim, x=model.x @ rotation_matrix(turn).T + shift, q=signs * quaternion(turn))
        p = sim.particles
        assert np.abs(p.force).max() <= 1e-12 * DP0.kn * DP0.length
        assert np.abs(p.torque).max() <= 1e-12 * DP0.kn * DP0.length**2
        assert sim.energies.strain <= 36 * (1e-12) ** 2 * DP0.kn * DP0.length**2


def test_d06_the_turned_cluster_is_as_stiff(engine: str, cluster: Make) -> None:
    """So that nothing is not all there is: a sphere pushed out after 1.9 turns meets the force it meets at rest."""
    model, _ = cluster()
    sim = bd.Simulation(model, engine=engine)
    turn = 1.9 * 2.0 * np.pi * frame((1.0, 2.0, 3.0))[0]
    out = 1e-5 * frame((-1.0, 0.4, 2.0))[0]
    at_rest = model.x.copy()
    at_rest[4] += out
    put(sim, x=at_rest)
    forces, energy = sim.particles.force, sim.energies.strain
    assert np.abs(forces[4] @ out) >= DP0.ks * out @ out
    put(sim, x=at_rest @ rotation_matrix(turn).T, q=np.tile(quaternion(turn), (13, 1)))
    np.testing.assert_allclose(
        sim.particles.force, forces @ rotation_matrix(turn).T, rtol=0, atol=1e-11 * np.abs(forces).max()
    )
    assert sim.energies.strain == pytest.approx(energy, rel=1e-11)


class State(NamedTuple):
    """Positions, orientations, velocities and spins of a cloud."""

    x: Floats
    q: Floats
    v: Floats
    w: Floats


def random_state(model: bd.Model, seed: int) -> State:
    """Return a state with strains of some per cent, turns of some tenths, speeds that make the dashpots matter."""
    random, n = np.random.default_rng(seed), len(model)
    x = model.x + random.uniform(-2e-4, 2e-4, (n, 3))
    q = np.array([quaternion(turn) for turn in random.uniform(-0.1, 0.1, (n, 3))])
    return State(x, q, random.uniform(-1.0, 1.0, (n, 3)), random.uniform(-200.0, 200.0, (n, 3)))


def assert_same(found: Floats, wanted: Floats, tolerance: float = 1e-12) -> None:
    """Compare relative to the largest magnitude of the wanted values."""
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * np.abs(wanted).max())


@pytest.mark.parametrize("where", ["state", "model"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_d07_turned_cloud(engine: str, cloud: Make, seed: int, where: str) -> None:
    """F(Qx + c) = Q F(x): the state is turned about the model, or the whole model is built in another direction."""
    turn = np.random.default_rng(100 + seed).uniform(-2.0, 2.0, 3)
    Q, p = rotation_matrix(turn), quaternion(turn)
    model, _ = cloud(seed)
    s = random_state(model, seed)
    q = quaternion_product(p, s.q)
    if where == "model":  # whose spheres count their orientation from where they are bonded
        back = quaternion(-turn)
        q = np.array([quaternion_product(one, back) for one in q])
    first = bd.Simulation(model, engine=engine)
    second = bd.Simulation(cloud(seed, Q)[0] if where == "model" else model, engine=engine)
    put(first, x=s.x, q=s.q, v=s.v, w=s.w)
    put(second, x=s.x @ Q.T + [3e-3, -2e-3, 1e-3], q=q, v=s.v @ Q.T, w=s.w @ Q.T)
    assert_same(second.particles.force, first.particles.force @ Q.T)
    assert_same(second.particles.torque, first.particles.torque @ Q.T)
    assert second.energies.strain == pytest.approx(first.energies.strain, rel=1e-12)


def test_d08_moving_cloud(engine: str, cloud: Make, sized: Make) -> None:
    """A common velocity changes no force, and after some steps nothing but the place."""
    model, _ = cloud(4)
    s = random_state(model, 4)
    common = np.array([3.0, -2.0, 5.0])
    rest, moving = (bd.Simulation(model, engine=engine) for _ in range(2))
    put(rest, x=s.x, q=s.q, v=s.v, w=s.w)
    put(moving, x=s.x, q=s.q, v=s.v + common, w=s.w)
    assert_same(moving.particles.force, rest.particles.force)
    assert_same(moving.particles.torque, rest.particles.torque)
    for sim in (rest, moving):
        sim.run(steps=sized(200, 30), quiet=True)
    a, b = rest.particles, moving.particles
    assert_same(b.x - common * moving.time, a.x)
    assert_same(b.v - common, a.v)
    assert_same(b.w, a.w)
    assert_same(b.q, a.q)


# Lattices -------------------------------------------------------------------------------------------------------


class Block:
    """A cube of a lattice, skew in space, that is strained; the middle sphere is number 0."""

    def __init__(self, kind: str, half_width: float) -> None:
        lattice = LATTICES[kind]
        self.axes = np.array(frame((1.0, 2.0, -0.7)))  # rows: the edges of the cube
        spheres = bd.packing.Particles(DP0.length * lattice.sites(half_width) @ self.axes, DP0.radius)
        self.model = bd.Model(spheres, density=DP0.density)
        form = bd.parallel(DP0.E, stiffness_ratio=DP0.E / DP0.G, radius_ratio=DP0.bond_radius / DP0.radius)
        self.bonds = self.model.bond(self.model.touching(gap=0.02), bd.Bond(form))
        number = np.bincount(self.bonds.pairs.ravel(), minlength=len(self.model))
        self.rim = self.model.select(number < 2 * len(lattice.bonds))
        self.own = (self.bonds.pairs == 0).any(axis=1)
        self.near = np.setdiff1d(self.bonds.pairs[self.own], [0])
        self.volume = lattice.volume * DP0.length ** (2 if kind == "triangular" else 3)

    def displacement(self, strain: Floats) -> Floats:
        """Return the displacements (n, 3) of a strain (3, 3) given along the edges of the cube."""
        return self.model.x @ self.axes.T @ strain @ self.axes

    def energy(self, sim: bd.Simulation) -> float:
        """Return the energy per volume [J/m3] of the middle sphere, half that of its bonds."""
        return float(0.5 * sim.bonds(self.bonds).energy[self.own].sum() / self.volume)

    def strain(self, sim: bd.Simulation) -> Floats:
        """Return the strain at the middle sphere along the edges of the cube, from its neighbours, least squares."""
        u = (sim.particles.x - self.model.x) @ self.axes.T
        places = (self.model.x[self.near] - self.model.x[0]) @ self.axes.T
        gradient, *_ = np.linalg.lstsq(places, u[self.near] - u[0], rcond=None)
        return np.asarray(0.5 * (gradient + gradient.T))


def energy_density(kind: str, strain: Floats) -> float:
    """Return the energy per volume [J/m3] that the closed constants give."""
    return float(0.5 * cubic_invariants(strain) @ np.array(list(CONSTANTS[kind].values())))


@pytest.mark.parametrize("kind", LATTICES)
def test_d18_infinite_lattice(engine: str, kind: str) -> None:
    """Moved as one strain, every inner sphere of a block is in the state of the infinite lattice, and in equilibrium.

    The mean over opposite strains has no error of first order in them.
    """
    block = Block(kind, 1.6)
    inner = np.setdiff1d(np.arange(len(block.model)), block.rim.indices)
    sim = bd.Simulation(block.model, engine=engine)
    for strain in STRAINS.values():
        energies = []
        for size in (1e-5, -1e-5):
            put(sim, x=block.model.x + size * block.displacement(strain))
            p = sim.particles
            energies.append(block.energy(sim) / size**2)
            assert np.abs(p.force[inner]).max() <= 1e-4 * np.abs(p.force).max()
            assert np.abs(p.torque[inner]).max() <= 1e-4 * DP0.length * np.abs(p.force).max()
        assert np.mean(energies) == pytest.approx(energy_density(kind, strain), rel=1e-6)


@pytest.mark.parametrize("kind", LATTICES)
def test_d18_finite_block(engine: str, relax: Make, sized: Make, kind: str) -> None:
    """The rim is displaced and free to turn, all else free: energy against strain in the middle, at rest.

    Where every bond is a call of plain Python, one general strain stands for the three that give the constants apart.
    """
    block = Block(kind, 2.45)
    block.model.fix(block.rim, "x y z")
    plane = kind == "triangular"
    general = np.array([[1.0, 0.3, 0.0], [0.3, -0.4, 0.0], [0.0, 0.0, 0.0]])
    factors, energies = [], []
    for strain in sized(list(STRAINS.values()), [general]):
        slowest = 0.8 * (DP0.ks / DP0.mass) ** 0.5
        sim = bd.Simulation(block.model, engine=engine, safety=0.9, damping=bd.viscous(2.0 * slowest))
        with sim.edit("x") as x:
            x[block.rim.indices] += 1e-4 * block.displacement(strain)[block.rim.indices]
        relax(sim, block.rim.indices, held_turns=[], chunk=10)
        factors.append(0.5 * cubic_invariants(block.strain(sim)))
        energies.append(block.energy(sim))
        assert energies[-1] == pytest.approx(energy_density(kind, block.strain(sim)), rel=1e-2)
    if len(energies) == 3:
        found = dict(zip(("C11", "C12", "C44"), np.linalg.solve(factors, energies), strict=True))
        for name, value in CONSTANTS[kind].items():
            assert found[name] == pytest.approx(value, abs=1e-2 * CONSTANTS[kind]["C11"])
        if plane:
            nu, E = plane_net(DP0.kn, DP0.ks)
            assert found["C12"] / found["C11"] == pytest.approx(nu, abs=1e-2)
            assert found["C11"] - found["C12"] ** 2 / found["C11"] == pytest.approx(E, rel=1e-2)
        else:
            wanted = young_100(CONSTANTS[kind]["C11"], CONSTANTS[kind]["C12"])
            assert young_100(found["C11"], found["C12"]) == pytest.approx(wanted, rel=1e-2)
