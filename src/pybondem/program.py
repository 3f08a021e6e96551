"""The step program: what is evaluated, in which order, on which numbers.

A `Stage` is one loop: a body (a pure function of numbers), what it runs over, what it reads and what it writes, by
the names in `state`. An engine turns the list of stages into loops and advances them many steps per call; it adds
nothing to the physics. `x.i` is the position of a bond's first end, `x.j` of its second. A read that is a tuple
(Type, names...) is handed to the body as that named tuple.

The time step on one screen:

    start     half kick, drift, turn; held components from the schedule    every particle
    bonds     poses -> deformation -> damage -> load, memory               every bond, one block per law
    gather    sum of the loads of a particle's own bonds, in fixed order   every particle
    finish    pushes, gravity, damping, half kick                          every particle
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from pybondem.ops import Number, Vector, add, cross, dot, minus, norm, sqrt, times, where
from pybondem.physics import frame, joint
from pybondem.physics.frame import linear_load, relative_pose, viscous_load
from pybondem.physics.motion import boundary_power, choose, drifted, kicked, turned
from pybondem.physics.types import (
    DamageFunction,
    Deformation,
    DragFunction,
    Load,
    Motion,
    Pose,
    Reference,
    Relative,
    Section,
    Stiffness,
    Stretch,
    Viscosity,
)

Reads = tuple[Any, ...]  # names of fields, and (Type, names...)
Numbers = tuple[Number, ...]  # what a body returns: all components of its writes, in one flat tuple
Body = Callable[..., Any]  # what a stage calls: Numbers, or one number


class Stage(NamedTuple):
    """One loop over "particles", over the bonds of a block, or the "gather"; body, reads, writes.

    after: scheduled reads take the row at the end of the step, not the one at its start.
    """

    over: str
    body: Body | None = None
    reads: Reads = ()
    writes: tuple[str, ...] = ()
    after: bool = False


class Element(NamedTuple):
    """How a bond deforms and answers: stretch(rel, ref), load(rel, ref, k), which way it opens, now and at first."""

    stretch: Callable[[Relative, Reference], Stretch]
    load: Callable[[Relative, Reference, Stiffness], Load]
    direction: Callable[[Relative, Reference], Vector]
    reference_direction: Callable[[Reference], Vector]


BOND = Element(frame.stretch, frame.load, frame.direction, frame.reference_direction)
JOINT = Element(joint.stretch, joint.load, joint.direction, joint.reference_direction)


@dataclass(frozen=True)
class Block:
    """One contiguous block of bonds under one law: name, position of its first bond, number of bonds."""

    name: str
    first: int
    count: int


class Program(NamedTuple):
    """Stages and the arrays they work on.

    particles: arrays of particle fields; bonds: for each block its arrays of bond fields; shared: load, the lists of
    each particle's own bonds, boundary groups and schedules. A constant is a number, a tuple of numbers, or an array
    with one value per item, and is read by name like a field.
    """

    stages: tuple[Stage, ...]
    blocks: tuple[Block, ...]
    particles: dict[str, Any]
    bonds: dict[str, dict[str, Any]]
    shared: dict[str, Any]

    def block(self, name: str) -> Block:
        """Return the block of that name."""
        return next(block for block in self.blocks if block.name == name)


# Particles ------------------------------------------------------------------------------------------------------


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


# Bonds ----------------------------------------------------------------------------------------------------------


def ends(r: Vector, load: Load) -> Numbers:
    """Return the force on i [N], the torque on i and the torque on j [N m]: nine numbers."""
    lever = times(0.5, cross(r, load.force))
    return *load.force, *add(lever, load.couple), *minus(lever, load.couple)


def felt(s: Stretch, k: Stiffness, section: Section, ref: Reference) -> Deformation:
    """Return what a damage law sees of a stretch: scalars and the stresses of the undamaged bond."""
    slip, bending = norm(s.slip), norm(s.bending)
    twist = sqrt(s.twist * s.twist)
    return Deformation(
        s.opening, slip, twist, bending, norm(ref.r0), section.area,
        k.kn * s.opening / section.area, k.ks * slip / section.area,
        k.kb * bending / section.modulus, 0.5 * k.kt * twist / section.modulus,
    )  # fmt: skip


def kept(k: Stiffness, damage: Number, opening: Number) -> Stiffness:
    """Return the stiffness that damage has left; a closed bond keeps its normal stiffness."""
    whole = 1.0 - damage
    return Stiffness(where(opening < 0.0, k.kn, whole * k.kn), whole * k.ks, whole * k.kt, whole * k.kb)


def elastic_energy(s: Stretch, k: Stiffness) -> Number:
    """Return U [J], the elastic energy of a bond (see `physics.frame`)."""
    shear = k.ks * dot(s.slip, s.slip)
    rotation = k.kt * s.twist * s.twist + k.kb * dot(s.bending, s.bending)
    return 0.5 * (k.kn * s.opening * s.opening + shear + rotation)


def energy_open_to_damage(s: Stretch, k: Stiffness) -> Number:
    """Return the part of U [J] that damage acts on: all of it, but the normal part of a closed bond."""
    return elastic_energy(s, Stiffness(where(s.opening < 0.0, 0.0, k.kn), k.ks, k.kt, k.kb))


@cache
def damage_step(element: Element, law: DamageFunction) -> Callable[..., tuple[Stiffness, Number, Numbers]]:
    """Return the function that grows the damage of a bond and books the energy it takes.

    It returns the stiffness that is left, the share 1 - D that is whole, and what is written: D, the energy open to
    damage, the energy lost so far [J], the memory of the law. A growth dD dissipates dD sqrt(U_before U_now): what the
    trapezoid rule of the integrator takes out of the motion, exact to round-off for proportional loading, a sudden
    rupture included.
    """
    stretch = element.stretch

    def step(rel: Relative, ref: Reference, k: Stiffness, section: Section, parameters: Any, memory: Any,
             damage: Number, potential: Number, lost: Number) -> tuple[Stiffness, Number, Numbers]:  # fmt: skip
        s = stretch(rel, ref)
        now, memory = law(felt(s, k, section, ref), memory, parameters)
        energy = energy_open_to_damage(s, k)
        lost = lost + (now - damage) * sqrt(potential * energy)
        return kept(k, now, s.opening), 1.0 - now, (now, energy, lost, *memory[:])

    return step


def dashpots(rel: Relative, n: Vector, moving_i: Motion, moving_j: Motion, c: Viscosity, whole: Number, power: Number,
             damped: Number, dt: Number) -> tuple[Load, Number, Number]:  # fmt: skip
    """Return the load of the dashpots and their book: power now [W], energy taken so far [J] (trapezoid rule)."""
    viscous, taken = viscous_load(rel, n, moving_i, moving_j, c)
    taken = whole * taken
    return Load(times(whole, viscous.force), times(whole, viscous.couple)), taken, damped + 0.5 * dt * (power + taken)


def both(a: Load, b: Load) -> Load:
    """Return the sum of two loads."""
    return Load(add(a.force, b.force), add(a.couple, b.couple))


@cache
def elastic_body(element: Element) -> Body:
    """Return the body of an unbreakable elastic bond."""
    load = element.load

    def elastic(i: Pose, j: Pose, ref: Reference, k: Stiffness) -> Numbers:
        rel = relative_pose(i, j)
        return ends(rel.r, load(rel, ref, k))

    return elastic


@cache
def viscous_body(element: Element) -> Body:
    """Return the body of an unbreakable bond with dashpots."""
    load, direction = element.load, element.direction

    def viscous(i: Pose, j: Pose, ref: Reference, k: Stiffness, moving_i: Motion, moving_j: Motion, c: Viscosity,
                power: Number, damped: Number, dt: Number) -> Numbers:  # fmt: skip
        rel = relative_pose(i, j)
        dashpot, power, damped = dashpots(rel, direction(rel, ref), moving_i, moving_j, c, 1.0, power, damped, dt)
        return *ends(rel.r, both(load(rel, ref, k), dashpot)), power, damped

    return viscous


@cache
def damaging_body(element: Element, law: DamageFunction) -> Body:
    """Return the body of a bond with a damage law."""
    grow, load = damage_step(element, law), element.load

    def damaging(i: Pose, j: Pose, ref: Reference, k: Stiffness, section: Section, parameters: Any, memory: Any,
                 damage: Number, potential: Number, lost: Number) -> Numbers:  # fmt: skip
        rel = relative_pose(i, j)
        left, _, book = grow(rel, ref, k, section, parameters, memory, damage, potential, lost)
        return *ends(rel.r, load(rel, ref, left)), *book

    return damaging


@cache
def damaging_viscous_body(element: Element, law: DamageFunction) -> Body:
    """Return the body of a bond with a damage law and dashpots."""
    grow, load, direction = damage_step(element, law), element.load, element.direction

    def damaging_viscous(i: Pose, j: Pose, ref: Reference, k: Stiffness, section: Section, parameters: Any,
                         memory: Any, damage: Number, potential: Number, lost: Number, moving_i: Motion,
                         moving_j: Motion, c: Viscosity, power: Number, damped: Number,
                         dt: Number) -> Numbers:  # fmt: skip
        rel = relative_pose(i, j)
        left, whole, book = grow(rel, ref, k, section, parameters, memory, damage, potential, lost)
        dashpot, power, damped = dashpots(rel, direction(rel, ref), moving_i, moving_j, c, whole, power, damped, dt)
        return *ends(rel.r, both(load(rel, ref, left), dashpot)), *book, power, damped

    return damaging_viscous


@cache
def energy_body(element: Element) -> Body:
    """Return the body that evaluates the elastic energy [J] of a bond at frozen damage: one number."""
    stretch = element.stretch

    def energy(i: Pose, j: Pose, ref: Reference, k: Stiffness, damage: Number) -> Number:
        s = stretch(relative_pose(i, j), ref)
        return elastic_energy(s, kept(k, damage, s.opening))

    return energy


@cache
def linear_body(element: Element) -> Body:
    """Return the body of the linearised bond: displacements and rotations of the ends -> load, nine numbers."""
    opening = element.reference_direction

    def linear(i: Motion, j: Motion, ref: Reference, k: Stiffness) -> Numbers:
        return ends(ref.r0, linear_load(i, j, opening(ref), ref, k))

    return linear
