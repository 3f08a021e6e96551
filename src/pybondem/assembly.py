"""Model -> step program: order the particles, lay out the arrays, choose the stages."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem import bond_answers as answers
from pybondem import bond_bodies as bodies
from pybondem import particle_bodies
from pybondem.bond_answers import BOND, JOINT, Answer, Damaging, Element, Loading
from pybondem.bonds import Bond, Value, ValuedLaw
from pybondem.boundaries import GroupTables
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError, LawError
from pybondem.model import BondSet, Model
from pybondem.neighbours import memory_order, own_bonds
from pybondem.physics.elastic.section import area as circle_area
from pybondem.physics.elastic.section import bending_modulus
from pybondem.physics.types import (
    ComponentRates,
    Components,
    Deformation,
    DragFunction,
    Motion,
    Pose,
    Rate,
    Reference,
    Section,
    Stiffness,
    Viscosity,
)
from pybondem.program import Block, Called, Program, Reads, Stage
from pybondem.scatter import Scatter
from pybondem.state import BOND_FIELDS, CHORD, ENERGY, LOAD, PARTICLE_FIELDS, Fields, allocate

Ints = NDArray[np.integer[Any]]
Floats = NDArray[np.float64]

# What the bodies of `program` read and write, in the order of their arguments and results.
POSE, POSE_I, POSE_J = (Pose, "x", "q"), (Pose, "x.i", "q.i"), (Pose, "x.j", "q.j")
MOTION, MOTION_I, MOTION_J = (Motion, "v", "w"), (Motion, "v.i", "w.i"), (Motion, "v.j", "w.j")
AHEAD_I, AHEAD_J = (Motion, "v_ahead.i", "w_ahead.i"), (Motion, "v_ahead.j", "w_ahead.j")
STIFFNESS = (Stiffness, "kn", "ks", "kt", "kb")
SECTION = (Section, "area", "modulus")
FLOW = (bodies.Flow, AHEAD_I, AHEAD_J, (Viscosity, "cn", "cs", "ct", "cb"), "power", "damped", "dt")
# What a law writes, but for its memory: with one damage, with one for each mode, with loads of its own.
WRITES = {
    ("damage", 1): ("damage", "potential", "lost"),
    ("damage", 4): ("damage", "damages", "potentials", "lost"),
    ("bond", 1): ("before", "answer", "potential", "lost"),
}
SMALL_STRAIN = 1e-6  # that a bond law's stiffness is measured at
DRAG = ("drag", "drag_torque")
START = (POSE, MOTION, "force", "torque")
START_REST = ("mass", "inertia", "hold", "turn_hold", "velocity", "spin", "push", "push_torque", "work", "dt")
STARTED = ("x", "q", "v", "w", "v_ahead", "w_ahead", "work")
FINISH = (MOTION, "force", "torque")
FINISH_REST = ("mass", "inertia", "hold", "turn_hold", "push", "push_torque", "gravity", "work", "dt")
FINISHED = ("force", "torque", "v", "w", "work")


@dataclass(frozen=True)
class Drag:
    """Damping of particles: law(coefficient, force, velocity, mass, dt) -> force, and its coefficient."""

    law: DragFunction
    coefficient: float


@dataclass(frozen=True)
class Assembly:
    """A model laid out for the engines.

    order: model index of each particle in memory; position: place in memory of each particle of the model; blocks: one
    per bond set; tables: of the groups of
    boundary conditions; particles, bonds, shared: the arrays (see `state`).
    """

    model: Model
    order: Ints
    position: Ints
    tables: GroupTables
    particles: Fields
    blocks: tuple[Block, ...]
    bonds: dict[str, Fields]
    shared: Fields

    def element(self, block: int) -> Element:
        """Return the element of a block: bond or joint."""
        return BOND if isinstance(self.model.bonds[block].bond, Bond) else JOINT

    def bond_order(self, block: int) -> Ints:
        """Return the index in its bond set of each bond of a block, in memory order (bonds,)."""
        return _by_ends(np.sort(self.position[self.model.bonds[block].pairs], axis=1))

    def chord(self, arrays: dict[str, Any]) -> Floats:
        """Return the chord from i to j of each bond of a block when it was made (3, bonds) [m]."""
        start = self.particles["start"]
        return start[:, arrays["j"]] - start[:, arrays["i"]]


def assemble(model: Model) -> Assembly:
    """Return the arrays of a model, in memory order. Raises InputError for a model without particles."""
    if len(model) == 0:
        raise InputError("the model has no particles; add some before it is simulated.")
    order = memory_order(model.x, model.radius)
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    group, groups = model.boundaries.groups(len(model))
    counts = [len(bonds.pairs) for bonds in model.bonds]
    blocks = tuple(Block(f"b{b}", sum(counts[:b]), count) for b, count in enumerate(counts))
    names = [block.name for block in blocks]
    arrays = {b: Fields(_bond_arrays(bonds, model, position)) for b, bonds in zip(names, model.bonds, strict=True)}
    tables = GroupTables(groups)
    particles = Fields(_particle_arrays(model, order, group))
    shared = Fields(_shared_arrays(arrays, len(model), sum(counts), tables))
    return Assembly(model, order, position, tables, particles, blocks, arrays, shared)


def uniform(values: Floats) -> Value:
    """Return one number where all values (n,) are equal to round-off (a lattice), else the array."""
    if len(values) and np.ptp(values) <= 1e-12 * abs(float(values[0])):
        return float(values[0])
    return np.ascontiguousarray(values)


def _particle_arrays(model: Model, order: Ints, group: NDArray[np.uint32]) -> dict[str, Any]:
    """Return the arrays of the particles in memory order: at rest where they were placed."""
    constant = {"mass": uniform(model.mass[order]), "inertia": uniform(model.inertia[order]), "group": group[order]}
    changing = allocate(PARTICLE_FIELDS, {f.name for f in PARTICLE_FIELDS} - {*constant, *DRAG, "dragged"}, len(order))
    changing["x"][:] = changing["start"][:] = model.x[order].T
    changing["q"][0] = 1.0
    return {**changing, **constant}


def _shared_arrays(bonds: dict[str, Fields], n: int, count: int, tables: GroupTables) -> dict[str, Any]:
    """Return the arrays that belong to no single block: loads, lists of own bonds, boundary groups and schedules."""
    nothing = np.empty(0, np.uint32)
    i, j = (np.concatenate([nothing, *(arrays[end] for arrays in bonds.values())]) for end in "ij")
    first, ends = own_bonds(i, j, n)
    own = {"load": np.zeros((LOAD.components, count)), "first": first, "ends": ends}
    return own | {"hold": tables.hold, "turn_hold": tables.turn_hold} | tables.schedule(0, 0, 1.0)


def _by_ends(ends: Ints) -> Ints:
    """Return the order of bonds by first, then second end (bonds, 2)."""
    return np.lexsort((ends[:, 1], ends[:, 0]))


def _bond_arrays(bonds: BondSet, model: Model, position: Ints) -> dict[str, Any]:
    """Return the arrays of a bond set in memory order: by first, then second particle."""
    ends = position[bonds.pairs]
    swapped = ends[:, 0] > ends[:, 1]
    ends = np.sort(ends, axis=1)
    order = _by_ends(ends)
    i, j = np.where(swapped[:, None], bonds.pairs[:, ::-1], bonds.pairs)[order].T
    arrays: dict[str, Any] = {"i": ends[order, 0].astype(np.uint32), "j": ends[order, 1].astype(np.uint32)}
    for name, value in _values(bonds, model).items():
        arrays[name] = value if np.ndim(value) == 0 else uniform(np.broadcast_to(value, (len(order),))[order])
    mass, inertia = (uniform(of[i] * of[j] / (of[i] + of[j])) for of in (model.mass, model.inertia))
    for c, k, reduced in (("cn", "kn", mass), ("cs", "ks", mass), ("ct", "kt", inertia), ("cb", "kb", inertia)):
        arrays[c] = 2.0 * bonds.bond.damping * np.sqrt(arrays[k] * reduced)
    law = bonds.bond.law
    if law is not None:
        arrays |= allocate(BOND_FIELDS, set(WRITES[law.kind, law.modes]), len(order))
        arrays |= {f"m_{name}": np.zeros(len(order)) for name in law.memory._fields}
        if "damage" in law.memory._fields:
            arrays["damage"] = arrays["m_damage"]
    if flows(bonds):
        arrays |= allocate(BOND_FIELDS, {"power", "damped"}, len(order))
    if bonds.normal is not None:  # swapping the ends turns r0 and the normal together
        arrays["normal"] = np.ascontiguousarray(np.where(swapped[:, None], -bonds.normal, bonds.normal)[order].T)
    return arrays


def flows(bonds: BondSet) -> bool:
    """Return whether a bond set has dashpots, or a law that reads rates or the time step."""
    return bonds.bond.damping > 0.0 or (bonds.bond.law is not None and bonds.bond.law.flows)


def _values(bonds: BondSet, model: Model) -> dict[str, Any]:
    """Return stiffness, section and law parameters of a bond set: numbers, or one value per bond of the set."""
    i, j = bonds.pairs.T
    if isinstance(bonds.bond, Bond):
        elastic = bonds.bond.elastic
        radius = uniform(elastic.radius_ratio * np.minimum(model.radius[i], model.radius[j]))
        stiffness = elastic.stiffness(radius, uniform(np.linalg.norm(model.x[j] - model.x[i], axis=1)))
        section = Section(circle_area(radius), bending_modulus(radius))
    else:
        assert bonds.area is not None  # Model.join has seen to it
        area = uniform(bonds.area)
        stiffness, section = bonds.bond.stiffness(area), Section(area, 1.0)  # carries no moment: any modulus will do
    values = {**stiffness._asdict(), **section._asdict()}
    if bonds.bond.law is not None:
        middle = 0.5 * (model.x[i] + model.x[j])
        values |= {f"p_{name}": value for name, value in law_values(bonds.bond.law, middle)._asdict().items()}
    for name, value in values.items():
        if np.ndim(value) == 1 and len(value) != len(i):
            known = name.removeprefix("p_")
            raise InputError(f"{known} has {len(value)} values; give one number or one per bond ({len(i)}).")
    return values


def law_values(law: ValuedLaw, middle: Floats) -> Any:
    """Return the parameters of a law with a value per bond in the place of each Scatter; middle (m, 3): of bonds [m].

    Raises InputError where one of these values may not be taken.
    """
    given = law.parameters
    drawn = {name: value.values(middle) for name, value in given._asdict().items() if isinstance(value, Scatter)}
    values = given._replace(**drawn)
    if drawn:
        law.declared.check_values(values)
    return values


# Programs -------------------------------------------------------------------------------------------------------


def step_program(done: Assembly, gravity: tuple[float, float, float], drag: Drag | None) -> Program:
    """Return the program of one time step; gravity (3,) [m/s2]."""
    particles = done.particles
    particles.update(gravity=gravity, no_push=(0.0, 0.0, 0.0))
    if drag is None:
        start = Stage("particles", particle_bodies.start, (*START, *START_REST), STARTED)
        finish = Stage("particles", particle_bodies.finish, (*FINISH, *FINISH_REST), FINISHED, after=True)
    else:
        particles.update(allocate(PARTICLE_FIELDS, {*DRAG, "dragged"}, len(done.order)), coefficient=drag.coefficient)
        reads: Reads = (*START, *DRAG, "dragged", *START_REST)
        start = Stage("particles", particle_bodies.start_dragged, reads, (*STARTED, "dragged"))
        reads, writes = (*FINISH, "dragged", *FINISH_REST, "coefficient"), (*FINISHED, *DRAG, "dragged")
        finish = Stage("particles", particle_bodies.finish_dragged(drag.law), reads, writes, after=True)
    stages = (start, *(bond_stage(done, b) for b in range(len(done.blocks))), Stage("gather"), finish)
    if not any(condition.kind == "push" for condition in done.model.boundaries.conditions):
        stages = tuple(_without_pushes(stage) for stage in stages)
    laws = tuple(called(bonds.bond.law) for bonds in done.model.bonds if bonds.bond.law is not None)
    return Program(stages, done.blocks, particles, done.bonds, done.shared, laws)


def called(law: ValuedLaw) -> Called:
    """Return what engines say of a law, and how they may call it."""
    seen, rate = (Deformation, Rate) if law.kind == "damage" else (Components, ComponentRates)
    types = (seen, Stiffness, law.memory, type(law.parameters), rate, float)
    return Called(law.declared.user, law.function, types)


def _without_pushes(stage: Stage) -> Stage:
    """Return a stage that reads no schedule of pushes: a look-up less for every particle in every step."""
    reads = tuple("no_push" if name in ("push", "push_torque") else name for name in stage.reads)
    return stage._replace(reads=reads)


def bond_stage(done: Assembly, number: int) -> Stage:
    """Return the stage of one bond block in the time step."""
    bonds, element = done.model.bonds[number], done.element(number)
    law = bonds.bond.law
    state: Reads = (answers.Elastic, STIFFNESS)
    writes: tuple[str, ...] = ("load",)
    if law is not None:
        memory = tuple(f"m_{n}" for n in law.memory._fields)
        parameters = (type(law.parameters), *(f"p_{n}" for n in law.parameters._fields))
        book = WRITES[law.kind, law.modes]
        read = book if len(book) == 3 or law.kind == "bond" else book[1:]  # the least damage of all modes is only told
        kind: Reads = (Loading, STIFFNESS, SECTION) if law.kind == "bond" else (Damaging, STIFFNESS, SECTION, "growing")
        state = (*kind, parameters, (law.memory, *memory), *read)
        writes += (*book, *memory)
    answer = _answer(bonds, element)
    reads: Reads = (POSE_I, POSE_J, reference(bonds), state)
    if flows(bonds):
        body = bodies.flowing_body(element, answer)
        return Stage(done.blocks[number].name, body, (*reads, FLOW), (*writes, "power", "damped"))
    return Stage(done.blocks[number].name, bodies.bond_body(answer), reads, writes)


def _answer(bonds: BondSet, element: Element) -> Answer:
    """Return how the bonds of a set answer."""
    law = bonds.bond.law
    if law is None:
        return answers.elastic_answer(element)
    if law.kind == "bond":
        return answers.law_answer(element, law.function, law.memory, law.flows, law.potential)
    of: Any = answers.damage_answer if law.modes == 1 else answers.damage_answer_of_modes
    return of(element, law.function, len(law.memory._fields), law.flows, bonds.bond.hand_over)


def reference(bonds: BondSet) -> Reads:
    """Return how the reference of a bond is read; a bond has no normal of its own."""
    return (Reference, CHORD, CHORD if bonds.normal is None else "normal")


def energy_program(done: Assembly) -> Program:
    """Return the program that evaluates the elastic energy of every bond into "energy" (bonds,) [J].

    That array is put in the place of an empty one at every call: it need not stay.
    """
    shared = done.shared | allocate((ENERGY,), {"energy"}, 0)
    arrays = {name: {"damage": 0.0} | arrays for name, arrays in done.bonds.items()}
    stages = tuple(_energy_stage(done, number) for number in range(len(done.blocks)))
    return Program(stages, done.blocks, done.particles, arrays, shared)


def _energy_stage(done: Assembly, number: int) -> Stage:
    """Return the stage that evaluates the elastic energy of one bond block."""
    bonds, element, name = done.model.bonds[number], done.element(number), done.blocks[number].name
    law = bonds.bond.law
    if law is not None and law.kind == "bond":
        return Stage(name, bodies.stored_energy, (POSE_I, POSE_J, "potential"), ("energy",))
    one = law is None or law.modes == 1
    body = (bodies.energy_body if one else bodies.energy_body_of_modes)(element, bonds.bond.hand_over)
    reads = (POSE_I, POSE_J, reference(bonds), STIFFNESS, "damage" if one else "damages")
    return Stage(name, body, reads, ("energy",))


def linear_program(done: Assembly, dashpots: bool = False) -> Program:
    """Return the program of the model's own stiffness: displacements v [m], rotations w [rad] -> forces, torques.

    dashpots: of its dashpots instead: velocities v [m/s], spins w [rad/s] -> forces, torques.
    """
    arrays: dict[str, dict[str, Any]] = dict(done.bonds)
    for block, bonds in zip(done.blocks, done.model.bonds, strict=True):
        own = done.bonds[block.name]
        if dashpots:
            arrays[block.name] = own | {f"k{m}": own[f"c{m}"] for m in "nstb"}
        elif bonds.bond.law is not None and bonds.bond.law.kind == "bond":
            arrays[block.name] = own | tangent(bonds.bond.law, own, np.linalg.norm(done.chord(own), axis=0))
    particles = allocate(PARTICLE_FIELDS, {"v", "w", "force", "torque"}, len(done.order))
    particles["start"] = done.particles["start"]
    shared = {"load": np.zeros_like(done.shared["load"]), "first": done.shared["first"], "ends": done.shared["ends"]}
    ends = (MOTION_I, MOTION_J)
    stages = tuple(
        Stage(block.name, bodies.linear_body(done.element(b)), (*ends, reference(bonds), STIFFNESS), ("load",))
        for b, (block, bonds) in enumerate(zip(done.blocks, done.model.bonds, strict=True))
    )
    return Program((*stages, Stage("gather")), done.blocks, particles, arrays, shared)


def tangent(law: ValuedLaw, arrays: dict[str, Any], length: Floats) -> dict[str, Any]:
    """Return the stiffness of undeformed bonds under a bond law: the steeper of loading both ways, for each mode.

    arrays: of the block; length (bonds,) [m]. Raises LawError where the law's answer is not finite.
    """
    size = (length, np.broadcast_to(arrays["area"], len(length)))
    k = Stiffness(*(np.broadcast_to(arrays[name], len(length)) for name in STIFFNESS[1:]))
    parameters = type(law.parameters)(*(arrays[f"p_{name}"] for name in law.parameters._fields))
    memory = law.memory(*(np.zeros(len(length)) for _ in law.memory._fields))
    still, function = ComponentRates(*6 * (0.0,)), on_arrays(law.function)
    found: dict[str, Any] = {}
    for name, mode in (("kn", 0), ("ks", 1), ("kt", 3), ("kb", 4)):
        h = SMALL_STRAIN * length if mode < 3 else np.full(len(length), SMALL_STRAIN)
        answers = []
        for sign in (-1.0, 0.0, 1.0):
            u = [np.zeros(len(length)) for _ in range(6)]
            u[mode] = sign * h
            loads, _ = function(Components(*(*u, *size)), k, memory, parameters, still, 0.0)
            answers.append(np.broadcast_to(loads[mode], len(length)))
        if not np.isfinite(answers).all():
            raise LawError(f"{law.name} answers {loads._fields[mode]} with a load that is not finite near rest.")
        slopes = np.abs(np.diff(answers, axis=0)) / h
        found[name] = uniform(slopes.max(axis=0))
    return found
