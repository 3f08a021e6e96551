"""The order of convergence of the whole step: translation, rotation, bond and dashpots, against closed forms and
equations of motion written down apart.
"""

from itertools import pairwise

import numpy as np
import pytest
from engines.scenes import DT, cluster, families, loaded, quaternions, rotations
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import pybondem as bd

RADIUS, MASS = 5e-3, 2500.0 * 4.0 / 3.0 * np.pi * 5e-3**3
INERTIA = 0.4 * MASS * RADIUS**2
KN, KS, KT, KB = 5e6, 2e6, 20.0, 22.0
ALONG = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
ACROSS = np.array([2.0, -1.0, 0.0]) / np.sqrt(5.0)
AXIS = np.cross(ALONG, ACROSS)


def pair(engine, dt, damping=0.0):
    """Return two equal bonded spheres that touch, along a skew line through the origin."""
    model = bd.Model(bd.packing.Particles([-RADIUS * ALONG, RADIUS * ALONG], RADIUS), density=2500.0)
    model.bond([[0, 1]], bd.Bond(bd.springs(kn=KN, ks=KS, kt=KT, kb=KB), damping=damping))
    return bd.Simulation(model, engine=engine, dt=dt)


def order(error_at, steps=(100, 200, 400)):
    """Return the orders of convergence seen between successive numbers of steps for the same time."""
    errors = [np.linalg.norm(error_at(n)) for n in steps]
    return np.log(np.divide(errors[:-1], errors[1:])) / np.log(np.divide(steps[1:], steps[:-1]))


def test_the_shear_mode_converges_with_the_square_of_the_step(engine):
    """D05: the free mode w2 = -w1, th1 = th2 = -2.5 w2/R, against w0 cos(sqrt(7 ks/m) t)."""
    omega, size = np.sqrt(7.0 * KS / MASS), 1e-8
    end = 2.3 * 2.0 * np.pi / omega

    def error(n):
        sim = pair(engine, end / n)
        with sim.edit("x", "q") as (x, q):
            x += size * np.outer([-1.0, 1.0], ACROSS)
            q[:] = quaternions(Rotation.from_rotvec(np.outer([1.0, 1.0], -2.5 * size / RADIUS * AXIS)))
        p = sim.run(n, quiet=True).particles
        shear = 0.5 * (p.x[1] - p.x[0]) @ ACROSS / size
        turn = rotations(p.q).as_rotvec() @ AXIS * RADIUS / (-2.5 * size)
        return np.array([shear, *turn]) - np.cos(omega * end)

    assert order(error) == pytest.approx([2.0, 2.0], abs=0.05)
    assert np.abs(error(400)).max() < 2e-3


def test_a_spinning_stretched_pair_converges_with_the_square_of_the_step(engine):
    """Chord and bodies turn at different rates, so that stretch, shear and rotation couple.

    Truth: Lagrange's equations of the plane motion, T = m (r'^2 + r^2 phi'^2)/4 + I theta'^2,
    U = kn (r - L)^2/2 + ks L^2 sin^2(phi - theta)/2, by an integrator of order 8.
    """
    L, end = 2.0 * RADIUS, 2e-4
    start = (1.01 * L, 0.0, 0.0, 3.0, 6000.0, 3000.0)  # r, phi, theta and their rates

    def lagrange(_, state):
        r, phi, theta, r1, phi1, theta1 = state
        shear = KS * L * L * np.sin(phi - theta) * np.cos(phi - theta)
        r2 = r * phi1**2 - 2.0 * KN * (r - L) / MASS
        return r1, phi1, theta1, r2, (-2.0 * shear / MASS - 2.0 * r * r1 * phi1) / r**2, shear / (2.0 * INERTIA)

    truth = solve_ivp(lagrange, (0.0, end), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]

    def error(n):
        sim = pair(engine, end / n)
        with sim.edit("x", "v", "w") as (x, v, w):
            x[:] = np.outer([-0.5, 0.5], start[0] * ALONG)
            v[:] = np.outer([-0.5, 0.5], start[3] * ALONG + start[0] * start[4] * ACROSS)
            w[:] = start[5] * AXIS
        p = sim.run(n, quiet=True).particles
        chord = p.x[1] - p.x[0]
        phi = np.arctan2(chord @ ACROSS, chord @ ALONG)
        theta = rotations(p.q).as_rotvec() @ AXIS
        return np.array([np.linalg.norm(chord) / L, phi, *theta]) - [truth[0] / L, truth[1], truth[2], truth[2]]

    assert truth[1] > 0.5  # it turns far
    assert order(error) == pytest.approx([2.0, 2.0], abs=0.05)
    assert np.abs(error(400)).max() < 1e-3


def test_a_damped_pair_converges_with_the_square_of_the_step(engine):
    """D20: the axial mode against exp(-zeta w t) (cos + zeta/sqrt(1-zeta^2) sin)(wd t)."""
    zeta, size = 0.2, 1e-8
    omega = np.sqrt(2.0 * KN / MASS)
    damped = omega * np.sqrt(1.0 - zeta**2)
    end = 1.7 * 2.0 * np.pi / omega
    decay = np.exp(-zeta * omega * end)
    truth = decay * (np.cos(damped * end) + zeta / np.sqrt(1.0 - zeta**2) * np.sin(damped * end))
    truth_speed = -decay * omega / np.sqrt(1.0 - zeta**2) * np.sin(damped * end)

    def error(n):
        sim = pair(engine, end / n, damping=zeta)
        with sim.edit("x") as x:
            x += size * np.outer([-0.5, 0.5], ALONG)
        p = sim.run(n, quiet=True).particles
        stretch = (p.x[1] - p.x[0]) @ ALONG - 2.0 * RADIUS
        return np.array([stretch / size - truth, ((p.v[1] - p.v[0]) @ ALONG / size - truth_speed) / omega])

    assert order(error, (200, 400, 800)) == pytest.approx([2.0, 2.0], abs=0.05)
    assert np.abs(error(800)).max() < 2e-4


def test_a_whole_cluster_converges_with_the_square_of_the_step(engine):
    """Every elastic form and joint with dashpots, large motion; successive differences fall by four."""
    scene = loaded(cluster(15, families(toughness=1e3)), 15, strain=0.01, turn=0.01)
    end = 40 * DT
    states = [scene.build(engine, dt=end / n).run(n, quiet=True).particles for n in (40, 80, 160, 320)]
    for name in ("x", "q", "v", "w"):
        sizes = [np.linalg.norm(getattr(b, name) - getattr(a, name)) for a, b in pairwise(states)]
        assert np.log2(np.divide(sizes[:-1], sizes[1:])) == pytest.approx([2.0, 2.0], abs=0.05), name
