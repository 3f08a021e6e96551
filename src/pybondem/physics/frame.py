"""Two poses -> deformation of the bond between them -> its load.

The bond is total: its load follows from the current poses alone, with no sum of increments, and is the exact gradient
of the potential

    U = kn u_n^2 / 2 + ks |u_s|^2 / 2 + kt theta_t^2 / 2 + kb |theta_b|^2 / 2.

For infinitesimal rotations its 12 x 12 stiffness is that of the Timoshenko beam element (Przemieniecki, Theory of
Matrix Structural Analysis, 1968, section 5.6), so parallel bonds and beams are values of (kn, ks, kt, kb).
"""

from pybondem.ops import Number, Vector, absolute, add, cross, dot, minus, norm, normal_to, rotate, times, where
from pybondem.physics.types import (
    ComponentRates,
    Components,
    Frame,
    Load,
    Loads,
    Motion,
    Pose,
    Reference,
    Relative,
    Stiffness,
    Stretch,
    Viscosity,
)

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


def relative_motion(rel: Relative, i: Motion, j: Motion) -> tuple[Vector, Vector]:
    """Return velocity v_j - v_i - l (w_i + w_j)/2 x n [m/s] and spin w_j - w_i [rad/s]; both vanish in rigid motion."""
    mean_spin = times(0.5, add(i.w, j.w))
    return minus(minus(j.v, i.v), cross(mean_spin, rel.r)), minus(j.w, i.w)


def viscous_load(rel: Relative, n: Vector, i: Motion, j: Motion, damping: Viscosity) -> tuple[Load, Number]:
    """Return the load of the dashpots in the bond and the power they take [W]; n: the direction of opening."""
    velocity, spin = relative_motion(rel, i, j)
    force = add(times(damping.cs, velocity), times((damping.cn - damping.cs) * dot(velocity, n), n))
    couple = add(times(damping.cb, spin), times((damping.ct - damping.cb) * dot(spin, rel.n), rel.n))
    return Load(force, couple), dot(force, velocity) + dot(couple, spin)


def linear_stretch(i: Motion, j: Motion, along: Vector, ref: Reference) -> Stretch:
    """Return the stretch for infinitesimal displacements i.v, j.v [m] and rotations i.w, j.w [rad] of the ends.

    along: the unit vector that opening is measured along.
    """
    relative = minus(minus(j.v, i.v), cross(times(0.5, add(i.w, j.w)), ref.r0))
    rotation = minus(j.w, i.w)
    chord = times(1.0 / norm(ref.r0), ref.r0)
    opening, twist = dot(relative, along), dot(rotation, chord)
    return Stretch(opening, minus(relative, times(opening, along)), twist, minus(rotation, times(twist, chord)))


def linear_load(i: Motion, j: Motion, along: Vector, ref: Reference, k: Stiffness) -> Load:
    """Return the load [N, N m] for infinitesimal displacements and rotations of the ends; see `linear_stretch`."""
    s = linear_stretch(i, j, along, ref)
    chord = times(1.0 / norm(ref.r0), ref.r0)
    force = add(times(k.kn * s.opening, along), times(k.ks, s.slip))
    return Load(force, add(times(k.kt * s.twist, chord), times(k.kb, s.bending)))


# Six components: what a bond law sees, and the load that its answer means ------------------------------------------


def across(n: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors normal to the unit vector n and to one another (Duff et al., J. Comp. Graph. Tech. 6,
    2017)."""
    sign = where(n[2] < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return (1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]), (b, sign + n[1] * n[1] * a, -n[1])


def bent(n: Vector, e: Vector, a: Vector) -> Vector:
    """Return a, a vector normal to the unit vector e, carried to the unit vector n by the shortest rotation."""
    return minus(a, times(dot(a, n) / (1.0 + dot(e, n)), add(e, n)))


def axes(rel: Relative, ref: Reference) -> Frame:
    """Return the axes of a bond: the chord, and two axes across it that turn with the material."""
    n0 = reference_direction(ref)
    s0, t0 = across(n0)
    e = material(rel, n0)
    s, t = bent(rel.n, e, material(rel, s0)), bent(rel.n, e, material(rel, t0))
    return Frame(rel.n, s, t, e, s, t)


def components(rel: Relative, ref: Reference, frame: Frame, area: Number, u: Stretch) -> Components:
    """Return the six components of a stretch along the axes of a frame, and the size of the bond (area [m2])."""
    s, t = dot(u.slip, frame.s), dot(u.slip, frame.t)
    bend_s, bend_t = dot(u.bending, frame.bend_s), dot(u.bending, frame.bend_t)
    return Components(u.opening, s, t, u.twist, bend_s, bend_t, norm(ref.r0), area)


def component_rates(rel: Relative, frame: Frame, i: Motion, j: Motion) -> ComponentRates:
    """Return how fast the six components change, by the motions of the ends (in small strain)."""
    v, w = relative_motion(rel, i, j)
    across_n = dot(v, frame.n), dot(v, frame.s), dot(v, frame.t)
    return ComponentRates(*across_n, dot(w, rel.n), dot(w, frame.bend_s), dot(w, frame.bend_t))


def moments(rel: Relative, frame: Frame, q: Loads) -> tuple[Vector, Vector, Number]:
    """Return dU/dn of the rotations [N m], their couple [N m], and the moment about n that turns the axes of bending.

    As in `rotational_load`, for any moments. The axes of bending turn about the chord when it leaves the material's;
    only a bending moment that is not along the bending feels it.
    """
    beta, slope = rotation_series(dot(rel.s, rel.s))
    theta = times(beta, rel.s)
    twist = dot(theta, rel.n)
    bending_moment = add(times(q.bend_s, frame.bend_s), times(q.bend_t, frame.bend_t))
    g = add(times(q.twist, rel.n), bending_moment)
    h = add(times(0.5 * beta, g), times(slope * dot(rel.s, g), rel.s))
    turning = dot(cross(theta, rel.n), bending_moment) / (1.0 + dot(frame.e, rel.n))
    a = minus(times(q.twist, theta), add(times(twist, bending_moment), times(turning, cross(frame.e, rel.n))))
    return a, times(rel.c, h), turning


def respond(rel: Relative, ref: Reference, frame: Frame, q: Loads) -> Load:
    """Return the load of a bond [N, N m] from the six loads conjugate to its deformation: F = Q . du/dx.

    Whatever the loads, forces and torques balance, and their power is exactly that of Q on the rates of deformation.
    """
    shear = add(times(q.s, frame.s), times(q.t, frame.t))
    shear = times(norm(ref.r0), bent(frame.e, rel.n, shear))  # back into the plane of the material
    turned, couple, turning = moments(rel, frame, q)
    a = add(shear, turned)
    w = add(cross(shear, rel.n), times(turning, add(frame.e, rel.n)))
    force = add(times(q.n, rel.n), times(1.0 / rel.length, normal_to(rel.n, a)))
    return Load(force, add(times(0.5, cross(rel.t, w)), couple))
