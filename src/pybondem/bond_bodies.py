"""What a time step does to one bond: poses -> deformation -> law -> load, memory, energy book.

A body is an answer (`bond_answers`) to the poses of two ends, with dashpots where there are any, compiled once.
"""

from functools import cache
from typing import Any, NamedTuple

from pybondem.bond_answers import Answer, Element, alike, elastic_energy, handed_over, kept
from pybondem.ops import Number, Vector, add, cross, minus, times
from pybondem.physics.frame import linear_load, relative_pose, viscous_load
from pybondem.physics.types import Damage, Load, Motion, Pose, Reference, Relative, Stiffness, Viscosity
from pybondem.program import Body, Numbers

REST = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class Flow(NamedTuple):
    """Motions of the ends, dashpots and their book, time step: what a bond reads that depends on velocity."""

    i: Motion
    j: Motion
    c: Viscosity
    power: Number
    damped: Number
    dt: Number


# Bodies ---------------------------------------------------------------------------------------------------------


@cache
def bond_body(answer: Answer) -> Body:
    """Return the body of a bond without dashpots."""

    def bond(i: Pose, j: Pose, ref: Reference, state: Any) -> Numbers:
        rel = relative_pose(i, j)
        load, _, book = answer(rel, ref, state, REST, REST, 0.0)
        return *ends(rel.r, load), *book

    return bond


@cache
def flowing_body(element: Element, answer: Answer) -> Body:
    """Return the body of a bond with dashpots, or with a law that reads rates or the time step."""
    direction = element.direction

    def flowing(i: Pose, j: Pose, ref: Reference, state: Any, flow: Flow) -> Numbers:
        rel = relative_pose(i, j)
        load, damage, book = answer(rel, ref, state, flow.i, flow.j, flow.dt)
        viscous, power, damped = dashpots(rel, direction(rel, ref), flow, damage)
        return *ends(rel.r, both(load, viscous)), *book, power, damped

    return flowing


@cache
def energy_body(element: Element, hand_over: bool) -> Body:
    """Return the body that evaluates the elastic energy [J] of a bond at frozen damage: one number."""
    stretch, left = element.stretch, handed_over if hand_over else kept

    def energy(i: Pose, j: Pose, ref: Reference, k: Stiffness, damage: Number) -> Number:
        s = stretch(relative_pose(i, j), ref)
        return elastic_energy(s, left(k, alike(damage), s.opening))

    return energy


@cache
def energy_body_of_modes(element: Element, hand_over: bool) -> Body:
    """Return the same for a bond with one damage for each mode."""
    stretch, left = element.stretch, handed_over if hand_over else kept

    def energy(i: Pose, j: Pose, ref: Reference, k: Stiffness, damages: tuple[Number, ...]) -> Number:
        s = stretch(relative_pose(i, j), ref)
        return elastic_energy(s, left(k, Damage(damages[0], damages[1], damages[2], damages[3]), s.opening))

    return energy


def stored_energy(i: Pose, j: Pose, potential: Number) -> Number:
    """Return the energy [J] that a bond under a bond law holds: evaluated with its loads."""
    return potential


@cache
def linear_body(element: Element) -> Body:
    """Return the body of the linearised bond: displacements and rotations of the ends -> load, nine numbers."""
    opening = element.reference_direction

    def linear(i: Motion, j: Motion, ref: Reference, k: Stiffness) -> Numbers:
        return ends(ref.r0, linear_load(i, j, opening(ref), ref, k))

    return linear


# Parts ----------------------------------------------------------------------------------------------------------


def ends(r: Vector, load: Load) -> Numbers:
    """Return the force on i [N], the torque on i and the torque on j [N m]: nine numbers."""
    lever = times(0.5, cross(r, load.force))
    return *load.force, *add(lever, load.couple), *minus(lever, load.couple)


def both(a: Load, b: Load) -> Load:
    """Return the sum of two loads."""
    return Load(add(a.force, b.force), add(a.couple, b.couple))


def dashpots(rel: Relative, n: Vector, flow: Flow, damage: Damage) -> tuple[Load, Number, Number]:
    """Return the load of the dashpots and their book: power now [W], energy taken so far [J] (trapezoid rule)."""
    c = flow.c
    left = Viscosity(
        (1.0 - damage.normal) * c.cn, (1.0 - damage.shear) * c.cs,
        (1.0 - damage.twist) * c.ct, (1.0 - damage.bending) * c.cb,
    )  # fmt: skip
    viscous, taken = viscous_load(rel, n, flow.i, flow.j, left)
    return viscous, taken, flow.damped + 0.5 * flow.dt * (flow.power + taken)
