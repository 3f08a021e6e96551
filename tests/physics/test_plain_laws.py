"""The physics as plain Python: motion, damage laws and elastic forms against a separately written truth."""

from math import pi

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from physics.draws import bonds, numbers, quaternion, quick, stiffnesses, turns, units, vectors
from scipy.spatial.transform import Rotation

import pybondem as bd
from pybondem.bond_answers import alike, elastic_energy, energy_open_to_damage, kept
from pybondem.physics import frame, motion
from pybondem.physics.elastic.beam import euler_bernoulli_stiffness, timoshenko_stiffness
from pybondem.physics.elastic.parallel import parallel_stiffness
from pybondem.physics.types import Deformation

# Motion ---------------------------------------------------------------------------------------------------------


@quick
@given(rotation=turns(pi), axis=units, angle=numbers(0.0, 1.0))
def test_turned_is_the_exponential_and_can_be_undone(rotation, axis, angle):
    dt = 1e-3
    w = tuple(angle / dt * np.array(axis))
    q = quaternion(rotation)
    found = motion.turned(q, w, dt)
    expected = quaternion(Rotation.from_rotvec(angle * np.array(axis)) * rotation)
    assert abs(np.dot(found, expected)) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=4e-16)
    assert motion.turned(found, w, -dt) == pytest.approx(q, abs=1e-15)


@quick
@given(rotation=turns(pi), w=vectors(), error=numbers(-1e-5, 1e-5))
def test_turned_brings_a_quaternion_back_to_unit_length(rotation, w, error):
    """One Newton step: what the length is off by is squared."""
    q = tuple((1.0 + error) * c for c in quaternion(rotation))
    assert np.linalg.norm(motion.turned(q, w, 0.1)) == pytest.approx(1.0, abs=2.0 * error**2 + 4e-16)


@quick
@given(v=vectors(), force=vectors(), mass=numbers(0.5, 2.0), dt=numbers(0.0, 0.1))
def test_one_kick_and_one_drift(v, force, mass, dt):
    assert motion.kicked(v, force, mass, dt) == pytest.approx(np.array(v) + dt * np.array(force) / mass, abs=1e-15)
    assert motion.drifted(v, force, dt) == pytest.approx(np.array(v) + dt * np.array(force), abs=1e-15)


@quick
@given(hold=st.tuples(*[st.sampled_from([0.0, 1.0])] * 3), push=vectors(), force=vectors(), v=vectors())
def test_a_boundary_works_against_the_force_it_meets_or_by_its_push(hold, push, force, v):
    expected = sum(-f * c if h else p * c for h, p, f, c in zip(hold, push, force, v, strict=True))
    assert motion.boundary_power(hold, push, force, v) == pytest.approx(expected, abs=1e-15)


@quick
@given(alpha=numbers(0.0, 0.9), force=vectors(), v=vectors(), mass=numbers(0.5, 2.0), dt=numbers(0.0, 0.1))
def test_local_damping_opposes_the_motion_by_a_share_of_the_force(alpha, force, v, mass, dt):
    now = np.array(v) + 0.5 * dt / mass * np.array(force)
    drag = np.array(motion.local_drag(alpha, force, v, mass, dt))
    assert np.abs(drag) == pytest.approx(np.where(now == 0.0, 0.0, alpha * np.abs(force)), abs=1e-15)
    assert np.all(drag * now <= 0.0)


@quick
@given(rate=numbers(0.0, 1e3), force=vectors(), v=vectors(), mass=numbers(0.5, 2.0), dt=numbers(0.0, 0.1))
def test_global_damping_is_that_of_the_velocity_it_leads_to(rate, force, v, mass, dt):
    drag = np.array(motion.global_drag(rate, force, v, mass, dt))
    end = np.array(v) + 0.5 * dt / mass * (np.array(force) + drag)
    assert drag == pytest.approx(-rate * mass * end, abs=1e-9)


# Damage ---------------------------------------------------------------------------------------------------------


def felt(slip=0.0, normal=0.0, shear=0.0, bending=0.0, twist=0.0):
    return Deformation(0.0, slip, 0.0, 0.0, 1.0, 1.0, normal, shear, bending, twist, 1.0, 1.0)


def answer(law, d, memory=(0.0,)):
    """Return damage and memory of a law with its values."""
    return law.function(d, None, law.memory(*memory), law.parameters, None, 0.0)


@quick
@given(s0=numbers(0.1, 1.0), ratio=numbers(1.1, 10.0), slips=st.lists(numbers(0.0, 12.0), min_size=1, max_size=20))
def test_bilinear_softening_is_its_traction_and_unloads_along_the_secant(s0, ratio, slips):
    """tau/k = s up to s0, s0 (sf - s)/(sf - s0) up to sf, then 0, on the largest slip so far; else along the secant."""
    sf = ratio * s0
    law, memory, before, largest = bd.bilinear(s0, sf), (0.0,), 0.0, 0.0
    for slip in slips:
        damage, memory = answer(law, felt(slip), memory)
        largest = max(largest, slip)
        envelope = largest if largest <= s0 else max(0.0, s0 * (sf - largest) / (sf - s0))
        expected = slip * (envelope / largest if largest > 0.0 else 1.0)
        assert (1.0 - damage) * slip == pytest.approx(expected, abs=1e-13)
        assert before <= damage <= 1.0
        assert memory == (largest,)
        before = damage


@quick
@given(s0=numbers(0.1, 1.0), ratio=numbers(1.1, 10.0))
def test_bilinear_softening_releases_its_fracture_energy(s0, ratio):
    """G_f = k s0 sf / 2: the area under the traction."""
    sf = ratio * s0
    slips = np.concatenate([[0.0, s0], np.linspace(s0, sf, 50)[1:], [1.1 * sf]])
    tractions = []
    law, memory = bd.bilinear(s0, sf), (0.0,)
    for slip in slips:
        damage, memory = answer(law, felt(slip), memory)
        tractions.append((1.0 - damage) * slip)
    assert np.trapezoid(tractions, slips) == pytest.approx(0.5 * s0 * sf, rel=1e-12)


@quick
@given(normal=numbers(-20.0, 10.0), shear=numbers(0.0, 10.0), bending=numbers(0.0, 10.0), twist=numbers(0.0, 10.0),
       share=numbers(0.0, 1.0), broken=st.sampled_from([0.0, 1.0]))  # fmt: skip
def test_strength_breaks_where_a_stress_exceeds_it_and_never_heals(normal, shear, bending, twist, share, broken):
    tension, limit = 7.0, 6.0
    sigma, tau = normal + share * bending, shear + share * twist
    assume(abs(sigma - tension) > 1e-9)
    assume(abs(tau - limit) > 1e-9)
    law = bd.strength(tension, limit, share)
    d = felt(normal=normal, shear=shear, bending=bending, twist=twist)
    damage, memory = answer(law, d, (broken,))
    expected = 1.0 if broken or sigma > tension or tau > limit else 0.0
    assert (damage, memory) == (expected, (expected,))
    assert answer(law, felt(), memory) == (expected, (expected,))


@quick
@given(pressure=numbers(0.0, 1e12))
def test_strength_holds_under_any_pressure(pressure):
    assert answer(bd.strength(1.0, 1.0), felt(normal=-pressure))[0] == 0.0


@quick
@given(bond=bonds(strain=0.3), k=stiffnesses, damage=numbers(0.0, 1.0))
def test_damage_leaves_a_share_of_every_stiffness_but_that_of_closing(bond, k, damage):
    i, j, ref = bond
    s = frame.stretch(frame.relative_pose(i, j), ref)
    left = kept(k, alike(damage), s.opening)
    share = 1.0 - damage
    assert left == pytest.approx((k.kn if s.opening < 0.0 else share * k.kn, share * k.ks, share * k.kt, share * k.kb))
    assert elastic_energy(s, left) == pytest.approx(
        elastic_energy(s, k) - damage * energy_open_to_damage(s, k), abs=1e-13
    )


# Elastic forms --------------------------------------------------------------------------------------------------

sections = {"E": numbers(1e6, 1e11), "radius": numbers(1e-4, 1e-2), "L": numbers(1e-3, 1e-1)}


@quick
@given(**sections, ratio=numbers(0.5, 5.0))
def test_a_parallel_bond_is_a_disc_of_springs(E, radius, L, ratio):
    """Integrals of the springs per area over the disc: kn = E/L; with moments of inertia by numerical integration."""
    edges = np.linspace(0.0, radius, 4001)
    r = 0.5 * (edges[1:] + edges[:-1])
    ring = 2.0 * pi * r * np.diff(edges)
    k = parallel_stiffness(E, ratio, radius, L)
    assert k.kn == pytest.approx(E / L * ring.sum(), rel=1e-6)
    assert k.ks == pytest.approx(k.kn / ratio, rel=1e-14)
    assert k.kt == pytest.approx(E / L / ratio * (ring * r**2).sum(), rel=1e-6)
    assert k.kb == pytest.approx(E / L * (ring * r**2 / 2.0).sum(), rel=1e-6)


@quick
@given(**sections, nu=numbers(-0.5, 0.5), factor=numbers(0.5, 1.0))
def test_a_timoshenko_beam_bends_and_shears_in_series(E, radius, L, nu, factor):
    """1/ks = L^3/12EI + L/kGA; and it becomes the Euler-Bernoulli beam as shear stiffness grows."""
    G, A, I = E / (2.0 * (1.0 + nu)), pi * radius**2, pi * radius**4 / 4.0
    k, slender = timoshenko_stiffness(E, G, factor, radius, L), euler_bernoulli_stiffness(E, G, radius, L)
    assert 1.0 / k.ks == pytest.approx(L**3 / (12.0 * E * I) + L / (factor * G * A), rel=1e-12)
    assert slender == pytest.approx((E * A / L, 12.0 * E * I / L**3, 2.0 * G * I / L, E * I / L), rel=1e-12)
    assert (k.kn, k.kt, k.kb) == pytest.approx((slender.kn, slender.kt, slender.kb), rel=1e-14)
    assert timoshenko_stiffness(E, G, 1e12, radius, L).ks == pytest.approx(slender.ks, rel=1e-6)
