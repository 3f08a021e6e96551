"""How a bond answers its deformation: elastic, under a damage law, or by a bond law's own loads.

An answer is what a step does to one bond but for its dashpots. Each combination of `Element` and law is made once.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from pybondem.ops import Number, Vector, absolute, dot, maximum, minimum, norm, normal_to, sqrt, where
from pybondem.physics import frame, joint
from pybondem.physics.frame import component_rates, components, relative_motion
from pybondem.physics.types import (
    ComponentRates,
    Components,
    Damage,
    Deformation,
    Frame,
    LawFunction,
    Load,
    Loads,
    Motion,
    PotentialFunction,
    Rate,
    Reference,
    Relative,
    Section,
    Stiffness,
    Stretch,
)
from pybondem.program import Numbers

NOT_A_NUMBER = float("nan")
ROUND_OFF = 1e-9  # by which a damage may miss 0 or 1
NONE = Damage(0.0, 0.0, 0.0, 0.0)


class Element(NamedTuple):
    """How a bond deforms and answers.

    stretch(rel, ref); load(rel, ref, k) of springs; direction(rel, ref) that opening is measured along, and
    reference_direction(ref) of the undeformed bond; axes(rel, ref); respond(rel, ref, axes, loads).
    """

    stretch: Callable[[Relative, Reference], Stretch]
    load: Callable[[Relative, Reference, Stiffness], Load]
    direction: Callable[[Relative, Reference], Vector]
    reference_direction: Callable[[Reference], Vector]
    axes: Callable[[Relative, Reference], Frame]
    respond: Callable[[Relative, Reference, Frame, Loads], Load]


BOND = Element(frame.stretch, frame.load, frame.direction, frame.reference_direction, frame.axes, frame.respond)
JOINT = Element(joint.stretch, joint.load, joint.direction, joint.reference_direction, joint.axes, joint.respond)


class Elastic(NamedTuple):
    """What an unbreakable bond is made of."""

    k: Stiffness


class Damaging(NamedTuple):
    """What a bond under a damage law is made of; damage and potential: one number, or one for each mode.

    growing: 1, or 0 while damage is frozen.
    """

    k: Stiffness
    section: Section
    growing: Number
    parameters: Any
    memory: Any
    damage: Any
    potential: Any
    lost: Number


class Loading(NamedTuple):
    """What a bond under a bond law is made of; before, answer: its six components and six loads a step ago."""

    k: Stiffness
    section: Section
    parameters: Any
    memory: Any
    before: tuple[Number, ...]
    answer: tuple[Number, ...]
    potential: Number
    lost: Number


# (rel, ref, state, motion of i, of j, dt) -> load of the bond, damage of its modes, what is written
Answer = Callable[[Relative, Reference, Any, Motion, Motion, Number], tuple[Load, Damage, Numbers]]


# Answers --------------------------------------------------------------------------------------------------------


@cache
def elastic_answer(element: Element) -> Answer:
    """Return the answer of an unbreakable elastic bond."""
    load = element.load

    def elastic(rel: Relative, ref: Reference, state: Elastic, i: Motion, j: Motion,
                dt: Number) -> tuple[Load, Damage, Numbers]:  # fmt: skip
        return load(rel, ref, state.k), NONE, ()

    return elastic


@cache
def damage_answer(element: Element, law: LawFunction, words: int, flows: bool, hand_over: bool) -> Answer:
    """Return the answer of a bond under a damage law with one damage for all modes; words: of its memory.

    Written: damage D, the energy open to damage, the energy lost so far [J], the memory. A growth dD dissipates
    dD sqrt(U_before U_now): what the trapezoid rule of the integrator takes out of the motion, exact to round-off for
    proportional loading, a sudden rupture included. Where the law returns a number that is not finite the bond stays as
    it was, and the energy lost says so.
    """
    stretch, load, rates = element.stretch, element.load, speeds(element) if flows else standstill
    held, total = hold(words), sum_of(words)
    left, released = (handed_over, energy_of_closure) if hand_over else (kept, nothing)

    def damaging(rel: Relative, ref: Reference, state: Damaging, i: Motion, j: Motion,
                 dt: Number) -> tuple[Load, Damage, Numbers]:  # fmt: skip
        k, s = state.k, stretch(rel, ref)
        seen = felt(s, k, state.section, ref)
        now, memory = law(seen, k, state.memory, state.parameters, rates(rel, ref, i, j), dt)
        sound = where(sane(now), finite(total(memory)), False)
        grows = where(state.growing > 0.0, sound, False)
        memory, now = held(grows, memory, state.memory), where(grows, now, state.damage)
        energy = energy_open_to_damage(s, k)
        taken = (now - state.damage) * sqrt(state.potential * energy) + released(s, k, alike(state.damage), alike(now))
        damage, lost = alike(now), state.lost + where(sound, taken, NOT_A_NUMBER)
        return load(rel, ref, left(k, damage, s.opening)), damage, (now, energy, lost, *memory)

    return damaging


@cache
def damage_answer_of_modes(element: Element, law: LawFunction, words: int, flows: bool, hand_over: bool) -> Answer:
    """Return the same for a law with one damage for each mode.

    Written: the larger of the normal and the shear damage in place of D (a bond that cannot be pulled, or not sheared,
    counts as broken), and all four.
    """
    stretch, load, rates = element.stretch, element.load, speeds(element) if flows else standstill
    held, total = hold(words), sum_of(words)
    left, released = (handed_over, energy_of_closure) if hand_over else (kept, nothing)

    def damaging(rel: Relative, ref: Reference, state: Damaging, i: Motion, j: Motion,
                 dt: Number) -> tuple[Load, Damage, Numbers]:  # fmt: skip
        k, s, D, U = state.k, stretch(rel, ref), state.damage, state.potential
        seen = felt(s, k, state.section, ref)
        new, memory = law(seen, k, state.memory, state.parameters, rates(rel, ref, i, j), dt)
        sound = where(all_sane(new), finite(total(memory)), False)
        grows = where(state.growing > 0.0, sound, False)
        memory = held(grows, memory, state.memory)
        now = Damage(
            where(grows, new.normal, D[0]), where(grows, new.shear, D[1]),
            where(grows, new.twist, D[2]), where(grows, new.bending, D[3]),
        )  # fmt: skip
        energy = energies_open_to_damage(s, k)
        taken = (now.normal - D[0]) * sqrt(U[0] * energy[0]) + (now.shear - D[1]) * sqrt(U[1] * energy[1])
        taken = taken + (now.twist - D[2]) * sqrt(U[2] * energy[2]) + (now.bending - D[3]) * sqrt(U[3] * energy[3])
        taken = taken + released(s, k, Damage(D[0], D[1], D[2], D[3]), now)
        lost = state.lost + where(sound, taken, NOT_A_NUMBER)
        answer = load(rel, ref, left(k, now, s.opening))
        return answer, now, (maximum(now.normal, now.shear), *now[:], *energy, lost, *memory)

    return damaging


@cache
def law_answer(element: Element, law: LawFunction, memory_type: Any, flows: bool,
               potential: PotentialFunction | None) -> Answer:  # fmt: skip
    """Return the answer of a bond under a bond law; a word of its memory named damage is the damage of the bond.

    Written: the six components and loads, for the next step, the stored energy W, the energy lost so far [J], the
    memory. Lost is what the loads have been worked on by (trapezoid rule), less what is stored.
    """
    stretch, axes, respond = element.stretch, element.axes, element.respond
    rates = component_rates if flows else no_component_rates
    fields = memory_type._fields
    held, total, gone = hold(len(fields)), sum_of(len(fields)), its_damage if "damage" in fields else no_damage
    stored = complementary_energy if potential is None else energy_by(potential)

    def loading(rel: Relative, ref: Reference, state: Loading, i: Motion, j: Motion,
                dt: Number) -> tuple[Load, Damage, Numbers]:  # fmt: skip
        k, p, now = state.k, state.parameters, axes(rel, ref)
        u = components(rel, ref, now, state.section.area, stretch(rel, ref))
        q, memory = law(u, k, state.memory, p, rates(rel, now, i, j), dt)
        a, b = state.answer, state.before
        sound = finite(q.n + q.s + q.t + q.twist + q.bend_s + q.bend_t + total(memory))
        q = Loads(
            where(sound, q.n, a[0]), where(sound, q.s, a[1]), where(sound, q.t, a[2]),
            where(sound, q.twist, a[3]), where(sound, q.bend_s, a[4]), where(sound, q.bend_t, a[5]),
        )  # fmt: skip
        memory = held(sound, memory, state.memory)
        kept = memory_type(*memory)
        work = (a[0] + q.n) * (u.n - b[0]) + (a[1] + q.s) * (u.s - b[1]) + (a[2] + q.t) * (u.t - b[2])
        work = work + (a[3] + q.twist) * (u.twist - b[3])
        work = work + (a[4] + q.bend_s) * (u.bend_s - b[4]) + (a[5] + q.bend_t) * (u.bend_t - b[5])
        energy = stored(u, k, kept, p, q)
        lost = state.lost + where(sound, 0.5 * work - (energy - state.potential), NOT_A_NUMBER)
        book = (u.n, u.s, u.t, u.twist, u.bend_s, u.bend_t, *q[:], energy, lost)
        return respond(rel, ref, now, q), alike(gone(kept)), (*book, *memory)

    return loading


# Parts ----------------------------------------------------------------------------------------------------------


def felt(s: Stretch, k: Stiffness, section: Section, ref: Reference) -> Deformation:
    """Return what a damage law sees of a stretch: scalars, and stresses and stiffness of the undamaged bond."""
    slip, bending = norm(s.slip), norm(s.bending)
    twist = absolute(s.twist)
    kn, ks = k.kn / section.area, k.ks / section.area
    kb, kt = k.kb / section.modulus, 0.5 * k.kt / section.modulus
    return Deformation(
        s.opening, slip, twist, bending, norm(ref.r0), section.area,
        kn * s.opening, ks * slip, kb * bending, kt * twist, kn, ks,
    )  # fmt: skip


@cache
def speeds(element: Element) -> Callable[[Relative, Reference, Motion, Motion], Rate]:
    """Return the function that says how fast a bond deforms (in small strain)."""
    direction = element.direction

    def rates(rel: Relative, ref: Reference, i: Motion, j: Motion) -> Rate:
        n = direction(rel, ref)
        v, w = relative_motion(rel, i, j)
        return Rate(dot(v, n), norm(normal_to(n, v)), absolute(dot(w, rel.n)), norm(normal_to(rel.n, w)))

    return rates


def standstill(rel: Relative, ref: Reference, i: Motion, j: Motion) -> Rate:
    """Return no rates, for laws that do not ask for them."""
    return Rate(0.0, 0.0, 0.0, 0.0)


def no_component_rates(rel: Relative, axes: Frame, i: Motion, j: Motion) -> ComponentRates:
    """Return no rates, for laws that do not ask for them."""
    return ComponentRates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def alike(damage: Number) -> Damage:
    """Return the same damage for all modes."""
    return Damage(damage, damage, damage, damage)


def kept(k: Stiffness, damage: Damage, opening: Number) -> Stiffness:
    """Return the stiffness that damage has left; a closed bond keeps its normal stiffness."""
    kn = where(opening < 0.0, k.kn, (1.0 - damage.normal) * k.kn)
    return Stiffness(kn, (1.0 - damage.shear) * k.ks, (1.0 - damage.twist) * k.kt, (1.0 - damage.bending) * k.kb)


def handed_over(k: Stiffness, damage: Damage, opening: Number) -> Stiffness:
    """Return the same for a bond whose pair goes to a contact law once all of it has failed."""
    left = kept(k, damage, opening)
    return Stiffness(where(least(k, damage) < 1.0, left.kn, 0.0), left.ks, left.kt, left.kb)


def energy_of_closure(s: Stretch, k: Stiffness, before: Damage, now: Damage) -> Number:
    """Return the energy [J] that goes with a closed bond when it is handed over: in the step where all of it fails."""
    fails = where(least(k, before) < 1.0, where(least(k, now) < 1.0, 0.0, 1.0), 0.0)
    return fails * where(s.opening < 0.0, 0.5 * k.kn * s.opening * s.opening, 0.0)


def nothing(s: Stretch, k: Stiffness, before: Damage, now: Damage) -> Number:
    """Return 0: a broken bond keeps what it holds when it is pressed together."""
    return 0.0


def least(k: Stiffness, damage: Damage) -> Number:
    """Return the least damage of the modes that the bond has: 1 once nothing is left."""
    normal, shear = where(k.kn > 0.0, damage.normal, 1.0), where(k.ks > 0.0, damage.shear, 1.0)
    twist, bending = where(k.kt > 0.0, damage.twist, 1.0), where(k.kb > 0.0, damage.bending, 1.0)
    return minimum(minimum(normal, shear), minimum(twist, bending))


def elastic_energy(s: Stretch, k: Stiffness) -> Number:
    """Return U [J], the elastic energy of a bond (see `physics.frame`)."""
    normal, shear, twist, bending = mode_energies(s, k)
    return normal + shear + (twist + bending)


def mode_energies(s: Stretch, k: Stiffness) -> tuple[Number, Number, Number, Number]:
    """Return the elastic energies [J] of opening, slip, twist and bending."""
    return (
        0.5 * k.kn * s.opening * s.opening, 0.5 * k.ks * dot(s.slip, s.slip),
        0.5 * k.kt * s.twist * s.twist, 0.5 * k.kb * dot(s.bending, s.bending),
    )  # fmt: skip


def energies_open_to_damage(s: Stretch, k: Stiffness) -> tuple[Number, Number, Number, Number]:
    """Return the energies [J] that damage of each mode acts on: not the normal one of a closed bond."""
    return mode_energies(s, Stiffness(where(s.opening < 0.0, 0.0, k.kn), k.ks, k.kt, k.kb))


def energy_open_to_damage(s: Stretch, k: Stiffness) -> Number:
    """Return the part of U [J] that damage acts on: all of it, but the normal part of a closed bond."""
    return elastic_energy(s, Stiffness(where(s.opening < 0.0, 0.0, k.kn), k.ks, k.kt, k.kb))


def complementary_energy(u: Components, k: Stiffness, m: Any, p: Any, q: Loads) -> Number:
    """Return the energy [J] that the loads hold in the elastic form: sum Q^2 / 2k."""
    shear, bending = q.s * q.s + q.t * q.t, q.bend_s * q.bend_s + q.bend_t * q.bend_t
    return 0.5 * (over(q.n * q.n, k.kn) + over(shear, k.ks) + over(q.twist * q.twist, k.kt) + over(bending, k.kb))


def over(a: Number, b: Number) -> Number:
    """Return a / b, or 0 where b is 0."""
    return where(b > 0.0, a, 0.0) / where(b > 0.0, b, 1.0)


@cache
def energy_by(potential: PotentialFunction) -> Callable[[Components, Stiffness, Any, Any, Loads], Number]:
    """Return the stored energy [J] by a law's own potential."""

    def energy(u: Components, k: Stiffness, m: Any, p: Any, q: Loads) -> Number:
        return potential(u, k, m, p)

    return energy


def its_damage(memory: Any) -> Number:
    """Return the word of a memory that is named damage."""
    return memory.damage


def no_damage(memory: Any) -> Number:
    """Return 0, for a memory without that word."""
    return 0.0


def sane(damage: Number) -> Any:
    """Return whether a damage lies between 0 and 1 (but for round-off) and is a number."""
    return absolute(damage - 0.5) <= 0.5 + ROUND_OFF


def all_sane(damage: Damage) -> Any:
    """Return whether the damage of each mode is sane."""
    across = where(sane(damage.twist), sane(damage.bending), False)
    return where(sane(damage.normal), where(sane(damage.shear), across, False), False)


def finite(a: Number) -> Any:
    """Return whether a number is neither infinite nor no number at all."""
    return a - a == 0.0


@cache
def hold(words: int) -> Callable[[Any, Any, Any], tuple[Number, ...]]:
    """Return the function of (condition, new, old) that keeps the old words of a memory where the condition fails."""
    if words == 0:
        return lambda sound, new, old: ()
    rest = hold(words - 1)
    return lambda sound, new, old: (where(sound, new[0], old[0]), *rest(sound, new[1:], old[1:]))


@cache
def sum_of(words: int) -> Callable[[Any], Number]:
    """Return the function that adds the words of a memory."""
    if words == 0:
        return lambda memory: 0.0
    rest = sum_of(words - 1)
    return lambda memory: memory[0] + rest(memory[1:])
