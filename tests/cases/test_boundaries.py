"""Boundary conditions and damping: schedules, held and driven components, pushes, reactions, and who pays for what.

Every problem is held against a closed form, and its energy book against nothing: kinetic + strain + gravity + what
damping took - the work of the boundaries.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import pybondem as bd
from pybondem.schedules import Hold, as_schedule, average

KN, KS, KT, KB = 5e6, 2e6, 20.0, 25.0
RADIUS, DENSITY = 5e-3, 2500.0
MASS = 4.0 / 3.0 * np.pi * RADIUS**3 * DENSITY
INERTIA = 0.4 * MASS * RADIUS**2
DT = 1e-6
quick = settings(max_examples=100, deadline=None, derandomize=True)


def row(n, engine, prepare, **options):
    """Return a simulation of n touching spheres bonded in a row along x; prepare(model) sets the boundaries."""
    model = bd.Model(bd.packing.line(n, spacing=2 * RADIUS, diameter=2 * RADIUS), density=DENSITY)
    if n > 1:
        model.bond(model.touching(), bd.Bond(bd.springs(kn=KN, ks=KS, kt=KT, kb=KB)))
    prepare(model)
    return bd.Simulation(model, engine=engine, **({"dt": DT} | options))


# Schedules ------------------------------------------------------------------------------------------------------


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def schedules(draw):
    """Draw a schedule, its value as a plain function, and the times where that has kinks."""
    to, over = draw(numbers(-5.0, 5.0)), draw(numbers(0.1, 2.0))
    kind = draw(st.sampled_from(["hold", "ramp", "smooth", "table"]))
    if kind == "hold":
        return bd.hold(to), lambda t: to, []
    if kind == "ramp":
        return bd.ramp(to, over), lambda t: to * min(max(t / over, 0.0), 1.0), [0.0, over]
    if kind == "smooth":
        return (
            bd.smooth(to, over),
            lambda t: to * (3.0 - 2.0 * min(t / over, 1.0)) * min(t / over, 1.0) ** 2,
            [0.0, over],
        )
    start = draw(numbers(-1.0, 1.0))
    times = start + np.cumsum([0.0, *draw(st.lists(numbers(0.05, 0.7), max_size=4))])
    values = [draw(numbers(-5.0, 5.0)) for _ in times]
    return bd.table(times, values), lambda t: float(np.interp(t, times, values)), times.tolist()


@quick
@given(drawn=schedules(), t=numbers(0.0, 3.0))
def test_a_schedule_and_its_integral(drawn, t):
    """The value as published; the integral from 0 by adaptive quadrature between the kinks."""
    schedule, value, kinks = drawn
    assert schedule.value(np.array([t]))[0] == pytest.approx(value(t), abs=1e-13)
    ends = [0.0, *sorted(k for k in kinks if 0.0 < k < t), t]
    area = sum(quad(value, a, b, epsabs=1e-13)[0] for a, b in pairwise(ends))
    assert schedule.integral(np.array([t]))[0] == pytest.approx(area, abs=1e-12)


@quick
@given(drawn=schedules(), times=st.lists(numbers(0.0, 3.0), min_size=2, max_size=6, unique=True).map(sorted))
def test_the_mean_over_steps_adds_up_to_the_integral(drawn, times):
    schedule, t = drawn[0], np.array(times)
    if np.diff(t).min() < 1e-3:
        return
    means = average(schedule, t)
    assert means @ np.diff(t) == pytest.approx(np.diff(schedule.integral(t[[0, -1]]))[0], abs=1e-12)


def test_a_number_is_a_schedule():
    assert as_schedule("vx", 3) == Hold(3.0)
    assert as_schedule("vx", np.float32(0.5)) == Hold(0.5)
    schedule = bd.ramp(to=1.0, over=2.0)
    assert as_schedule("vx", schedule) is schedule


# Held and driven ------------------------------------------------------------------------------------------------

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


@pytest.mark.parametrize("held", [*COMPONENTS, "x ry", "y z rx", "x y z rx ry rz"])
def test_held_components_stay_and_the_others_move(engine, held):
    """Of the middle of three spheres of which the outer ones move and turn in every direction."""
    sim = row(3, engine, lambda m: m.fix(m.select([1]), held))
    start = sim.particles
    with sim.edit("v", "w") as (v, w):
        v[:], w[:] = [[1.0, 2.0, 3.0]] * 3, [[300.0, 200.0, 100.0]] * 3
        v[0] *= -1.0
    sim.run(40, quiet=True)
    p = sim.particles
    motion = np.concatenate([p.v[1], p.w[1]])
    turn = Rotation.from_quat(np.roll(p.q[1], -1)).as_rotvec()
    moved = np.concatenate([p.x[1] - start.x[1], turn])
    for c, name in enumerate(COMPONENTS):
        if name in held.split():
            assert motion[c] == 0.0
            assert moved[c] == 0.0 or c > 2  # turning about two axes is no turn about either
        else:
            assert motion[c] != 0.0
            assert moved[c] != 0.0


DRIVES = {
    "hold": bd.hold(3.0),
    "ramp": bd.ramp(to=4.0, over=33.3 * DT),
    "smooth": bd.smooth(to=-5.0, over=71.7 * DT),
    "table": bd.table([5.5 * DT, 20.2 * DT, 20.9 * DT, 60.0 * DT], [2.0, -3.0, 8.0, 1.0]),
}


@pytest.mark.parametrize("name", DRIVES)
def test_a_driven_particle_is_where_its_schedule_says(engine, name):
    """To round-off, with kinks in mid-step, bonds pulling at it, whatever the blocks that the run is cut into."""
    schedule = DRIVES[name]
    sim = row(3, engine, lambda m: m.drive(m.select([2]), vx=schedule, vz=-1.5, wy=schedule))
    start = sim.particles.x[2]
    for steps in (1, 2, 30, 67):
        sim.run(steps, quiet=True)
        p = sim.particles
        path = np.diff(schedule.integral(np.array([0.0, sim.time])))[0]
        assert p.x[2, 0] - start[0] == pytest.approx(path, abs=1e-16)
        assert p.x[2, 2] - start[2] == pytest.approx(-1.5 * sim.time, abs=1e-16)
        assert p.w[2, 1] == pytest.approx(p.v[2, 0], rel=1e-15)


def test_a_driven_spin_turns_by_its_integral(engine):
    spin = bd.smooth(to=3e4, over=50 * DT)
    sim = row(1, engine, lambda m: m.drive(m.select([0]), wx=spin, wy=0.0, wz=0.0)).run(80, quiet=True)
    angle = spin.integral(np.array([sim.time]))[0]
    assert 0.5 < angle < np.pi
    assert Rotation.from_quat(np.roll(sim.particles.q[0], -1)).as_rotvec() == pytest.approx(
        [angle, 0.0, 0.0], abs=1e-14
    )


PUSHES = {
    "hold": (bd.hold(3.0), 50),
    "ramp": (bd.ramp(to=4.0, over=20 * DT), 50),
    "table": (bd.table([0.0, 10 * DT, 40 * DT], [6.0, -3.0, 5.0]), 50),
}


@pytest.mark.parametrize("name", PUSHES)
def test_a_pushed_particle_gains_the_impulse(engine, name):
    """m v = int F dt, I w = int T dt to round-off, for pushes that are linear in each step; the first step counts."""
    push, steps = PUSHES[name]
    prepare = lambda m: m.push(m.select([0]), fx=push, fz=-2.0, ty=push)  # noqa: E731
    sim = row(1, engine, prepare)
    assert sim.particles.force[0] == pytest.approx([push.value(np.zeros(1))[0], 0.0, -2.0], abs=1e-15)
    for n in (1, 6, steps - 7):
        sim.run(n, quiet=True)
        impulse, p = np.diff(push.integral(np.array([0.0, sim.time])))[0], sim.particles
        assert p.v[0] * MASS == pytest.approx([impulse, 0.0, -2.0 * sim.time], abs=1e-13 * steps * DT * 6.0)
        assert p.w[0] * INERTIA == pytest.approx([0.0, impulse, 0.0], abs=1e-13 * steps * DT * 6.0)
        assert p.force[0, 0] == pytest.approx(push.value(np.array([sim.time]))[0], rel=1e-12)
        assert abs(sim.energies.residual) <= 1e-12 * sim.energies.work


# Work and reactions ---------------------------------------------------------------------------------------------


def test_a_drive_works_by_the_force_it_meets_along_the_way(engine):
    """Against the trapezoid rule over the forces and displacements seen, step by step; gravity on; book closed."""

    def prepare(model):
        model.fix(model.select([0]))
        model.drive(model.select([3]), vx=bd.smooth(to=0.5, over=100 * DT), vy=-0.2, wz=bd.ramp(to=5.0, over=50 * DT))

    sim = row(4, engine, prepare, gravity=(3.0, -9.81, 0.0))
    before, work = sim.particles, 0.0
    for _ in range(200):
        p = sim.run(1, quiet=True).particles
        work -= 0.5 * (before.force[3] + p.force[3]) @ (p.x[3] - before.x[3])
        work -= 0.5 * (before.torque[3] + p.torque[3]) @ (DT * p.w[3])
        before = p
    book = sim.energies
    assert book.work == pytest.approx(work, rel=1e-12)
    assert book.work > 0.0
    assert abs(book.residual) <= 1e-6 * book.work
    assert book.strain > 0.1 * book.work


def test_pushes_work_along_the_way(engine):
    """A couple and a force on the end of a free row: work is the sum of force x displacement, in the same rule."""
    force, torque = np.array([40.0, -30.0, 20.0]), np.array([0.3, 0.2, -0.1])
    prepare = lambda m: m.push(m.select([2]), fx=40.0, fy=-30.0, fz=20.0, tx=0.3, ty=0.2, tz=-0.1)  # noqa: E731
    sim = row(3, engine, prepare)
    start, turned = sim.particles.x[2], 0.0
    for _ in range(100):
        before = sim.particles.w[2] + 0.5 * DT / INERTIA * sim.particles.torque[2]
        sim.run(1, quiet=True)
        turned = turned + DT * before
    book = sim.energies
    assert book.work == pytest.approx(force @ (sim.particles.x[2] - start) + torque @ turned, rel=1e-12)
    assert abs(book.residual) <= 1e-6 * book.work


def test_reactions_carry_the_weight(engine):
    """Five spheres hang from the first: its support takes the weight of all; the forces of the drive balance."""
    n = 5 if engine != "interpreted" else 3
    sim = row(n, engine, lambda m: m.fix(m.select([0])), gravity=(9.81, 0.0, 0.0), damping=bd.local(0.7), dt=None)
    held, rest = sim.model.select([0]), sim.model.select(np.arange(1, n))
    record = sim.record(every=50, top=bd.reaction(held, "x"), rest=bd.reaction(rest, "x"))
    sim.run(1500, quiet=True)
    assert record.top.values[0] == pytest.approx(MASS * 9.81, rel=1e-12)  # its own, before the bonds are stretched
    assert record.top.last == pytest.approx(n * MASS * 9.81, rel=1e-8)
    assert abs(record.rest.last) <= 1e-8 * MASS * 9.81
    sag = MASS * 9.81 / KN * n * (n - 1) / 2
    assert sim.particles.x[-1, 0] - 2 * RADIUS * (n - 1) == pytest.approx(sag, rel=1e-6)
    assert sim.energies.gravity == pytest.approx(-2.0 * sim.energies.strain, rel=1e-6)


# Damping --------------------------------------------------------------------------------------------------------


def oscillator(engine, stretch=1e-5, **options):
    """Return a sphere that swings along x against one that is held, and its period without damping [s]."""

    def prepare(model):
        model.fix(model.select([0]))
        model.fix(model.select([1]), "y z rx ry rz")

    sim = row(2, engine, prepare, **options)
    with sim.edit("x") as x:
        x[1, 0] += stretch
    return sim, 2.0 * np.pi * np.sqrt(MASS / KN)


def test_local_damping_shrinks_every_half_cycle(engine):
    """D40: alpha 0.7: by sqrt((1 - alpha)/(1 + alpha)) = 0.4200840; period (1/sqrt(1-a) + 1/sqrt(1+a))/2 = 1.296353."""
    sim, period = oscillator(engine, damping=bd.local(0.7), dt=1e-7)
    stretches = []
    for _ in range(round(2.1 * 1.296353 * period / 1e-7)):
        stretches.append(sim.run(1, quiet=True).particles.x[1, 0] - 2 * RADIUS)
    u = np.array(stretches)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(u)))) + 1
    peaks = np.abs([1e-5, *u[turns]])
    assert len(peaks) == 5
    assert peaks[1:] / peaks[:-1] == pytest.approx(0.4200840, rel=3e-3)
    assert (turns[3] - turns[1]) * 1e-7 / period == pytest.approx(1.296353, rel=3e-3)
    book = sim.energies
    assert book.drag == pytest.approx(0.5 * KN * 1e-10 * (1.0 - 0.4200840**8), rel=1e-2)
    assert abs(book.residual) <= 1e-9 * book.drag


def test_viscous_damping_decays_exponentially(engine):
    """exp(-rate t) for translation and spin, to second order in the step; the book closes."""
    rate, end, errors = 4e3, 1e-3, []
    for n in (50, 100, 200):
        sim = row(1, engine, lambda m: None, damping=bd.viscous(rate), dt=end / n)
        with sim.edit("v", "w") as (v, w):
            v[:], w[:] = [[3.0, -4.0, 5.0]], [[10.0, 0.0, -20.0]]
        before = sim.energies.kinetic
        p = sim.run(n, quiet=True).particles
        ratios = np.array([*(p.v[0] / [3.0, -4.0, 5.0]), p.w[0, 0] / 10.0, p.w[0, 2] / -20.0])
        assert np.ptp(ratios) <= 1e-14
        errors.append(ratios[0] * np.exp(rate * end) - 1.0)
        book = sim.energies
        assert book.drag == pytest.approx(before - book.kinetic, rel=1e-12)
        assert abs(book.residual) <= 1e-12 * before
    assert abs(errors[-1]) < 2e-3
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([2.0, 2.0], abs=0.05)


def test_viscous_damping_of_an_oscillator(engine):
    """u = exp(-d t) (cos w t + d/w sin w t), d = rate/2, w^2 = kn/m - d^2, at the end of two periods."""
    rate = 1e4
    d, w = 0.5 * rate, np.sqrt(KN / MASS - 0.25 * rate**2)
    n = 800
    end = 2.0 * 2.0 * np.pi / w
    sim, _ = oscillator(engine, damping=bd.viscous(rate), dt=end / n)
    u = sim.run(n, quiet=True).particles.x[1, 0] - 2 * RADIUS
    assert u == pytest.approx(1e-5 * np.exp(-d * end), rel=2e-4)
    assert abs(sim.energies.residual) <= 1e-9 * sim.energies.drag


def test_kinetic_damping_comes_to_rest_at_the_static_answer(engine):
    """A held row under an end force F stretches by N F/kn and nothing moves any more; the book closes."""
    n, force = 4, 50.0

    def prepare(model):
        model.fix(model.select([0]))
        model.push(model.select([n - 1]), fx=force)

    sim = row(n, engine, prepare, damping=bd.kinetic(every=2), dt=None)
    begun = sim.energies.kinetic  # m v- . v+ / 2 half a step before and after: below zero at rest under a force
    assert begun == pytest.approx(-0.5 * MASS * (0.5 * sim.dt * force / MASS) ** 2, rel=1e-12)
    sim.run(1000, quiet=True)
    stretch = sim.particles.x[-1, 0] - 2 * RADIUS * (n - 1)
    assert stretch == pytest.approx((n - 1) * force / KN, rel=1e-6)
    book = sim.energies
    assert sim.unbalanced < 1e-3
    assert book.kinetic <= 1e-6 * book.strain
    assert book.work == pytest.approx(force * stretch, rel=1e-6)
    assert book.drag == pytest.approx(book.work - book.strain + begun, rel=1e-6)
    assert abs(book.residual) <= 1e-9 * book.work


def test_dashpots_take_what_the_motion_loses(engine):
    """Of a free, vibrating pair: nothing else takes energy, so that the book closes.

    To second order in the step, on which the foreseen velocity depends.
    """
    left = {}
    for spin, dt in ((0.0, DT), (3e3, DT), (3e3, 0.5 * DT)):
        model = bd.Model(bd.packing.line(2, spacing=2 * RADIUS, diameter=2 * RADIUS), density=DENSITY)
        model.bond(model.touching(), bd.Bond(bd.springs(kn=KN, ks=KS, kt=KT, kb=KB), damping=0.1))
        sim = bd.Simulation(model, engine=engine, dt=dt)
        with sim.edit("v", "w") as (v, w):
            v[:] = np.outer([-1.0, 1.0], [0.25, RADIUS * spin, 0.0])
            w[:] = [[300.0, 0.0, spin], [0.0, 200.0, spin]]
        before = sim.energies.kinetic
        sim.run(round(1e-4 / dt), quiet=True)
        book = sim.energies
        assert book.dashpots > 0.3 * 0.5 * 2 * MASS * 0.25**2
        assert book.kinetic + book.strain < before
        left[spin, dt] = book.residual / book.dashpots
    assert abs(left[0.0, DT]) < 1e-2
    assert abs(left[3e3, DT]) < 1e-2
    assert left[3e3, DT] / left[3e3, 0.5 * DT] == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("share", [0.4, 1.0])
def test_damage_takes_the_dashpots_along(engine, share):
    """The dashpots of a bond with damage D pull with 1 - D times the force of whole ones: broken, with none."""
    zeta, peak, end = 0.1, 1e-5, 5e-5
    slip = peak * end / (end - share * (end - peak)) if share < 1.0 else 2.0 * end  # where D is the share
    model = bd.Model(bd.packing.line(2, spacing=2 * RADIUS, diameter=2 * RADIUS), density=DENSITY)
    glue = bd.Bond(bd.springs(kn=KN, ks=KS), bd.bilinear(slip_peak=peak, slip_end=end), damping=zeta)
    bonds = model.bond(model.touching(), glue)
    sim = bd.Simulation(model, engine=engine, dt=1e-9)
    with sim.edit("x") as x:
        x[1, 1] += slip
    assert sim.bonds(bonds).damage == pytest.approx(share, rel=1e-3)
    still = sim.particles.force[0]
    with sim.edit("v") as v:
        v[1] = [0.2, 0.0, 0.1]
    pull = sim.particles.force[0] - still
    left = 1.0 - sim.bonds(bonds).damage[0]
    expected = [2.0 * zeta * np.sqrt(KN * 0.5 * MASS) * 0.2, 0.0, 2.0 * zeta * np.sqrt(KS * 0.5 * MASS) * 0.1]
    assert pull == pytest.approx(left * np.array(expected), abs=2e-2 * max(expected) * left)


@pytest.mark.parametrize("pair", [(0, 1), (1, 0)])
def test_a_broken_joint_resists_closing_and_nothing_else(engine, pair):
    """Its normal points from the first of the pair to the second, however they stand in memory."""
    area, k_n, peak = 2e-5, 3e11, 1e-5
    model = bd.Model(bd.packing.line(2, spacing=2 * RADIUS, diameter=2 * RADIUS), density=DENSITY)
    law = bd.bilinear(slip_peak=peak, slip_end=2 * peak, stiffness=1e11)
    normal = [np.sign(pair[1] - pair[0]), 0.0, 0.0]
    joints = model.join([pair], bd.Joint(law, normal_stiffness=k_n), normal=[normal], area=area)
    sim = bd.Simulation(model, engine=engine)
    x, y, z = sim.particles.x[1]
    pull = k_n * area * 1e-6
    for apart, slip, force in ((1e-6, 0.0, pull), (0.0, 3 * peak, 0.0), (1e-6, 0.0, 0.0), (-1e-6, 0.0, -pull)):
        with sim.edit("x") as places:
            places[1] = x + apart, y + slip, z
        assert sim.particles.force[0] == pytest.approx([force, 0.0, 0.0], abs=1e-9 * pull)
        assert sim.bonds(joints).force[0] == pytest.approx(sim.particles.force[pair[0]], abs=1e-12)
    assert sim.broken == 1


@pytest.mark.parametrize(
    "damping", [None, bd.local(0.3), bd.viscous(2e3), bd.kinetic(every=7)], ids=["none", "local", "viscous", "kinetic"]
)
def test_the_book_closes_with_everything_at_once(engine, damping):
    """Gravity, a drive, pushes, held components, damping of particles: to 1e-6 of the energy without dashpots.

    The book is exact but for the change of stiffness within a step, which is small here as strains are. Dashpots act
    on the foreseen velocity and are booked to second order.
    """

    def residual(dashpots, refine):
        model = bd.Model(bd.packing.fcc(diameter=2 * RADIUS, inside=bd.Sphere(radius=2.4 * RADIUS)), density=DENSITY)
        model.bond(model.touching(), bd.Bond(bd.timoshenko(E=1e9, nu=0.2, radius_ratio=0.8), damping=dashpots))
        model.fix(model.select([0, 1]), "x y rz")
        model.drive(model.select([12]), vx=bd.smooth(to=0.05, over=1e-4), wy=1.0)
        model.push(model.select([5, 6]), fz=bd.ramp(to=0.5, over=5e-5), tx=1e-3)
        sim = bd.Simulation(model, engine=engine, dt=DT / refine, damping=damping, gravity=(1.0, 2.0, -9.81))
        with sim.edit("v") as v:
            v[:] += np.random.default_rng(0).normal(scale=0.02, size=v.shape)
        sim.run(150 * refine, quiet=True)
        book = sim.energies
        assert (book.dashpots > 0.0) == (dashpots > 0.0)
        assert (book.drag > 0.0) == (damping is not None)
        return book.residual / (book.kinetic + book.strain + book.dashpots + book.drag)

    assert abs(residual(0.0, 1)) <= 1e-6
    assert abs(residual(0.05, 4)) <= 2e-4
    assert abs(residual(0.05, 1)) <= 3e-3
