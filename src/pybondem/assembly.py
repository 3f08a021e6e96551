"""Model -> step program: order the particles, lay out the arrays, choose the stages."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem import program as pg
from pybondem.bonds import Bond
from pybondem.boundaries import GroupTables
from pybondem.errors import InputError
from pybondem.model import BondSet, Model
from pybondem.neighbours import memory_order, own_bonds
from pybondem.physics.elastic.section import area as circle_area
from pybondem.physics.types import Motion, Pose, Reference, Section, Stiffness, Viscosity
from pybondem.program import BOND, JOINT, Block, Program, Stage
from pybondem.state import BOND_FIELDS, ENERGY, LOAD, PARTICLE_FIELDS, allocate

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

POSE_I, POSE_J = (Pose, "x.i", "q.i"), (Pose, "x.j", "q.j")
STIFFNESS = (Stiffness, "kn", "ks", "kt", "kb")
VISCOUS = ((Motion, "v_ahead.i", "w_ahead.i"), (Motion, "v_ahead.j", "w_ahead.j"), (Viscosity, "cn", "cs", "ct", "cb"),
           "power", "damped", "dt")  # fmt: skip
HELD = ("hold", "turn_hold")
START = ((Pose, "x", "q"), (Motion, "v", "w"), "force", "torque")
START_REST = ("mass", "inertia", *HELD, "velocity", "spin", "push", "push_torque", "work", "dt")
MOVED = ("x", "q", "v", "w", "v_ahead", "w_ahead", "work")
FINISH_REST = ("mass", "inertia", *HELD, "push", "push_torque", "gravity", "work", "dt")


@dataclass(frozen=True)
class Drag:
    """Damping of particles: law(coefficient, force, velocity, mass, dt) -> force, and its coefficient."""

    law: Callable[..., Any]
    coefficient: float


@dataclass
class Assembly:
    """A model laid out for the engines.

    order: model index of each particle in memory; blocks: one per bond set, with bond_order[b] the bond's index in its
    set for each bond in memory; particles, bonds, shared: the arrays (see `state`).
    """

    model: Model
    order: Ints
    position: Ints
    tables: GroupTables
    particles: dict[str, Any]
    blocks: tuple[Block, ...] = ()
    bonds: dict[str, dict[str, Any]] = field(default_factory=dict)
    shared: dict[str, Any] = field(default_factory=dict)
    bond_order: list[Ints] = field(default_factory=list)

    def element(self, block: int) -> pg.Element:
        """Return the element of a block: bond or joint."""
        return BOND if isinstance(self.model.bonds[block].bond, Bond) else JOINT


def assemble(model: Model) -> Assembly:
    """Return the arrays of a model, in memory order. Raises InputError for a model without particles."""
    if len(model) == 0:
        raise InputError("the model has no particles; add some before it is simulated.")
    order = memory_order(model.x, model.radius)
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    group, groups = model.boundaries.groups(len(model))
    particles: dict[str, Any] = allocate(PARTICLE_FIELDS, {f.name for f in PARTICLE_FIELDS} - {"drag", "drag_torque"}, len(model))
    particles["x"][:] = model.x[order].T
    particles["q"][0] = 1.0
    particles["mass"], particles["inertia"] = uniform(model.mass[order]), uniform(model.inertia[order])
    particles["group"] = group[order]
    done = Assembly(model, order, position, GroupTables(groups), particles)
    first = 0
    for number, bonds in enumerate(model.bonds):
        done.blocks += (Block(f"b{number}", first, len(bonds.pairs)),)
        arrays, bond_order = _block(bonds, model, position)
        done.bonds[f"b{number}"] = arrays
        done.bond_order.append(bond_order)
        first += len(bonds.pairs)
    nothing = np.empty(0, np.uint32)
    i, j = (np.concatenate([nothing, *(b[end] for b in done.bonds.values())]) for end in "ij")
    own_first, own_ends = own_bonds(i, j, len(model))
    done.shared = {
        "load": np.zeros((LOAD.components, first)), "first": own_first, "ends": own_ends,
        "hold": done.tables.hold, "turn_hold": done.tables.turn_hold, **done.tables.schedule(0, 0, 1.0),
    }  # fmt: skip
    return done


def uniform(values: Floats) -> float | Floats:
    """Return one number where all values are equal to round-off (a lattice), else the array."""
    if len(values) and np.ptp(values) <= 1e-12 * abs(float(values[0])):
        return float(values[0])
    return np.ascontiguousarray(values)


def _block(bonds: BondSet, model: Model, position: Ints) -> tuple[dict[str, Any], Ints]:
    """Return the arrays of a bond set in memory order (by first, then second particle), and that order."""
    ends = position[bonds.pairs]
    swapped = ends[:, 0] > ends[:, 1]
    ends = np.sort(ends, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    pairs = np.where(swapped[:, None], bonds.pairs[:, ::-1], bonds.pairs)[order]
    arrays: dict[str, Any] = {"i": ends[order, 0].astype(np.uint32), "j": ends[order, 1].astype(np.uint32)}
    arrays["r0"] = np.ascontiguousarray((model.x[pairs[:, 1]] - model.x[pairs[:, 0]]).T)
    mass, inertia = model.mass, model.inertia
    for name, value in _values(bonds, model).items():
        arrays[name] = value if np.ndim(value) == 0 else uniform(np.broadcast_to(value, (len(order),))[order])
    for name, k in (("cn", "kn"), ("cs", "ks"), ("ct", "kt"), ("cb", "kb")):
        body = mass if k in ("kn", "ks") else inertia
        effective = uniform(body[pairs[:, 0]] * body[pairs[:, 1]] / (body[pairs[:, 0]] + body[pairs[:, 1]]))
        arrays[name] = 2.0 * bonds.bond.damping * np.sqrt(arrays[k] * effective)
    wanted = ({"power", "damped"} if bonds.bond.damping > 0.0 else set()) | (
        {"damage", "potential", "lost"} if _law(bonds) else set()
    )
    arrays.update(allocate(BOND_FIELDS, wanted, len(order)))
    law = _law(bonds)
    if law is not None:
        arrays.update({f"m_{name}": np.zeros(len(order)) for name in law.memory._fields})
    if bonds.normal is not None:  # swapping the ends turns r0 and the normal together
        arrays["normal"] = np.ascontiguousarray(np.where(swapped[:, None], -bonds.normal, bonds.normal)[order].T)
    return arrays, order


def _law(bonds: BondSet) -> Any:
    return bonds.bond.damage if isinstance(bonds.bond, Bond) else bonds.bond.law


def _values(bonds: BondSet, model: Model) -> dict[str, Any]:
    """Return stiffness, section and law parameters of a bond set: numbers, or one value per bond of the set."""
    i, j = bonds.pairs.T
    if isinstance(bonds.bond, Bond):
        elastic = bonds.bond.elastic
        radius = uniform(elastic.radius_ratio * np.minimum(model.radius[i], model.radius[j]))
        stiffness = elastic.stiffness(radius, uniform(np.linalg.norm(model.x[j] - model.x[i], axis=1)))
        area, modulus = circle_area(radius), 0.25 * np.pi * radius**3
    else:
        joint, area, modulus = bonds.bond, uniform(bonds.area), 1.0  # a joint carries no moment: any modulus will do
        normal = joint.law.stiffness if joint.normal_stiffness is None else joint.normal_stiffness
        stiffness = Stiffness(normal * area, joint.law.stiffness * area, 0.0, 0.0)
    values = {**stiffness._asdict(), "area": area, "modulus": modulus}
    if _law(bonds) is not None:
        values |= {f"p_{n}": v for n, v in _law(bonds).parameters._asdict().items()}
    for name, value in values.items():
        if np.ndim(value) == 1 and len(value) != len(i):
            raise InputError(f"{name.removeprefix('p_')} has {len(value)} values; give one number or one per bond ({len(i)}).")
    return values


# Programs -------------------------------------------------------------------------------------------------------


def step_program(done: Assembly, gravity: tuple[float, float, float], drag: Drag | None) -> Program:
    """Return the program of one time step."""
    particles = done.particles
    particles["gravity"] = gravity
    if drag is None:
        start = Stage("particles", pg.start, (*START, *START_REST), MOVED)
        finish_reads = ((Motion, "v", "w"), "force", "torque", *FINISH_REST)
        finish = Stage("particles", pg.finish, finish_reads, ("force", "torque", "v", "w", "work"), after=True)
    else:
        particles.update(allocate(PARTICLE_FIELDS, {"drag", "drag_torque"}, len(done.order)), coefficient=drag.coefficient)
        reads = (*START, "drag", "drag_torque", "dragged", *START_REST)
        start = Stage("particles", pg.start_dragged, reads, (*MOVED, "dragged"))
        finish_reads = ((Motion, "v", "w"), "force", "torque", "dragged", *FINISH_REST, "coefficient")
        writes = ("force", "torque", "v", "w", "work", "drag", "drag_torque", "dragged")
        finish = Stage("particles", pg.finish_dragged(drag.law), finish_reads, writes, after=True)
    stages = (start, *(bond_stage(done, number) for number in range(len(done.blocks))), Stage("gather"), finish)
    return Program(stages, done.blocks, particles, done.bonds, done.shared)


def bond_stage(done: Assembly, number: int) -> Stage:
    """Return the stage of one bond block."""
    bonds, element = done.model.bonds[number], done.element(number)
    law = _law(bonds)
    reads: tuple[Any, ...] = (POSE_I, POSE_J, reference(bonds), STIFFNESS)
    writes: tuple[str, ...] = ("load",)
    if law is not None:
        memory = tuple(f"m_{n}" for n in law.memory._fields)
        parameters = (type(law.parameters), *(f"p_{n}" for n in law.parameters._fields))
        reads += ((Section, "area", "modulus"), parameters, (law.memory, *memory), "damage", "potential", "lost")
        writes += ("damage", "potential", "lost", *memory)
    if bonds.bond.damping > 0.0:
        reads += VISCOUS
        writes += ("power", "damped")
        body = pg.viscous_body(element) if law is None else pg.damaging_viscous_body(element, law.function)
    else:
        body = pg.elastic_body(element) if law is None else pg.damaging_body(element, law.function)
    return Stage(f"b{number}", body, reads, writes)


def reference(bonds: BondSet) -> tuple[Any, ...]:
    """Return how the reference of a bond is read; a bond has no normal of its own."""
    return (Reference, "r0", "r0" if bonds.normal is None else "normal")


def energy_program(done: Assembly) -> Program:
    """Return the program that evaluates the elastic energy of every bond into shared["energy"]."""
    total = sum(block.count for block in done.blocks)
    shared = done.shared | allocate((ENERGY,), {"energy"}, total)
    bonds = {name: {"damage": 0.0} | arrays for name, arrays in done.bonds.items()}
    stages = tuple(
        Stage(block.name, pg.energy_body(done.element(b)), (POSE_I, POSE_J, reference(bonds_set), STIFFNESS, "damage"), ("energy",))
        for b, (block, bonds_set) in enumerate(zip(done.blocks, done.model.bonds, strict=True))
    )  # fmt: skip
    return Program(stages, done.blocks, done.particles, bonds, shared)


def linear_program(done: Assembly) -> Program:
    """Return the program of the model's own stiffness: displacements v, rotations w -> forces and torques of bonds."""
    names = {"v", "w", "force", "torque"}
    particles = allocate(PARTICLE_FIELDS, names, len(done.order))
    ends = ((Motion, "v.i", "w.i"), (Motion, "v.j", "w.j"))
    stages = tuple(
        Stage(block.name, pg.linear_body(done.element(b)), (*ends, reference(bonds_set), STIFFNESS), ("load",))
        for b, (block, bonds_set) in enumerate(zip(done.blocks, done.model.bonds, strict=True))
    )
    shared = {"load": np.zeros_like(done.shared["load"]), "first": done.shared["first"], "ends": done.shared["ends"]}
    return Program((*stages, Stage("gather")), done.blocks, particles, done.bonds, shared)


