"""The faults of the paper's public code: that each does what docs/paper-faults.md says, and that none is here."""

import re
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import exp, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles import paper_faults as faults
from oracles.closed_forms import DP0, dashpot, quaternion, quaternion_product, rotation_matrix, tone

import pybondem as bd
from pybondem.examples.pullout_setup import LAYER, PullOutSetup
from pybondem.theory.lattice import calibrate

Floats = NDArray[np.float64]
Make = Callable[..., Any]
ROOT = Path(__file__).resolve().parents[2]
SHORT = 1e-6 * DP0.length  # a displacement with small angles
NOT_MEASURED = {11, 18, 20}
SPRINGS = bd.Bond(bd.springs(DP0.kn, DP0.ks, DP0.kt, DP0.kb))


def rows() -> dict[int, list[str]]:
    """Return the cells of the table's rows by number of the fault."""
    text = (ROOT / "docs" / "paper-faults.md").read_text(encoding="utf-8")
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    return {int(row[0]): row[1:] for row in cells if row[0].isdigit()}


measured = cache(faults.measured)


@pytest.fixture
def joined(engine: str) -> Make:
    """joined(joint): a simulation of two spheres on the y axis across an interface normal to it, and the joint."""

    def make(joint: bd.Joint, held: str = "", dt: float | None = None) -> tuple[bd.Simulation, Any]:
        model = bd.Model(bd.packing.line(2, DP0.length, (0, 1, 0), diameter=2 * DP0.radius), density=DP0.density)
        joints = model.join([[0, 1]], joint, normal=[[0.0, 1.0, 0.0]], area=1e-4)
        if held:
            model.fix(model.select([0, 1]), held)
        return bd.Simulation(model, engine=engine, dt=dt), joints

    return make


def interface(stiffness: float = 1e10, **values: Any) -> bd.Joint:
    """Return a joint that softens from a slip of 1e-5 m on and fails at 1e-4 m."""
    return bd.Joint(bd.bilinear(slip_peak=1e-5, slip_end=1e-4, stiffness=stiffness), **values)


# The table ------------------------------------------------------------------------------------------------------


def test_the_table_lists_the_twenty_faults() -> None:
    assert list(rows()) == list(range(1, 21))
    assert all(len(row) == 3 and all(row) for row in rows().values())
    assert set(measured()) == set(rows()) - NOT_MEASURED


@pytest.mark.parametrize("fault", sorted(set(range(1, 21)) - NOT_MEASURED))
def test_its_numbers_are_those_that_come_out(fault: int) -> None:
    assert measured()[fault] in rows()[fault][1]


def test_it_holds_no_other_measured_number() -> None:
    rest = {n: row[1].replace(measured().get(n, ""), "") for n, row in rows().items()}
    assert {n: text for n, text in rest.items() if re.search(r"\d", text)} == {11: rows()[11][1]}
    assert "figure 4" in rows()[11][1]


def test_the_modules_that_it_names_are_there() -> None:
    named = {name for row in rows().values() for name in re.findall(r"`([\w/]+\.py)`", row[2])}
    assert len(named) > 8
    assert [name for name in sorted(named) if not (ROOT / "src" / "pybondem" / name).is_file()] == []


# Motion ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.05, 0.1, 0.2])
def test_1_a_lagged_position_feeds_an_oscillator(angle: float) -> None:
    assert faults.growth_per_period(faults.lagged_step, angle) == pytest.approx(exp(pi * angle) - 1.0, rel=2 * angle**2)
    assert faults.growth_per_period(faults.verlet_step, angle) == pytest.approx(0.0, abs=1e-9)


def test_1_an_oscillator_keeps_its_amplitude(engine: str, pair: Make, watch: Make) -> None:
    model, _ = pair((1.0, 2.0, 3.0))
    dt = 0.1 / sqrt(2.0 * DP0.kn / DP0.mass)
    sim = bd.Simulation(model, engine=engine, dt=dt)
    with sim.edit("x") as x:
        x[1] *= 1.0 + 10 * SHORT / DP0.length
    length = watch(sim, lambda s: np.linalg.norm(s.particles.x[1] - s.particles.x[0]), samples=300)
    frequency, decay = tone(length - DP0.length, dt)
    assert exp(-decay * 2.0 * pi / frequency) - 1.0 == pytest.approx(0.0, abs=1e-6)


def test_2_spin_damping_of_one_sign_feeds_a_pair() -> None:
    wrong, right = faults.spin_damping(1.0), faults.spin_damping(-1.0)
    assert wrong[:3] == pytest.approx((1.0, -3.0, 5.0), rel=1e-9)
    assert right[:3] == pytest.approx((exp(-4.0), 1.0, 0.5 * (1.0 + exp(-8.0))), rel=1e-3)


def test_2_dashpots_keep_angular_momentum_and_take_energy(engine: str, pair: Make, dp0: Make) -> None:
    model, _ = pair((1.0, 2.0, 3.0), dp0(None, 0.1))
    sim = bd.Simulation(model, engine=engine)
    with sim.edit("w") as w:
        w[1] = (0.3, -0.2, 0.1)

    def momentum() -> Floats:
        p = sim.particles
        return np.asarray((DP0.inertia * p.w + DP0.mass * np.cross(p.x, p.v)).sum(axis=0))

    def kinetic() -> float:
        p = sim.particles
        return float(0.5 * DP0.inertia * (p.w**2).sum() + 0.5 * DP0.mass * (p.v**2).sum())

    before, energy = momentum(), kinetic()
    sim.run(steps=2000, quiet=True)
    assert momentum() == pytest.approx(before, abs=1e-12 * np.linalg.norm(before))
    assert kinetic() < 0.6 * energy  # only the part in which the pair turns as one is left


def test_3_lopsided_damping_turns_a_sphere_one_way() -> None:
    # Between its extremes the spin takes up the torque's impulse, 2 M/(I w), once in each direction.
    back, forth = np.linalg.solve([[1 / 1.07, 1 / 0.3], [1 / 0.93, 1 / 1.7]], [2.0, 2.0])
    assert faults.swing(0.7, 0.07) == pytest.approx((-back, forth), rel=1e-3)
    assert faults.swing(0.7, 0.7) == pytest.approx((-0.51, 0.51), rel=1e-3)


def test_3_local_damping_is_the_same_both_ways(engine: str) -> None:
    alpha, n, dt, torque = 0.7, 200, 1e-6, 1e-3
    model = bd.Model(bd.packing.Particles([[0.0, 0.0, 0.0]], [DP0.radius]), density=DP0.density)
    times = dt * np.arange(16 * n)
    model.push(model.select([0]), tz=bd.table(times, torque * np.cos(2.0 * pi / (n * dt) * times)))
    sim = bd.Simulation(model, engine=engine, dt=dt, damping=bd.local(alpha))
    sim.run(steps=14 * n, quiet=True)
    seen = []
    for _ in range(n // 2):
        sim.run(steps=2, quiet=True)
        seen.append(sim.particles.w[0, 2] * DP0.inertia * 2.0 * pi / (n * dt) / torque)
    assert (min(seen), max(seen)) == pytest.approx((alpha**2 - 1.0, 1.0 - alpha**2), rel=2e-2)


# Interface ------------------------------------------------------------------------------------------------------


def test_4_slip_along_x_alone_is_not_objective() -> None:
    seen = faults.global_slip()
    assert seen.slip == pytest.approx(sqrt(0.5))
    assert seen.breaks == pytest.approx(np.degrees(faults.SLIP_END / 0.5), rel=1e-4)
    assert seen.gain == pytest.approx(4.0, rel=1e-6)


@pytest.mark.parametrize("slipped", [0.0, 1.0])
def test_4_a_rigid_turn_of_a_joint_is_no_slip(joined: Make, slipped: float) -> None:
    sim, joints = joined(interface(normal_stiffness=3e10))
    turn = (0.0, 0.0, pi / 4)
    with sim.edit("x") as x:
        x[1] += slipped * SHORT * np.array([1.0, 0.5, 0.0])
    slip, straight = sim.interface(joints)[0], sim.particles.force
    with sim.edit("x", "q") as (x, q):
        x[:] = x @ rotation_matrix(turn).T
        q[:] = quaternion(turn)
    assert slip == pytest.approx([slipped * SHORT], abs=1e-12 * DP0.length)
    assert sim.interface(joints)[0] == pytest.approx(slip, abs=1e-12 * DP0.length)
    assert sim.particles.force == pytest.approx(straight @ rotation_matrix(turn).T, abs=1e-12 * 3e6 * DP0.length)


def test_4_a_closed_cycle_of_slip_and_spin_yields_nothing(engine: str, joined: Make) -> None:
    sim, _ = joined(interface())
    start, s = sim.particles.x, SHORT
    corners = s * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, -1.0 / DP0.radius], [0.0, -1.0 / DP0.radius], [0.0, 0.0]])
    work = 0.0
    for before, after in pairwise(corners):
        middle = 0.5 * (before + after)
        with sim.edit("x", "q") as (x, q):
            x[:] = start
            x[1, 0] += middle[0]
            q[:] = quaternion((0.0, 0.0, middle[1]))
        p = sim.particles
        work += p.force[1, 0] * (after - before)[0] + p.torque[:, 2].sum() * (after - before)[1]
    assert abs(work) <= 1e-4 * 0.5 * 1e6 * s**2


def test_5_without_normal_stiffness_their_slip_has_no_dashpot() -> None:
    assert faults.slip_left(0.0, 1.0) == pytest.approx(1.0, abs=1e-4)
    assert faults.slip_left(1.0, 1.0) == pytest.approx(exp(-0.3 * 10.0 * pi), rel=0.2)


def test_5_slip_of_a_joint_is_damped_whatever_its_normal_stiffness(joined: Make, watch: Make) -> None:
    k, ratio = 1e10 * 1e-4, 0.3
    dt = 2.0 * pi / sqrt(2.0 * k / DP0.mass) / 100
    sim, _ = joined(interface(normal_stiffness=0.0, damping=ratio), held="rx ry rz", dt=dt)
    with sim.edit("x") as x:
        x[:, 0] += (0.0, SHORT)
    slip = watch(sim, lambda s: np.ptp(s.particles.x[:, 0]) * np.sign(s.particles.x[1, 0] - s.particles.x[0, 0]), 100)
    frequency, decay = tone(slip, dt)
    assert decay / np.hypot(decay, frequency) == pytest.approx(ratio, rel=1e-2)
    assert sim.bonds(sim.model.bonds[0]).cs[0] == pytest.approx(dashpot(ratio, k, DP0.mass / 2))


def test_7_their_failed_pairs_pass_through_one_another() -> None:
    assert faults.passage(0.0).nearest == pytest.approx(0.0, abs=1e-3)
    assert faults.passage(0.0).speed == pytest.approx(1.0)
    assert faults.passage(100.0).speed == pytest.approx(-1.0, rel=1e-3)


@pytest.mark.parametrize("failed", [False, True])
def test_7_a_joint_that_is_pressed_together_throws_back(joined: Make, failed: bool) -> None:
    sim, _ = joined(interface())
    if failed:
        for slip in (2e-4, -2e-4):  # there and back
            with sim.edit("x") as x:
                x[1, 0] += slip
    assert sim.broken == int(failed)
    speed = SHORT * sqrt(2.0 * 1e6 / DP0.mass)
    with sim.edit("v") as v:
        v[:, 1] = (0.5 * speed, -0.5 * speed)
    sim.run(time=pi / sqrt(2.0 * 1e6 / DP0.mass), quiet=True)
    p = sim.particles
    assert p.v[1, 1] - p.v[0, 1] == pytest.approx(speed, rel=2e-2)
    assert p.x[1, 1] - p.x[0, 1] == pytest.approx(DP0.length, rel=1e-6)


# Bonds ----------------------------------------------------------------------------------------------------------


def test_6_their_moments_stay_behind_when_a_pair_turns() -> None:
    turn = faults.rigid_turn()
    assert turn.angle == pytest.approx(90.0)
    assert turn.growth == pytest.approx(exp(0.5 * 628 * 0.01**2) - 1.0, rel=1e-3)


def test_6_the_moment_of_a_bent_pair_turns_with_it(engine: str, pair: Make) -> None:
    model, _ = pair((1.0, 0.0, 0.0), SPRINGS)
    sim = bd.Simulation(model, engine=engine)
    turn = (0.0, 0.0, 0.5 * pi)
    with sim.edit("x", "q") as (x, q):
        x[1] += (0.0, SHORT, 0.0)
        q[1] = quaternion((0.0, 1e-3, 0.0))
    before = sim.particles
    with sim.edit("x", "q") as (x, q):
        x[:] = x @ rotation_matrix(turn).T
        q[:] = quaternion_product(quaternion(turn), q)
    after = sim.particles
    for field in ("force", "torque"):
        straight = getattr(before, field)
        size = np.abs(straight).max()
        assert size > 0.0
        assert getattr(after, field) == pytest.approx(straight @ rotation_matrix(turn).T, abs=1e-12 * size)


@pytest.mark.parametrize(("length", "radii", "part"), [(1.05, (0.5, 0.5), 1 / 21), (3.0, (1.0, 2.0), 1 / 3)])
def test_8_the_couple_of_a_sheared_bond_is_balanced_here(
    engine: str, length: float, radii: tuple[float, float], part: float
) -> None:
    assert faults.lever_arm(radii[0], length) == pytest.approx(part)
    model = bd.Model(bd.packing.Particles([[0.0, 0.0, 0.0], [length, 0.0, 0.0]], radii), density=DP0.density)
    model.bond([[0, 1]], SPRINGS)
    sim = bd.Simulation(model, engine=engine)
    with sim.edit("x") as x:
        x[1, 1] += 1e-3 * length
    p = sim.particles
    couple = np.cross(p.x, p.force).sum(axis=0)
    assert np.linalg.norm(couple) > 0.0
    assert couple + p.torque.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12 * np.linalg.norm(couple))


def test_12_bonds_have_the_modulus_that_is_asked_for(engine: str, pair: Make) -> None:
    model, bonds = pair((1.0, 2.0, 3.0))
    assert bd.Simulation(model, engine=engine).bonds(bonds).kn[0] == pytest.approx(DP0.kn)
    shipped = faults.bond_modulus()
    assert shipped.bond == pytest.approx(1.0 / (2.0 * 0.96))
    for d, ratio in shipped.bulk.items():
        kn, ks = calibrate("hcp", 1.0, 0.1, d)
        assert 6.0 * sqrt(2.0) * kn * (kn + ks) / (d * (5.0 * kn + ks)) == pytest.approx(1.0)
        exact = 8.0 * 0.96 / (2.0 * sqrt(2.0) * pi * 0.6)  # of the factor, at nu = 0.2
        assert ratio == pytest.approx(faults.HAND_FACTORS[d][0] / exact, rel=0.03)


# Loading --------------------------------------------------------------------------------------------------------


def test_9_their_first_wave_exceeds_the_quasi_static_stress() -> None:
    hit = faults.impact()
    assert hit.stress == pytest.approx(sqrt(5e10 * 6000.0 * 0.74048) * 10.0, rel=1e-4)
    assert hit.stress / hit.peak > 25.0
    assert faults.impact(speed=5e-3).stress < 0.02 * hit.peak


@pytest.mark.parametrize("sudden", [True, False])
def test_9_a_smooth_start_is_quasi_static_where_a_sudden_one_sends_a_wave(
    engine: str, chain: Make, sudden: bool
) -> None:
    n, transits, speed = 12, 30, 1e-3
    model, _ = chain(n, (1.0, 0.0, 0.0), SPRINGS)
    model.fix(model.select([0]))
    crossing = n * sqrt(DP0.mass / DP0.kn)
    duration = 0.6 * crossing if sudden else transits * crossing
    model.drive(model.select([n - 1]), vx=bd.hold(speed) if sudden else bd.smooth(speed, over=duration))
    sim = bd.Simulation(model, engine=engine)
    forces = []
    while sim.time < duration:
        sim.run(steps=4, quiet=True)
        forces.append(-sim.particles.force[-1, 0])
    if sudden:
        assert np.mean(forces[len(forces) // 4 :]) == pytest.approx(speed * sqrt(DP0.kn * DP0.mass), rel=0.05)
    else:
        moved = sim.particles.x[-1, 0] - (n - 1) * DP0.length
        assert forces[-1] == pytest.approx(DP0.kn * moved / (n - 1), rel=0.05)


def test_10_their_cycles_of_eleven_steps_end_off_the_start() -> None:
    assert faults.unloading_offset() == pytest.approx(22 * 10.0 * 1e-5 / 3e-3)


def test_10_a_driven_end_turns_back_without_a_jump_and_ends_where_it_should(engine: str, chain: Make) -> None:
    model, _ = chain(3, (0.6, 0.8, 0.0), SPRINGS)
    speed, unit = 1e-3, 1e-4
    path = bd.table(
        unit * np.array([0.0, 1.0, 2.0, 3.0, 11 / 3, 13 / 3]), speed * np.array([0.0, 1.0, 1.0, 0, -3.0, 0])
    )
    model.fix(model.select([0]))
    model.drive(model.select([2]), vx=path, vy=0.0, vz=0.0)
    sim = bd.Simulation(model, engine=engine, dt=13 / 3 * unit / 137)  # its corners fall between steps
    start, seen = sim.particles.x, [sim.particles.v[2]]
    for _ in range(137):
        sim.run(steps=1, quiet=True)
        seen.append(sim.particles.v[2])
    assert np.min(seen) < -2.8 * speed
    assert np.abs(np.diff(seen, axis=0)).max() <= 1.001 * 4.5 * speed * sim.dt / unit
    assert sim.particles.x[2] == pytest.approx(start[2], abs=1e-12 * DP0.length)
    assert np.array_equal(sim.particles.x[0], start[0])


def test_17_a_sum_of_steps_is_not_what_it_looks_like() -> None:
    assert faults.steps_to_equality() == (None, 1.2000000000000004)


# Sample ---------------------------------------------------------------------------------------------------------


def test_13_their_free_length_depends_on_the_spheres() -> None:
    free = {d: faults.sample(d).free for d in (0.5, 0.7, 1.0, 2.0)}
    assert free == pytest.approx({d: LAYER * d * (round(40 / d + 20) - 1) - 35.0 for d in free})
    assert max(free.values()) > 5.0 * min(free.values())


@pytest.mark.parametrize("d", [0.5, 0.7, 1.0, 2.0])
def test_13_the_free_length_is_what_is_asked_for(d: float) -> None:
    setup = PullOutSetup(diameter=d, free_length=8.0)
    assert abs(setup.fitted_free_length - 8.0) <= 0.5 * LAYER * setup.fitted_diameter


@pytest.mark.parametrize("d", [1.0, 0.7])
def test_14_shared_cell_numbers_find_pairs_twice_and_right_ones_do_not(d: float) -> None:
    x = faults.sample(d).x
    every = np.unique(np.sort(faults.neighbours(x, d), axis=1), axis=0)
    for mixed in (True, False):
        found = faults.cell_search(x, d, mixed)
        once = np.unique(np.sort(found.pairs, axis=1), axis=0)
        assert np.array_equal(once, every)
        assert (len(found.pairs) > len(once)) == (mixed and d == 1.0)
        assert (found.past > 0) == mixed


def test_14_touching_finds_what_brute_force_finds() -> None:
    x = faults.sample(1.0).x
    model = bd.Model(bd.packing.Particles(x, np.full(len(x), 0.5)), density=faults.DENSITY)
    pairs = model.touching(gap=0.05)
    brute = [np.flatnonzero(((x[i + 1 :] - x[i]) ** 2).sum(axis=1) <= 1.05**2) + i + 1 for i in range(len(x))]
    assert pairs.tolist() == [[i, j] for i, others in enumerate(brute) for j in others.tolist()]


@pytest.mark.parametrize(("spacing", "wrong"), [(3.0, 270), (3.6, 270)])
def test_15_a_reach_of_one_sphere_fails_for_two_sizes(spacing: float, wrong: int) -> None:
    x, radius = faults.checkerboard(spacing)
    right = faults.pairs_by_reach(x, radius, of_one=False)
    assert len(right) == (540 if spacing == 3.0 else 0)
    assert len(faults.pairs_by_reach(x, radius, of_one=True) ^ right) == wrong
    model = bd.Model(bd.packing.Particles(x, radius), density=DP0.density)
    assert {tuple(pair) for pair in model.touching(gap=0.05).tolist()} == right


def test_16_blocks_of_sixteen_leave_three_quarters_of_the_threads_out() -> None:
    assert [faults.resident_threads(block) for block in (16, 32, 64, 128)] == [2560, 5120, 10240, 10240]


@pytest.mark.parametrize("d", [0.5, 0.7, 1.0, 2.0])
def test_19_hand_made_areas_miss_and_ours_fill_the_interface(d: float) -> None:
    off = {0.5: 0.0, 0.7: 0.0, 1.0: -0.0184, 2.0: -0.7906}[d]
    assert faults.interface_area(d) - 1.0 == pytest.approx(off, abs=1e-4)
    there = faults.sample(d)
    assert (3 in there.kind) == (d < 2.0)  # whether there is an end to pull
    model = bd.Model()
    for name, kinds in (("fibre", (2, 3)), ("matrix", (0, 1))):
        x = there.x[np.isin(there.kind, kinds)]
        model.add(bd.packing.Particles(x, np.full(len(x), 0.5 * d)), name=name, density=faults.DENSITY)
    surface = bd.interface.cylindrical(
        model, "fibre", "matrix", radius=faults.FIBRE_RADIUS, length=faults.LENGTH, base=(faults.TIP, 0.0, 0.0)
    )
    assert surface.area.sum() == pytest.approx(2.0 * pi * faults.FIBRE_RADIUS * faults.LENGTH)
