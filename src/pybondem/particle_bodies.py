"""What a time step does to one particle: bodies of the stages over particles, and what they read and write."""

from functools import cache

from pybondem.ops import Number, Vector, add, dot, times
from pybondem.physics.motion import boundary_power, choose, drifted, kicked, turned
from pybondem.physics.types import DragFunction, Motion, Pose
from pybondem.program import Body, Numbers


def start(pose: Pose, moving: Motion, force: Vector, torque: Vector, mass: Number, inertia: Number, hold: Vector,
          turn_hold: Vector, velocity: Vector, spin: Vector, push: Vector, push_torque: Vector, work: Number,
          dt: Number) -> Numbers:  # fmt: skip
    """Half kick, drift, turn; the motion foreseen for the end of the step; work of the boundary."""
    h = 0.5 * dt
    v = choose(hold, velocity, kicked(moving.v, force, mass, h))
    w = choose(turn_hold, spin, kicked(moving.w, torque, inertia, h))
    power = boundary_power(hold, push, force, v) + boundary_power(turn_hold, push_torque, torque, w)
    v_ahead = choose(hold, velocity, kicked(v, force, mass, h))
    w_ahead = choose(turn_hold, spin, kicked(w, torque, inertia, h))
    x, q = drifted(pose.x, v, dt), turned(pose.q, w, dt)
    return *x, *q, *v, *w, *v_ahead, *w_ahead, work + h * power


def start_dragged(pose: Pose, moving: Motion, force: Vector, torque: Vector, drag: Vector, drag_torque: Vector,
                  dragged: Number, mass: Number, inertia: Number, hold: Vector, turn_hold: Vector, velocity: Vector,
                  spin: Vector, push: Vector, push_torque: Vector, work: Number, dt: Number) -> Numbers:  # fmt: skip
    """The same under local or global damping, whose work is booked apart."""
    moved = start(
        pose, moving, add(force, drag), add(torque, drag_torque), mass, inertia, hold, turn_hold, velocity, spin,
        push, push_torque, work, dt,
    )  # fmt: skip
    v, w = (moved[7], moved[8], moved[9]), (moved[10], moved[11], moved[12])
    return *moved, dragged - 0.5 * dt * (dot(drag, v) + dot(drag_torque, w))


def finish(moving: Motion, force: Vector, torque: Vector, mass: Number, inertia: Number, hold: Vector,
           turn_hold: Vector, push: Vector, push_torque: Vector, gravity: Vector, work: Number,
           dt: Number) -> Numbers:  # fmt: skip
    """Push and gravity, half kick; work of the boundary."""
    h = 0.5 * dt
    force = add(force, add(push, times(mass, gravity)))
    torque = add(torque, push_torque)
    power = boundary_power(hold, push, force, moving.v)
    power = power + boundary_power(turn_hold, push_torque, torque, moving.w)
    v = choose(hold, moving.v, kicked(moving.v, force, mass, h))
    w = choose(turn_hold, moving.w, kicked(moving.w, torque, inertia, h))
    return *force, *torque, *v, *w, work + h * power


@cache
def finish_dragged(drag_law: DragFunction) -> Body:
    """Return `finish` with the damping force drag_law(coefficient, force, velocity, mass, dt) on free components."""

    def finish_with_drag(moving: Motion, force: Vector, torque: Vector, dragged: Number, mass: Number, inertia: Number,
                         hold: Vector, turn_hold: Vector, push: Vector, push_torque: Vector, gravity: Vector,
                         work: Number, dt: Number, coefficient: Number) -> Numbers:  # fmt: skip
        h = 0.5 * dt
        zero = (0.0, 0.0, 0.0)
        done = finish(moving, force, torque, mass, inertia, hold, turn_hold, push, push_torque, gravity, work, dt)
        force, torque = (done[0], done[1], done[2]), (done[3], done[4], done[5])
        v, w = (done[6], done[7], done[8]), (done[9], done[10], done[11])
        drag = choose(hold, zero, drag_law(coefficient, force, moving.v, mass, dt))
        drag_torque = choose(turn_hold, zero, drag_law(coefficient, torque, moving.w, inertia, dt))
        v, w = kicked(v, drag, mass, h), kicked(w, drag_torque, inertia, h)
        dragged = dragged - h * (dot(drag, moving.v) + dot(drag_torque, moving.w))
        return *force, *torque, *v, *w, done[12], *drag, *drag_torque, dragged

    return finish_with_drag
