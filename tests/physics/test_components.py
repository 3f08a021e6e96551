"""The six components of a bond and the load that any six answers mean: frames, gradients, rates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from physics.draws import bonds, numbers, quick, stiffnesses, turns, units, vectors

from pybondem.bond_answers import BOND, JOINT
from pybondem.physics import frame
from pybondem.physics.types import Loads, Motion, Pose, Reference

elements = st.sampled_from([BOND, JOINT])


@quick
@given(n=units)
def test_two_axes_across(n):
    s, t = frame.across(n)
    axes = np.array([n, s, t])
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-14)


def seen(element, bond, area=1.0):
    """Return relative pose, axes and components of a bond."""
    i, j, ref = bond
    rel = frame.relative_pose(i, j)
    axes = element.axes(rel, ref)
    return rel, axes, frame.components(rel, ref, axes, area, element.stretch(rel, ref))


@quick
@given(element=elements, bond=bonds(strain=0.3))
def test_components_have_the_size_of_the_vectors(element, bond):
    rel, _, u = seen(element, bond)
    s = element.stretch(rel, bond[2])
    assert np.hypot(u.s, u.t) == pytest.approx(np.linalg.norm(s.slip), abs=1e-13)
    assert np.hypot(u.bend_s, u.bend_t) == pytest.approx(np.linalg.norm(s.bending), abs=1e-13)
    assert (u.n, u.twist) == (s.opening, s.twist)
    assert u.length == pytest.approx(np.linalg.norm(bond[2].r0))


@quick
@given(element=elements, bond=bonds(strain=0.3), k=stiffnesses)
def test_springs_in_components_are_springs_in_vectors(element, bond, k):
    rel, axes, u = seen(element, bond)
    q = Loads(k.kn * u.n, k.ks * u.s, k.ks * u.t, k.kt * u.twist, k.kb * u.bend_s, k.kb * u.bend_t)
    found, expected = element.respond(rel, bond[2], axes, q), element.load(rel, bond[2], k)
    assert np.array(found) == pytest.approx(np.array(expected), abs=1e-12 * max(1.0, np.abs(expected).max()))


def moved(pose, d, angle):
    """Return a pose displaced by d and turned by the small rotation vector angle, to fourth order."""
    z = 0.25 * np.dot(angle, angle)
    p = np.array([1.0 - z / 2 + z * z / 24, *((0.5 - z / 12) * angle)])
    q = np.array(pose.q)
    turned = [p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))]
    return Pose(tuple(np.array(pose.x) + d), tuple(turned))


@quick
@given(element=elements, bond=bonds(strain=0.2), seed=st.integers(0, 2**20))
def test_the_load_of_any_answer_is_its_gradient(element, bond, seed):
    """U = u.H.u / 2 with a full H, which prefers directions: central differences in all 12 components."""
    i, j, ref = bond
    H = np.random.default_rng(seed).normal(size=(6, 6))
    H = H @ H.T
    rel, axes, u = seen(element, bond)
    load = element.respond(rel, ref, axes, Loads(*(H @ u[:6])))
    lever = 0.5 * np.cross(rel.r, load.force)
    found = np.array([*load.force, *(lever + load.couple), *(-np.array(load.force)), *(lever - load.couple)])

    def energy(step):
        ends = moved(i, step[:3], step[3:6]), moved(j, step[6:9], step[9:])
        v = np.array(seen(element, (*ends, ref))[2][:6])
        return 0.5 * v @ H @ v

    h = 1e-3
    expected = [
        -sum(c * energy(k * h * e) for c, k in ((1, -2), (-8, -1), (8, 1), (-1, 2))) / (12 * h) for e in np.eye(12)
    ]
    assert found == pytest.approx(np.array(expected), abs=1e-7 * max(1.0, np.abs(found).max()))


@quick
@given(element=elements, bond=bonds(strain=1e-6), rotation=turns(3.0), v=vectors(), w=vectors())
def test_rates_vanish_in_rigid_motion(element, bond, rotation, v, w):
    rel, axes, _ = seen(element, bond)
    end = Motion(tuple(np.array(v) + np.cross(w, rel.r)), w)
    assert frame.component_rates(rel, axes, Motion(v, w), end) == pytest.approx(np.zeros(6), abs=1e-13)


@quick
@given(element=elements, bond=bonds(turn=1e-9, strain=1e-9), v=vectors(), w=vectors(), a=numbers(-1.0, 1.0))
def test_rates_are_those_of_the_components(element, bond, v, w, a):
    """Near rest; central differences over the motion of both ends."""
    i, j, ref = bond
    moving_i, moving_j = Motion(v, w), Motion(tuple(a * np.array(w)), tuple(a * np.array(v)))
    rel, axes, _ = seen(element, bond)
    h = 1e-5

    def at(t):
        ends = (moved(p, t * np.array(m.v), t * np.array(m.w)) for p, m in ((i, moving_i), (j, moving_j)))
        return np.array(seen(element, (*ends, ref))[2][:6])

    expected = (at(h) - at(-h)) / (2 * h)
    assert frame.component_rates(rel, axes, moving_i, moving_j) == pytest.approx(expected, abs=1e-8)


@quick
@given(n=units)
def test_axes_of_a_joint_are_normal_to_its_normal(n):
    at_rest = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    other = Pose((0.3, -0.4, 1.2), (1.0, 0.0, 0.0, 0.0))
    axes = JOINT.axes(frame.relative_pose(at_rest, other), Reference((0.3, -0.4, 1.2), n))
    triad = np.array([axes.n, axes.s, axes.t])
    assert triad @ triad.T == pytest.approx(np.eye(3), abs=1e-14)
    assert triad[0] == pytest.approx(np.array(n), abs=1e-14)
