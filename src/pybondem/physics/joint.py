"""The joint element: a bond across an interface, with the interface's own normal.

In a close packing the chord between two spheres is far from the normal of the interface that they lie on either side
of. A joint therefore stores the normal N0, constant in the material, and measures the displacement beyond rigid
rotation d = r - R(m) r0 along it (opening) and across it (slip); the zero-thickness interface element of Goodman,
Taylor & Brekke (1968), between two spheres. With U = kn d_n^2/2 + ks |d_s|^2/2 + (twist and bending as in a bond) its
load is the exact gradient.
"""

from pybondem.ops import Vector, add, cross, dot, minus, normal_to, times
from pybondem.physics.frame import across, bent, material, moments, rotational_load, twist_and_bending
from pybondem.physics.frame import reference_direction as chord
from pybondem.physics.types import Frame, Load, Loads, Reference, Relative, Stiffness, Stretch


def stretch(rel: Relative, ref: Reference) -> Stretch:
    """Return the deformation of a joint: opening d . N, slip d - (d . N) N, twist and bending."""
    d = minus(rel.r, material(rel, ref.r0))
    normal = material(rel, ref.normal)
    opening = dot(d, normal)
    twist, bending = twist_and_bending(rel)
    return Stretch(opening, minus(d, times(opening, normal)), twist, bending)


def load(rel: Relative, ref: Reference, k: Stiffness) -> Load:
    """Return the load of a joint [N, N m]: minus the gradient of U with respect to the pose of end i."""
    d = minus(rel.r, material(rel, ref.r0))
    normal = material(rel, ref.normal)
    opening = dot(d, normal)
    pull = add(times(k.kn * opening, normal), times(k.ks, minus(d, times(opening, normal))))
    turning, couple = rotational_load(rel, k)
    w = times(-1.0, cross(rel.r, pull))
    force = add(pull, times(1.0 / rel.length, normal_to(rel.n, turning)))
    return Load(force, add(times(0.5, cross(rel.t, w)), couple))


def direction(rel: Relative, ref: Reference) -> Vector:
    """Return the unit vector that opening is measured along: the normal of the interface."""
    return material(rel, ref.normal)


def reference_direction(ref: Reference) -> Vector:
    """Return the unit vector that opening is measured along in the undeformed joint: its normal."""
    return ref.normal


def axes(rel: Relative, ref: Reference) -> Frame:
    """Return the axes of a joint: its normal and two axes of slip, which turn with the material; those of bending."""
    s0, t0 = across(ref.normal)
    e0 = chord(ref)
    e = material(rel, e0)
    u0, v0 = across(e0)
    bend_s, bend_t = bent(rel.n, e, material(rel, u0)), bent(rel.n, e, material(rel, v0))
    return Frame(material(rel, ref.normal), material(rel, s0), material(rel, t0), e, bend_s, bend_t)


def respond(rel: Relative, ref: Reference, frame: Frame, q: Loads) -> Load:
    """Return the load of a joint [N, N m] from the six loads conjugate to its deformation."""
    pull = add(times(q.n, frame.n), add(times(q.s, frame.s), times(q.t, frame.t)))
    turned, couple, turning = moments(rel, frame, q)
    w = add(times(-1.0, cross(rel.r, pull)), times(turning, add(frame.e, rel.n)))
    force = add(pull, times(1.0 / rel.length, normal_to(rel.n, turned)))
    return Load(force, add(times(0.5, cross(rel.t, w)), couple))
