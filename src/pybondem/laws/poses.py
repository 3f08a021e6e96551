"""From a wanted deformation of a pair to the exact poses of its two ends.

All arrays are component-first, (3, count) or (4, count), one column for each pair.
"""

from typing import NamedTuple

import numpy as np

from pybondem.check import Floats
from pybondem.ops import Vector, quaternion_product, rotate


class Poses(NamedTuple):
    """Places (3, count) [m] and orientations (4, count), unit quaternions with the scalar first, of both ends."""

    x_i: Floats
    q_i: Floats
    x_j: Floats
    q_j: Floats


class Motions(NamedTuple):
    """Velocities (3, count) [m/s] and spins (3, count) [rad/s] of both ends."""

    v_i: Floats
    w_i: Floats
    v_j: Floats
    w_j: Floats


class Rigid(NamedTuple):
    """A rigid motion: rotation, unit quaternion (4,), then translation (3,) [m]; spin (3,) [rad/s] about the origin."""

    rotation: Floats
    translation: Floats
    spin: Floats


class Geometry(NamedTuple):
    """Pairs before they are deformed.

    axes (3, 3, count): the unit vectors n, s, t of each pair, axes[a] its a-th; handed (count,): 1 where they are
    right-handed, -1 where they are a mirror image; chord (3, count): from i to j [m]; interface: whether n is the
    normal of an interface (a joint) and slip a translation, not the direction of the chord.
    """

    axes: Floats
    handed: Floats
    chord: Floats
    interface: bool


def random_axes(count: int, seed: int) -> Floats:
    """Return random right-handed triads (3, 3, count)."""
    draw = np.random.default_rng(seed).standard_normal((4, count))
    q = draw / np.linalg.norm(draw, axis=0)
    return np.stack([turned(q, np.repeat(np.eye(3)[:, [a]], count, axis=1)) for a in range(3)])


def geometry(axes: Floats, length: float, tilt: float, interface: bool) -> Geometry:
    """Return pairs with the given triads; tilt [rad]: angle of the chord from n towards s."""
    handed = np.sign(dot(axes[0], cross(axes[1], axes[2])))
    return Geometry(axes, handed, length * (np.cos(tilt) * axes[0] + np.sin(tilt) * axes[1]), interface)


def poses(g: Geometry, local: Floats) -> Poses:
    """Return the poses that give each pair the deformation local (6, count), its middle at the origin.

    The mean material direction e and the rotation theta between the ends are inverted exactly from their definitions
    (see `physics.frame` and `physics.joint`): q_i = exp(-theta / 2) m and q_j = exp(theta / 2) m have the mean m.
    """
    opening, slip = local[0], local[1] * g.axes[1] + local[2] * g.axes[2]
    identity = np.zeros((4, local.shape[1]))
    identity[0] = 1.0
    if g.interface:
        mean, chord = identity, g.chord + opening * g.axes[0] + slip
        turn = from_to(g.axes[0], unit(chord))
    else:
        share = slip / size(g.chord)
        along = np.sqrt(1.0 - dot(share, share))
        mean = from_to(g.axes[0], along * g.axes[0] - share)
        chord = g.chord + opening * g.axes[0]
        turn = identity
    axes = [turned(turn, a) for a in g.axes]
    theta = g.handed * (local[3] * axes[0] + local[4] * axes[1] + local[5] * axes[2])
    half = rotation(0.5 * theta)
    back = half * np.array([[1.0], [-1.0], [-1.0], [-1.0]])
    return Poses(-0.5 * chord, product(back, mean), 0.5 * chord, product(half, mean))


def moved(p: Poses, rigid: Rigid) -> Poses:
    """Return the poses after a rigid motion of the whole pair."""
    q = rigid.rotation[:, None]
    shift = rigid.translation[:, None]
    return Poses(turned(q, p.x_i) + shift, product(q, p.q_i), turned(q, p.x_j) + shift, product(q, p.q_j))


def motions(before: Poses, now: Poses, dt: float, rigid: Rigid | None) -> Motions:
    """Return the motions that led from one pose to the next in dt [s], seen in the rigid motion, if there is one."""
    v_i, v_j = (now.x_i - before.x_i) / dt, (now.x_j - before.x_j) / dt
    w_i, w_j = rotation_vector(before.q_i, now.q_i) / dt, rotation_vector(before.q_j, now.q_j) / dt
    if rigid is None:
        return Motions(v_i, w_i, v_j, w_j)
    q, spin = rigid.rotation[:, None], rigid.spin[:, None]
    v_i, v_j = (turned(q, v) + cross(spin, turned(q, x)) for v, x in ((v_i, now.x_i), (v_j, now.x_j)))
    return Motions(v_i, turned(q, w_i) + spin, v_j, turned(q, w_j) + spin)


# Vectors and quaternions -----------------------------------------------------------------------------------------


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar products a . b (count,)."""
    total: Floats = (a * b).sum(axis=0)
    return total


def cross(a: Floats, b: Floats) -> Floats:
    """Return the vector products a x b (3, count)."""
    return np.cross(a, b, axis=0)


def size(a: Floats) -> Floats:
    """Return |a| (count,)."""
    return np.sqrt(dot(a, a))


def unit(a: Floats) -> Floats:
    """Return a / |a|."""
    return a / size(a)


def turned(q: Floats, a: Floats) -> Floats:
    """Return vectors (3, count) turned by unit quaternions (4, count)."""
    return np.stack(np.broadcast_arrays(*rotate(q[0], _vector(q[1:]), 2.0, _vector(a))))


def product(p: Floats, q: Floats) -> Floats:
    """Return the quaternions p q."""
    return np.stack(np.broadcast_arrays(*quaternion_product((p[0], *_vector(p[1:])), (q[0], *_vector(q[1:])))))


def rotation(vector: Floats) -> Floats:
    """Return the unit quaternions of rotation vectors [rad]."""
    half = 0.5 * size(vector)
    return np.stack([np.cos(half), *(0.5 * np.sinc(half / np.pi) * vector)])


def rotation_vector(a: Floats, b: Floats) -> Floats:
    """Return the rotation vectors [rad] that turn the orientations a into b, in global axes, the shorter way."""
    p = product(b, a * np.array([[1.0], [-1.0], [-1.0], [-1.0]]))
    p = np.where(p[0] < 0.0, -p, p)
    sine = size(p[1:])
    angle = 2.0 * np.arctan2(sine, p[0])
    return p[1:] * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)


def from_to(a: Floats, b: Floats) -> Floats:
    """Return the smallest rotations that turn unit vectors a into unit vectors b, not opposite to them."""
    q = np.concatenate([1.0 + dot(a, b)[None, :], cross(a, b)])
    return q / np.sqrt((q * q).sum(axis=0))


def _vector(a: Floats) -> Vector:
    return a[0], a[1], a[2]
