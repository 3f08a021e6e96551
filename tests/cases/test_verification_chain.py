"""Verification D12 and D14-D17: beams, bars and chains of spheres, through the public API, on every engine.

Each problem lies in a direction of its own, skew to the axes. Static answers are relaxed, with global damping at the
critical rate of the lowest mode, until nothing unbalanced is left above 1e-8 of the load.
"""

from collections.abc import Callable
from math import pi
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import (
    DP0,
    EARTH,
    cantilever_couple,
    cantilever_force,
    cantilever_frequency,
    dispersion,
    fixed_fixed_frequency,
    fixed_fixed_shape,
    fixed_free_frequency,
    fixed_free_shape,
    frame,
    group_velocity,
    hanging_end,
    period,
    timoshenko_deflection,
    tone,
)

import pybondem as bd

Floats = NDArray[np.float64]
Make = Callable[..., Any]
MODULUS = DP0.bending_area / DP0.bond_radius
DIGITS = {
    "D12 force: deflection": (cantilever_force(DP0, 10, 1.0)[0], 1.658140e-3),
    "D12 force: rotation": (cantilever_force(DP0, 10, 1.0)[1], 24.86796e-3),
    "D12 couple: deflection": (cantilever_couple(DP0, 10, 0.05)[0], 1.243398e-3),
    "D12 couple: rotation": (cantilever_couple(DP0, 10, 0.05)[1], 24.86796e-3),
    "D12 axial": (10 * 100.0 / DP0.kn, 0.1989437e-3),
    "D12 stress at the root": (1.0 * 9.5 * DP0.length / MODULUS, 1.889965e6),
    "D12 continuum": (timoshenko_deflection(DP0, 10, 1.0), 1.662285e-3),
    "D14 twist": (20 / DP0.kt, 1.105243),
    "D14 frequency": (fixed_free_frequency(DP0.kt, DP0.inertia, 20) / (2 * pi), 453.3115),
    "D15 end": (hanging_end(DP0, 25, EARTH), 0.8302734e-6),
    "D15 top bond": (25 * DP0.mass * EARTH, 0.3210315),
    "D16 mode 1": (fixed_fixed_frequency(DP0.kn, DP0.mass, 9, 1) / (2 * pi), 3085.661),
    "D16 mode 5": (fixed_fixed_frequency(DP0.kn, DP0.mass, 9, 5) / (2 * pi), 13947.64),
    "D16 mode 9": (fixed_fixed_frequency(DP0.kn, DP0.mass, 9, 9) / (2 * pi), 19482.10),
    "D17 qa = 0.1": (dispersion(DP0, 0.1), 6194.192),
    "D17 qa = pi/2": (dispersion(DP0, 0.5 * pi), 87635.61),
    "D17 qa = pi": (dispersion(DP0, pi), 123935.5),
    "D17 sound": (group_velocity(DP0, 0.0), 619.6773),
    "D17 group velocity at pi/2": (group_velocity(DP0, 0.5 * pi), 438.1780),
}


@pytest.mark.parametrize("name", DIGITS)
def test_the_closed_forms_give_the_known_digits(name: str) -> None:
    value, digits = DIGITS[name]
    assert value == pytest.approx(digits, rel=1e-6)


def vector(prefix: str, value: Floats) -> dict[str, float]:
    """Return the three components of a force (f) or torque (t) as arguments of push."""
    return {f"{prefix}{axis}": float(value[k]) for k, axis in enumerate("xyz")}


def rotation(q: Floats) -> Floats:
    """Return the rotation vector of a quaternion close to identity [rad]."""
    size = float(np.linalg.norm(q[1:]))
    return q[1:] * (2.0 * np.arctan2(size, q[0]) / size if size > 0.0 else 2.0)


def test_d12_bent_cantilever(engine: str, chain: Make, relax: Make, sized: Make) -> None:
    """A tip force along t and a tip couple about t bend the beam in two planes at once, both 1/50 of full load."""
    N = sized(10, 5)
    n, t, b = frame((1.0, -1.4, 0.6))
    model, _ = chain(N + 1, n, start=-0.5 * N * DP0.length * n)
    P, C = 0.02, 0.001
    model.fix(model.select([0]))
    model.push(model.select([N]), **vector("f", P * t), **vector("t", C * t))
    rate = 2.0 * cantilever_frequency(DP0, N)
    sim = bd.Simulation(model, engine=engine, safety=0.9, damping=bd.viscous(rate))
    p = relax(sim, [0], load=P)
    moved, turned = p.x[N] - model.x[N], rotation(p.q[N])
    deflection, slope = cantilever_force(DP0, N, P)
    assert moved @ t == pytest.approx(deflection, rel=1e-6)
    assert turned @ b == pytest.approx(slope, rel=1e-6)
    deflection, slope = cantilever_couple(DP0, N, C)
    assert moved @ -b == pytest.approx(deflection, rel=1e-6)  # a turn about t takes n towards -b
    assert turned @ t == pytest.approx(slope, rel=1e-6)
    lever = 0.5 * DP0.length * np.cross(n, p.force[0])  # from the clamped centre to the middle of the first bond
    at_root = p.torque[0] - lever
    assert p.force[0] @ t == pytest.approx(P, rel=1e-6)
    assert at_root @ b == pytest.approx(P * (N - 0.5) * DP0.length, rel=1e-6)
    assert at_root @ t == pytest.approx(C, rel=1e-6)


def test_d12_pulled_bar(engine: str, chain: Make, relax: Make) -> None:
    n, _, _ = frame((1.0, -1.4, 0.6))
    model, _ = chain(11, n)
    model.fix(model.select([0]))
    model.push(model.select([10]), **vector("f", 100.0 * n))
    rate = 2.0 * fixed_free_frequency(DP0.kn, DP0.mass, 10)
    sim = bd.Simulation(model, engine=engine, safety=0.9, damping=bd.viscous(rate))
    root, tip = model.select([0]), model.select([10])
    seen = sim.record(every=50, force=bd.reaction(root, "y"), moved=bd.displacement(tip, "y"))
    p = relax(sim, [0])
    assert (seen["force"].last, seen["moved"].last) == pytest.approx((100.0 * n[1], 1000.0 / DP0.kn * n[1]), rel=1e-6)
    stretched = np.arange(11) * 100.0 / DP0.kn
    np.testing.assert_allclose(p.x - model.x, np.outer(stretched, n), rtol=0, atol=1e-6 * stretched[-1])
    np.testing.assert_allclose(p.force[0], 100.0 * n, rtol=0, atol=1e-4)


def test_d14_twisted_bar(engine: str, chain: Make, relax: Make) -> None:
    N = 20
    n, _, _ = frame((0.2, 1.0, -0.5))
    model, _ = chain(N + 1, n)
    model.fix(model.select([0]))
    model.push(model.select([N]), **vector("t", 0.05 * n))
    rate = 2.0 * fixed_free_frequency(DP0.kt, DP0.inertia, N)
    sim = bd.Simulation(model, engine=engine, safety=0.9, damping=bd.viscous(rate))
    p = relax(sim, [0])
    turned = np.array([rotation(q) for q in p.q])
    wanted = 0.05 * np.arange(N + 1) / DP0.kt
    np.testing.assert_allclose(turned, np.outer(wanted, n), rtol=0, atol=1e-4 * wanted[-1])
    np.testing.assert_allclose(p.torque[0], 0.05 * n, rtol=0, atol=1e-4 * 0.05)


def test_d14_torsional_mode(engine: str, chain: Make, watch: Make) -> None:
    N = 20
    n, _, _ = frame((0.2, 1.0, -0.5))
    model, _ = chain(N + 1, n)
    model.fix(model.select([0]))
    true = 2.0 * pi / fixed_free_frequency(DP0.kt, DP0.inertia, N)
    sim = bd.Simulation(model, engine=engine, dt=true / 400)
    shape = fixed_free_shape(N)
    with sim.edit("w") as w:
        w[:] = np.outer(shape, n)
    spins = watch(sim, lambda s: s.particles.w @ n, 50, every=10)
    assert period(spins[:, N], 10 * sim.dt) == pytest.approx(true, rel=1e-3)
    np.testing.assert_allclose(spins, np.outer(spins[:, N], shape / shape[N]), rtol=0, atol=1e-9)


def test_d15_hanging_chain(engine: str, chain: Make, relax: Make) -> None:
    N, down = 25, frame((-0.3, 0.5, -1.0))[0]
    model, bonds = chain(N + 1, down)
    model.fix(model.select([0]))
    rate = 2.0 * fixed_free_frequency(DP0.kn, DP0.mass, N)
    sim = bd.Simulation(model, engine=engine, safety=0.9, damping=bd.viscous(rate), gravity=EARTH * down)
    p = relax(sim, [0])
    sunk = (p.x - model.x) @ down
    weight = DP0.mass * EARTH
    assert sunk[N] == pytest.approx(hanging_end(DP0, N, EARTH), rel=1e-6)
    assert sunk[1] == pytest.approx(N * weight / DP0.kn, rel=1e-6)
    on_top = p.force[0] - weight * down  # the force on a sphere holds its own weight
    np.testing.assert_allclose(on_top, N * weight * down, rtol=0, atol=1e-6 * N * weight)
    carried = weight * np.arange(N, 0, -1)
    np.testing.assert_allclose(sim.bonds(bonds).force @ down, carried, rtol=0, atol=1e-6 * N * weight)
    np.testing.assert_allclose(sim.bonds(bonds).energy, 0.5 * carried**2 / DP0.kn, rtol=1e-5)


@pytest.mark.parametrize("mode", [1, 5, 9])
def test_d16_axial_modes(engine: str, chain: Make, watch: Make, mode: int) -> None:
    n, _, _ = frame((2.0, 0.3, -1.0))
    model, _ = chain(11, n)
    model.fix(model.select([0, 10]))
    true = 2.0 * pi / fixed_fixed_frequency(DP0.kn, DP0.mass, 9, mode)
    sim = bd.Simulation(model, engine=engine, dt=true / 200)
    shape = fixed_fixed_shape(9, mode)
    with sim.edit("v") as v:
        v[:] = 1e-3 * np.outer(shape, n)
    speeds = watch(sim, lambda s: s.particles.v @ n, 25, every=10)
    assert period(speeds[:, 1], 10 * sim.dt) == pytest.approx(true, rel=1e-3)
    np.testing.assert_allclose(speeds, np.outer(speeds[:, 1], shape / shape[1]), rtol=0, atol=1e-9)


def infinite_chain_frequency(engine: str, chain: Make, watch: Make, qa: float) -> float:
    """Return the frequency [rad/s] of a standing wave cos(qa i) in the middle of a chain, before its ends are felt.

    Nothing travels faster than sound, one bond per sqrt(m/kn); ten bonds more keep out what leaks ahead of it.
    """
    n, _, _ = frame((-0.8, 0.6, 1.1))
    wanted = 0.26 * 2.0 * pi / dispersion(DP0, qa)
    middle = int(np.ceil(wanted / (DP0.mass / DP0.kn) ** 0.5)) + 10
    model, _ = chain(2 * middle + 1, n, start=-middle * DP0.length * n)
    steps = 60
    sim = bd.Simulation(model, engine=engine, dt=wanted / steps)
    wave = np.cos(qa * (np.arange(2 * middle + 1) - middle))
    with sim.edit("x") as x:
        x += 1e-6 * np.outer(wave, n)
    moved = watch(sim, lambda s: (s.particles.x[middle] - model.x[middle]) @ n, steps // 5, every=5)
    return tone(moved, 5 * sim.dt)[0]


@pytest.mark.parametrize("qa", [0.1, 0.5 * pi, pi])
def test_d17_dispersion(engine: str, chain: Make, watch: Make, qa: float) -> None:
    assert infinite_chain_frequency(engine, chain, watch, qa) == pytest.approx(dispersion(DP0, qa), rel=1e-3)


def test_d17_sound(engine: str, chain: Make, watch: Make) -> None:
    speed = infinite_chain_frequency(engine, chain, watch, 0.1) / 0.1 * DP0.length
    assert speed == pytest.approx(group_velocity(DP0, 0.0), rel=1e-3)


def test_d17_group_velocity(engine: str, chain: Make, watch: Make) -> None:
    """dw/dq by central differences over 0.1, which is off by 4e-4."""
    low, high = (infinite_chain_frequency(engine, chain, watch, 0.5 * pi + d) for d in (-0.05, 0.05))
    assert (high - low) / 0.1 * DP0.length == pytest.approx(group_velocity(DP0, 0.5 * pi), rel=1e-3)
