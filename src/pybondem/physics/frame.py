"""Two poses -> deformation of the bond between them -> its load.

The bond is total: its load follows from the current poses alone, with no sum of increments, and is the exact gradient
of the potential

    U = kn u_n^2 / 2 + ks |u_s|^2 / 2 + kt theta_t^2 / 2 + kb |theta_b|^2 / 2.

For infinitesimal rotations its 12 x 12 stiffness is that of the Timoshenko beam element (Przemieniecki, Theory of
Matrix Structural Analysis, 1968, section 5.6), so parallel bonds and beams are values of (kn, ks, kt, kb).
"""

from pybondem.ops import Number, Vector, absolute, add, cross, dot, minus, norm, normal_to, rotate, times, where
from pybondem.physics.types import Load, Motion, Pose, Reference, Relative, Stiffness, Stretch, Viscosity

# 2 asin(sqrt z) / sqrt z as a series in z: eight terms are right to 2e-12 at 0.5 rad.
B0, B1, B2, B3 = 2.0, 2.0 / 6.0, 6.0 / 40.0, 10.0 / 112.0
B4, B5, B6, B7 = 70.0 / 1152.0, 126.0 / 2816.0, 462.0 / 13312.0, 286.0 / 10240.0


def rotation_series(z: Number) -> tuple[Number, Number]:
    """Return beta(z) and d beta / dz: the rotation vector is theta = beta(s . s) s [rad]."""
    beta = B0 + z * (B1 + z * (B2 + z * (B3 + z * (B4 + z * (B5 + z * (B6 + z * B7))))))
    slope = B1 + z * (2.0 * B2 + z * (3.0 * B3 + z * (4.0 * B4 + z * (5.0 * B5 + z * (6.0 * B6 + z * 7.0 * B7)))))
    return beta, slope


def relative_pose(i: Pose, j: Pose) -> Relative:
    """Return the pose of end j seen from end i."""
    r = minus(j.x, i.x)
    length = norm(r)
    n = times(1.0 / length, r)
    cosine = i.q[0] * j.q[0] + i.q[1] * j.q[1] + i.q[2] * j.q[2] + i.q[3] * j.q[3]
    sign = where(cosine < 0.0, -1.0, 1.0)  # q and -q are the same rotation: take the shorter way
    a0, a = i.q[0], (i.q[1], i.q[2], i.q[3])
    b0, b = sign * j.q[0], times(sign, (j.q[1], j.q[2], j.q[3]))
    c = absolute(cosine)
    s = add(minus(times(a0, b), times(b0, a)), cross(a, b))
    inverse = 1.0 / (1.0 + c)  # 2 / |q_i + q_j|^2, for unit quaternions
    return Relative(r, length, n, c, s, times(inverse, s), a0 + b0, add(a, b), inverse)


def material(rel: Relative, a: Vector) -> Vector:
    """Return R(m) a: the reference vector a carried along by the mean rotation of the two ends."""
    return rotate(rel.turn_scalar, rel.turn_vector, rel.inverse, a)


def twist_and_bending(rel: Relative) -> tuple[Number, Vector]:
    """Return the relative rotation of the ends about the chord [rad] and the vector across it [rad]."""
    beta, _ = rotation_series(dot(rel.s, rel.s))
    theta = times(beta, rel.s)
    twist = dot(theta, rel.n)
    return twist, minus(theta, times(twist, rel.n))


def rotational_load(rel: Relative, k: Stiffness) -> tuple[Vector, Vector]:
    """Return what twist and bending add to dU/dn [N m], and their couple [N m]."""
    beta, slope = rotation_series(dot(rel.s, rel.s))
    theta = times(beta, rel.s)
    twist = dot(theta, rel.n)
    g = add(times((k.kt - k.kb) * twist, rel.n), times(k.kb, theta))  # dU/dtheta, the bond moment
    h = add(times(0.5 * beta, g), times(slope * dot(rel.s, g), rel.s))  # dU/ds / 2
    return times((k.kt - k.kb) * twist, theta), times(rel.c, h)


def stretch(rel: Relative, ref: Reference) -> Stretch:
    """Return the deformation of a bond: u_n = l - L0, u_s = L0 ((e . n) n - e), theta_t, theta_b."""
    e = material(rel, ref.r0)  # L0 e
    twist, bending = twist_and_bending(rel)
    return Stretch(rel.length - norm(ref.r0), minus(times(dot(e, rel.n), rel.n), e), twist, bending)


def load(rel: Relative, ref: Reference, k: Stiffness) -> Load:
    """Return the load of a bond [N, N m]: minus the gradient of U with respect to the pose of end i."""
    e = material(rel, ref.r0)  # L0 e
    shear = -k.ks * dot(e, rel.n)
    turning, couple = rotational_load(rel, k)
    a = add(times(shear, e), turning)  # dU/dn
    w = times(shear, cross(e, rel.n))
    force = add(times(k.kn * (rel.length - norm(ref.r0)), rel.n), times(1.0 / rel.length, normal_to(rel.n, a)))
    return Load(force, add(times(0.5, cross(rel.t, w)), couple))


def reference_direction(ref: Reference) -> Vector:
    """Return the unit vector that opening is measured along in the undeformed bond: its chord."""
    return times(1.0 / norm(ref.r0), ref.r0)


def direction(rel: Relative, ref: Reference) -> Vector:
    """Return the unit vector that opening is measured along: the chord."""
    return rel.n


def viscous_load(rel: Relative, n: Vector, i: Motion, j: Motion, damping: Viscosity) -> tuple[Load, Number]:
    """Return the load of the dashpots in the bond and the power they take [W]; n: the direction of opening.

    The relative velocity v_j - v_i - l (w_i + w_j)/2 x n vanishes in every rigid motion of the pair.
    """
    mean_spin = times(0.5, add(i.w, j.w))
    velocity = minus(minus(j.v, i.v), cross(mean_spin, rel.r))
    spin = minus(j.w, i.w)
    force = add(times(damping.cs, velocity), times((damping.cn - damping.cs) * dot(velocity, n), n))
    couple = add(times(damping.cb, spin), times((damping.ct - damping.cb) * dot(spin, rel.n), rel.n))
    return Load(force, couple), dot(force, velocity) + dot(couple, spin)


def linear_load(i: Motion, j: Motion, opening: Vector, ref: Reference, k: Stiffness) -> Load:
    """Return the load [N, N m] for infinitesimal displacements i.v, j.v [m] and rotations i.w, j.w [rad] of the ends.

    opening: the unit vector that opening is measured along.
    """
    relative = minus(minus(j.v, i.v), cross(times(0.5, add(i.w, j.w)), ref.r0))
    rotation = minus(j.w, i.w)
    chord = times(1.0 / norm(ref.r0), ref.r0)
    force = add(times(k.ks, relative), times((k.kn - k.ks) * dot(relative, opening), opening))
    return Load(force, add(times(k.kb, rotation), times((k.kt - k.kb) * dot(rotation, chord), chord)))
