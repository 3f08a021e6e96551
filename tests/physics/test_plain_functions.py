"""The physics as plain Python: words, kinematics, loads and dashpots against a separately written truth.

Rotations are held against SciPy, loads against the numerical gradient of an energy written here on rotation matrices,
linear loads against the textbook matrix of the Timoshenko beam. Damage laws and motion: see `test_plain_laws`.
"""

from math import asin, comb, cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from physics.draws import bonds, motions, numbers, quaternion, quick, stiffnesses, turns, units, vectors
from scipy.spatial.transform import Rotation

from pybondem import ops
from pybondem.bond_answers import elastic_energy
from pybondem.bond_bodies import ends
from pybondem.physics import frame, joint, motion
from pybondem.physics.elastic.beam import timoshenko_stiffness
from pybondem.physics.types import Motion, Pose, Reference, Viscosity

# Words ----------------------------------------------------------------------------------------------------------


@quick
@given(a=vectors(1e3), b=vectors(1e3), factor=numbers(-10.0, 10.0), n=units)
def test_vectors_follow_numpy(a, b, factor, n):
    A, B, N = np.array(a), np.array(b), np.array(n)
    assert ops.add(a, b) == tuple(A + B)
    assert ops.minus(a, b) == tuple(A - B)
    assert ops.times(factor, a) == tuple(factor * A)
    assert ops.dot(a, b) == pytest.approx(A @ B, abs=1e-9)
    assert ops.cross(a, b) == pytest.approx(np.cross(A, B), abs=1e-9)
    assert ops.norm(a) == pytest.approx(np.linalg.norm(A), rel=1e-14)
    assert ops.normal_to(n, a) == pytest.approx(A - (A @ N) * N, abs=1e-11)


@quick
@given(a=numbers(-5.0, 5.0), b=numbers(-5.0, 5.0))
def test_choices_follow_python(a, b):
    assert (ops.minimum(a, b), ops.maximum(a, b), ops.absolute(a)) == (min(a, b), max(a, b), abs(a))
    assert ops.where(a < b, a, b) == (a if a < b else b)
    assert motion.sign(a) == np.sign(a)
    assert motion.choose((1.0, 0.0, 1.0), (a, a, a), (b, b, b)) == (a, b, a)


@quick
@given(rotation=turns(pi), a=vectors(), length=numbers(0.2, 3.0))
def test_rotate_turns_like_scipy_whatever_the_length_of_the_quaternion(rotation, a, length):
    w, x, y, z = (length * part for part in quaternion(rotation))
    turned = ops.rotate(w, (x, y, z), 2.0 / length**2, a)
    assert turned == pytest.approx(rotation.apply(a), abs=1e-14)


@quick
@given(first=turns(pi), second=turns(pi), a=vectors())
def test_quaternion_product_composes_rotations(first, second, a):
    w, *xyz = ops.quaternion_product(quaternion(second), quaternion(first))
    assert ops.rotate(w, xyz, 2.0, a) == pytest.approx(second.apply(first.apply(a)), abs=1e-14)


# Kinematics -----------------------------------------------------------------------------------------------------


@quick
@given(angle=numbers(1e-3, 1.0))
def test_the_rotation_series_is_that_of_the_arcsine(angle):
    """beta(z) = 2 asin(s)/s, z = s^2, s = sin(angle/2), less the terms from the ninth on; its slope is its derivative.

    What is left out is below 2e-12 rad up to 0.5 rad, and 1.1e-7 rad at 1 rad.
    """
    s = sin(0.5 * angle)
    beta, slope = frame.rotation_series(s * s)
    rest = sum(2.0 * comb(2 * n, n) / (4.0**n * (2 * n + 1)) * s ** (2 * n) for n in range(8, 60))
    assert beta == pytest.approx(2.0 * asin(s) / s - rest, abs=1e-14)
    assert abs(beta * s - angle) <= (2e-12 if angle <= 0.5 else 1.1e-7)
    h, at = 1e-3, [frame.rotation_series(s * s + k * 1e-3)[0] for k in (-2, -1, 1, 2)]
    assert slope == pytest.approx((at[0] - 8.0 * at[1] + 8.0 * at[2] - at[3]) / (12.0 * h), abs=1e-10)


@quick
@given(bond=bonds())
def test_the_relative_rotation_is_that_of_scipy(bond):
    i, j, _ = bond
    rel = frame.relative_pose(i, j)
    beta, _ = frame.rotation_series(ops.dot(rel.s, rel.s))
    Ri, Rj = (Rotation.from_quat([*p.q[1:], p.q[0]]) for p in (i, j))
    theta = (Rj * Ri.inv()).as_rotvec()
    assert ops.times(beta, rel.s) == pytest.approx(theta, abs=5e-12)
    assert rel.c == pytest.approx(cos(0.5 * np.linalg.norm(theta)), abs=1e-14)
    middle = Rotation.from_rotvec(0.5 * theta) * Ri
    assert frame.material(rel, (0.3, -0.7, 0.2)) == pytest.approx(middle.apply([0.3, -0.7, 0.2]), abs=1e-14)


@pytest.mark.parametrize("element", [frame, joint])
@quick
@given(bond=bonds(turn=2.5), k=stiffnesses, flips=st.tuples(st.booleans(), st.booleans()))
def test_a_quaternion_and_its_opposite_mean_the_same(element, bond, k, flips):
    i, j, ref = bond
    other = [Pose(p.x, tuple(-c for c in p.q)) if flip else p for p, flip in zip((i, j), flips, strict=True)]
    rel, flipped = frame.relative_pose(i, j), frame.relative_pose(*other)
    for function in (lambda r: element.stretch(r, ref), lambda r: element.load(r, ref, k)):
        assert flatten(function(flipped)) == pytest.approx(flatten(function(rel)), abs=1e-13)


def flatten(values):
    return [float(c) for value in values for c in (value if isinstance(value, tuple) else (value,))]


@pytest.mark.parametrize("element", [frame, joint])
@quick
@given(bond=bonds(turn=0.0, strain=0.0), by=turns(pi), k=stiffnesses)
def test_rigid_motion_stretches_nothing(element, bond, by, k):
    i, j, ref = bond
    rel = frame.relative_pose(i, j)
    assert flatten(element.stretch(rel, ref)) == pytest.approx([0.0] * 8, abs=1e-14)
    assert flatten(element.load(rel, ref, k)) == pytest.approx([0.0] * 6, abs=1e-13)


# Elastic loads --------------------------------------------------------------------------------------------------


def bond_energy(xi, Ri, xj, Rj, ref, k):
    """U of a bond by its definition, on rotation matrices: mean rotation half-way, rotation vector by SciPy."""
    r, r0 = xj - xi, np.array(ref.r0)
    L0, n = np.linalg.norm(r0), r / np.linalg.norm(r)
    theta = (Rj * Ri.inv()).as_rotvec()
    e = (Rotation.from_rotvec(0.5 * theta) * Ri).apply(r0 / L0)
    slip, twist = L0 * ((e @ n) * n - e), theta @ n
    bending = theta - twist * n
    stretch = np.linalg.norm(r) - L0
    return 0.5 * (k.kn * stretch**2 + k.ks * slip @ slip + k.kt * twist**2 + k.kb * bending @ bending)


def joint_energy(xi, Ri, xj, Rj, ref, k):
    """U of a joint by its definition: displacement beyond rigid rotation, along and across the carried normal."""
    r = xj - xi
    theta = (Rj * Ri.inv()).as_rotvec()
    middle = Rotation.from_rotvec(0.5 * theta) * Ri
    d, normal = r - middle.apply(ref.r0), middle.apply(ref.normal)
    opening = d @ normal
    slip = d - opening * normal
    n = r / np.linalg.norm(r)
    twist = theta @ n
    bending = theta - twist * n
    return 0.5 * (k.kn * opening**2 + k.ks * slip @ slip + k.kt * twist**2 + k.kb * bending @ bending)


ENERGIES = [(frame, bond_energy), (joint, joint_energy)]


def scipy_poses(i, j):
    return [(np.array(p.x), Rotation.from_quat([*p.q[1:], p.q[0]])) for p in (i, j)]


@pytest.mark.parametrize(("element", "energy"), ENERGIES)
@quick
@given(bond=bonds(), k=stiffnesses)
def test_the_energy_is_the_one_defined(element, energy, bond, k):
    i, j, ref = bond
    (xi, Ri), (xj, Rj) = scipy_poses(i, j)
    ours = elastic_energy(element.stretch(frame.relative_pose(i, j), ref), k)
    assert ours == pytest.approx(energy(xi, Ri, xj, Rj, ref, k), rel=1e-11, abs=1e-12)


@pytest.mark.parametrize(("element", "energy"), ENERGIES)
@quick
@given(bond=bonds(), k=stiffnesses)
def test_the_load_is_minus_the_gradient_of_the_energy(element, energy, bond, k):
    """By differences of fourth order: force and torque on both ends."""
    i, j, ref = bond
    (xi, Ri), (xj, Rj) = scipy_poses(i, j)
    h, axes = 1e-3, np.eye(3)

    def gradient(moved):
        return np.array(
            [(moved(-2 * h * a) - 8 * moved(-h * a) + 8 * moved(h * a) - moved(2 * h * a)) / (12 * h) for a in axes]
        )

    rel = frame.relative_pose(i, j)
    found = ends(rel.r, element.load(rel, ref, k))
    force_i = -gradient(lambda d: energy(xi + d, Ri, xj, Rj, ref, k))
    force_j = -gradient(lambda d: energy(xi, Ri, xj + d, Rj, ref, k))
    torque_i = -gradient(lambda d: energy(xi, Rotation.from_rotvec(d) * Ri, xj, Rj, ref, k))
    torque_j = -gradient(lambda d: energy(xi, Ri, xj, Rotation.from_rotvec(d) * Rj, ref, k))
    assert found[:3] == pytest.approx(force_i, abs=1e-9)
    assert found[:3] == pytest.approx(-force_j, abs=1e-9)
    assert found[3:6] == pytest.approx(torque_i, abs=1e-9)
    assert found[6:] == pytest.approx(torque_j, abs=1e-9)


@pytest.mark.parametrize("element", [frame, joint])
@quick
@given(bond=bonds(turn=2.5, strain=0.3), k=stiffnesses)
def test_loads_balance_and_do_not_depend_on_which_end_comes_first(element, bond, k):
    i, j, ref = bond
    rel, back = frame.relative_pose(i, j), frame.relative_pose(j, i)
    swapped = Reference(tuple(-c for c in ref.r0), tuple(-c for c in ref.normal))
    force, torque_i, torque_j = np.reshape(ends(rel.r, element.load(rel, ref, k)), (3, 3))
    other = np.reshape(ends(back.r, element.load(back, swapped, k)), (3, 3))
    assert np.cross(rel.r, force) == pytest.approx(torque_i + torque_j, abs=1e-13)
    assert other == pytest.approx(np.array([-force, torque_j, torque_i]), abs=1e-13)


# Linear loads ---------------------------------------------------------------------------------------------------


def timoshenko_matrix(E, G, k, radius, L):
    """The 12 x 12 stiffness of a round beam along x (Przemieniecki 1968, 5.6): ux uy uz rx ry rz of i, then of j."""
    A, I = pi * radius**2, pi * radius**4 / 4.0
    J, phi = 2.0 * I, 12.0 * E * I / (G * A * k * L**2)
    K = np.zeros((12, 12))
    for value, (a, b) in ((E * A / L, (0, 6)), (G * J / L, (3, 9))):
        K[np.ix_((a, b), (a, b))] += value * np.array([[1, -1], [-1, 1]])
    f = E * I / (L**3 * (1.0 + phi))
    own, far = (4.0 + phi) * L**2, (2.0 - phi) * L**2
    for sign, dofs in ((1.0, (1, 5, 7, 11)), (-1.0, (2, 4, 8, 10))):
        m = sign * 6.0 * L
        K[np.ix_(dofs, dofs)] += f * np.array(
            [[12, m, -12, m], [m, own, -m, far], [-12, -m, 12, -m], [m, far, -m, own]]
        )
    return K


def linear_matrix(opening, ref, k):
    """The 12 x 12 matrix of `linear_load`, column by column: forces and torques that hold unit displacements."""
    columns = []
    for u in np.eye(12):
        i, j = (Motion(tuple(part[:3]), tuple(part[3:])) for part in (u[:6], u[6:]))
        force, torque_i, torque_j = np.reshape(ends(ref.r0, frame.linear_load(i, j, opening, ref, k)), (3, 3))
        columns.append(-np.concatenate([force, torque_i, -force, torque_j]))
    return np.array(columns).T


@quick
@given(E=numbers(0.1, 10.0), nu=numbers(-0.5, 0.5), factor=numbers(0.5, 1.0), radius=numbers(0.1, 1.0),
       L=numbers(0.5, 5.0), turned=turns(pi))  # fmt: skip
def test_the_linear_load_is_that_of_the_timoshenko_beam(E, nu, factor, radius, L, turned):
    G = E / (2.0 * (1.0 + nu))
    k = timoshenko_stiffness(E, G, factor, radius, L)
    ref = Reference(tuple(turned.apply([L, 0.0, 0.0])), (0.0, 0.0, 1.0))
    ours = linear_matrix(frame.reference_direction(ref), ref, k)
    Q = np.kron(np.eye(4), turned.as_matrix())
    expected = Q @ timoshenko_matrix(E, G, factor, radius, L) @ Q.T
    assert np.abs(ours - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("element", [frame, joint])
@quick
@given(bond=bonds(turn=0.0, strain=0.0), k=stiffnesses, u=st.tuples(motions, motions))
def test_the_linear_load_is_the_slope_of_the_load_at_rest(element, bond, k, u):
    """For bonds and joints, seen from any frame, by differences of fourth order in the size of the displacement."""
    i, _, ref = bond
    zero = Rotation.from_quat([*i.q[1:], i.q[0]])
    ref = Reference(tuple(zero.apply(ref.r0)), tuple(zero.apply(ref.normal)))  # bonded as it stands

    def at(size):
        places = (np.zeros(3), np.array(ref.r0))
        i, j = (
            Pose(tuple(x + size * np.array(m.v)), quaternion(Rotation.from_rotvec(size * np.array(m.w))))
            for x, m in zip(places, u, strict=True)
        )
        rel = frame.relative_pose(i, j)
        return np.array(ends(rel.r, element.load(rel, ref, k)))

    h = 1e-3
    slope = (at(-2 * h) - 8 * at(-h) + 8 * at(h) - at(2 * h)) / (12 * h)
    found = ends(ref.r0, frame.linear_load(*u, element.reference_direction(ref), ref, k))
    assert found == pytest.approx(slope, abs=1e-8)


# Dashpots -------------------------------------------------------------------------------------------------------


def viscous(bond, i, j, c):
    rel = frame.relative_pose(*bond[:2])
    load, power = frame.viscous_load(rel, rel.n, i, j, c)
    return rel, load, power


@quick
@given(bond=bonds(), v=vectors(), w=vectors(), c=st.builds(Viscosity, *[numbers(0.1, 3.0)] * 4))
def test_dashpots_rest_in_rigid_motion(bond, v, w, c):
    r = np.subtract(bond[1].x, bond[0].x)
    i, j = Motion(v, w), Motion(tuple(np.array(v) + np.cross(w, r)), w)
    _, load, power = viscous(bond, i, j, c)
    assert flatten(load) == pytest.approx([0.0] * 6, abs=1e-13)
    assert power == pytest.approx(0.0, abs=1e-13)


@quick
@given(bond=bonds(), i=motions, j=motions, c=st.builds(Viscosity, *[numbers(0.0, 3.0)] * 4))
def test_dashpots_take_the_power_that_they_say(bond, i, j, c):
    """What they do to the two bodies, at the rates F . v + T . w, is minus that; and it is never negative."""
    rel, load, power = viscous(bond, i, j, c)
    force, torque_i, torque_j = np.reshape(ends(rel.r, load), (3, 3))
    work = force @ np.subtract(i.v, j.v) + torque_i @ i.w + torque_j @ j.w
    assert power == pytest.approx(-work, abs=1e-13)
    assert power >= -1e-15


@quick
@given(bond=bonds(), i=motions, j=motions, c=st.builds(Viscosity, *[numbers(0.1, 3.0)] * 4))
def test_each_dashpot_answers_its_own_rate(bond, i, j, c):
    """cn along the chord, cs across it; ct about it, cb across it; force on i along the motion of j."""
    rel, load, _ = viscous(bond, i, j, c)
    n, spin = np.array(rel.n), np.subtract(j.w, i.w)
    at_middle = np.subtract(j.v, np.cross(j.w, rel.r) / 2) - np.add(i.v, np.cross(i.w, rel.r) / 2)
    assert np.dot(load.force, n) == pytest.approx(c.cn * at_middle @ n, abs=1e-13)
    assert load.force - np.dot(load.force, n) * n == pytest.approx(c.cs * (at_middle - (at_middle @ n) * n), abs=1e-13)
    assert np.dot(load.couple, n) == pytest.approx(c.ct * spin @ n, abs=1e-13)
    assert load.couple - np.dot(load.couple, n) * n == pytest.approx(c.cb * (spin - (spin @ n) * n), abs=1e-13)
