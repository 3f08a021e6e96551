"""A model at frozen damage: its linear response, and what its damage laws make of it.

With damage kept, damage laws scale stiffnesses, so that the model is linear in small displacements: one solve gives the
response to a unit displacement of the end, and every load is a multiple of it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, cg

from pybondem.assembly import Assembly, assemble, linear_program
from pybondem.bond_answers import ROUND_OFF, energies_open_to_damage, felt, handed_over, kept
from pybondem.check import choice
from pybondem.engines.choose import make_engine
from pybondem.engines.reference import on_arrays
from pybondem.errors import InputError, LawError
from pybondem.model import Model, Selection
from pybondem.physics.frame import linear_stretch
from pybondem.physics.types import Damage, Motion, Rate, Reference, Section, Stiffness, Stretch
from pybondem.simulation import session
from pybondem.stability import Stiffness as Operator
from pybondem.state import Fields
from pybondem.statics import check_supported

Floats = NDArray[np.float64]
STILL = Rate(0.0, 0.0, 0.0, 0.0)


class Committed(NamedTuple):
    """What a bond set has come to: its stretch then (8, bonds), damage of its modes (modes, bonds), memory."""

    stretch: Floats
    damage: Floats
    memory: tuple[Any, ...]


class Softening:
    """A bond set under a damage law, in memory order: stiffness at frozen damage, and what its law answers.

    A stretch stands as eight rows: opening, slip (3), twist, bending (3).
    """

    def __init__(self, done: Assembly, number: int) -> None:
        self.bonds = done.model.bonds[number]
        self.arrays = Fields(done.bonds[done.blocks[number].name])
        self._count, self._order = done.blocks[number].count, done.bond_order(number)
        law = self.bonds.bond.law
        assert law is not None  # `Secant` takes damage laws only
        self.law, self._function = law, on_arrays(law.function)
        chord = tuple(done.chord(self.arrays))
        self._ref = Reference(chord, tuple(self.arrays["normal"]) if "normal" in self.arrays else chord)
        self._along = on_arrays(done.element(number).reference_direction)(self._ref)
        self._whole = Stiffness(*(self._each(self.arrays[name]) for name in Stiffness._fields))
        self._section = Section(self.arrays["area"], self.arrays["modulus"])
        self._parameters = type(law.parameters)(*(self.arrays[f"p_{n}"] for n in law.parameters._fields))
        self._left = on_arrays(handed_over if self.bonds.bond.hand_over else kept)
        self.arrays.update({name: value.copy() for name, value in self._whole._asdict().items()})
        memory = tuple(np.zeros(self._count) for _ in law.memory._fields)
        self.now = Committed(np.zeros((8, self._count)), np.zeros((law.modes, self._count)), memory)

    def _each(self, value: Any) -> Floats:
        return np.broadcast_to(np.asarray(value, np.float64), (self._count,))

    def soften(self, damage: Floats, stretch: Floats) -> None:
        """Put what damage (modes, bonds) leaves into the arrays of the program; the stretch tells who is closed."""
        left = self._left(self._whole, modes(damage), stretch[0])
        for name, value in left._asdict().items():
            self.arrays[name][:] = value
            self.arrays.changed(name)

    def stretch(self, u: Floats) -> Floats:
        """Return the stretch (8, bonds) for displacements and rotations u (6, n)."""
        i, j = (Motion(tuple(u[:3, self.arrays[end]]), tuple(u[3:, self.arrays[end]])) for end in "ij")
        found = on_arrays(linear_stretch)(i, j, self._along, self._ref)
        return np.array([found.opening, *found.slip, found.twist, *found.bending])

    def advanced(self, state: Committed, stretch: Floats) -> tuple[Committed, float]:
        """Return what the bonds come to from a state at a stretch near by, and the energy lost on the way [J].

        A growth dD loses dD sqrt(U_before U_now), with U_before where damage begins to grow: not before the stretch
        that was committed, which a bond that softens must reach again.
        """
        damage, memory = self._answer(stretch, state.memory)
        now = self._energies(stretch)
        before = np.maximum(self._energies(state.stretch), np.minimum(self._energies(self.now.stretch), now))
        lost = (damage - state.damage) * np.sqrt(before * now)
        return Committed(stretch, damage, memory), float(lost.sum())

    def _answer(self, stretch: Floats, memory: tuple[Any, ...]) -> tuple[Floats, tuple[Any, ...]]:
        """Return damage (modes, bonds) and memory at a stretch."""
        seen = on_arrays(felt)(as_stretch(stretch), self._whole, self._section, self._ref)
        given = self.law.memory(*memory)
        damage, memory = self._function(seen, self._whole, given, self._parameters, STILL, 0.0)
        rows = np.array([self._each(row) for row in (damage if self.law.modes > 1 else (damage,))])
        if not np.all(np.abs(rows - 0.5) <= 0.5 + ROUND_OFF):
            raise LawError(f"{self.law.name} gave a damage outside 0 to 1, or a value that is not finite.")
        return rows, tuple(self._each(word) for word in memory)

    def _energies(self, stretch: Floats) -> Floats:
        """Return the energy open to damage of each mode (modes, bonds) [J]."""
        rows = np.array(on_arrays(energies_open_to_damage)(as_stretch(stretch), self._whole))
        return rows if self.law.modes > 1 else rows.sum(axis=0, keepdims=True)

    def interface(self) -> tuple[Floats, Floats]:
        """Return slip [m] and shear stress [Pa] (bonds,) as committed, in the order of the set's pairs."""
        seen = on_arrays(felt)(as_stretch(self.now.stretch), self._whole, self._section, self._ref)
        slip, shear = np.empty(self._count), np.empty(self._count)
        slip[self._order] = seen.slip
        shear[self._order] = (1.0 - modes(self.now.damage).shear) * seen.shear_stress
        return slip, shear


class Secant:
    """A model held and pulled at an end, linear at frozen damage.

    end, axis: particles that are displaced along x, y or z; what else is fixed or driven is held. Raises InputError for
    models that cannot be treated so: bond laws, laws that read rates, pushes, pieces with nothing held.
    """

    def __init__(self, model: Model, end: Selection, axis: str, engine: str | None, threads: int | None) -> None:
        refuse(model, end)
        self.model, self.axis = model, axis
        done = assemble(model)
        self._c, self._end = "xyz".index(choice("axis", axis, "xyz")), done.position[model.own(end)]
        soft = {block.name: Softening(done, k) for k, block in enumerate(done.blocks) if model.bonds[k].bond.law}
        self.soft = tuple(soft.values())
        program = linear_program(done)
        arrays = dict(program.bonds) | {name: own.arrays for name, own in soft.items()}
        self._operator = Operator(done, make_engine(*told(engine, threads)), program._replace(bonds=arrays))
        check_supported(done, self._operator)
        if np.any(self._operator.free[self._c, self._end] > 0.0):
            raise InputError(f"the end is free along {axis}; drive or fix it along {axis}: it is what is displaced.")
        self._known = np.zeros((6, len(model)))
        self._known[self._c, self._end] = 1.0
        self._guess = np.zeros(6 * len(model))

    def respond(self, tolerance: float) -> tuple[Floats, float]:
        """Return displacements (6, n) for a unit displacement of the end [m/m], and the load on the end [N/m]."""
        operator, scale = self._operator, self._operator.scale * self._operator.free

        def scaled(flat: Floats) -> Floats:
            return (scale * operator.all_forces(scale * flat.reshape(scale.shape))).ravel()

        load = -(scale * operator.all_forces(self._known)).ravel()
        shape = LinearOperator((load.size, load.size), matvec=scaled, dtype=np.float64)
        self._guess, info = cg(shape, load, x0=self._guess, rtol=tolerance, maxiter=20 * scale.shape[1] + 1000)
        if info != 0:
            raise InputError(f"the static solve did not converge in {info} iterations; is the model held well enough?")
        u = self._known + scale * self._guess.reshape(scale.shape)
        return u, float(operator.all_forces(u)[self._c, self._end].sum())


def told(engine: str | None, threads: int | None) -> tuple[str, int | None]:
    """Return the engine and its threads: those asked for, else those of the session."""
    return session.engine if engine is None else engine, session.threads if threads is None else threads


def refuse(model: Model, end: Selection) -> None:
    """Raise InputError for a model that is not linear at frozen damage, or not loaded by its end alone."""
    if not isinstance(model, Model) or not isinstance(end, Selection):
        given = f"{type(model).__name__} and {type(end).__name__}"
        raise InputError(f"a driver needs a Model and a Selection of it, got {given}.")
    for law in (bonds.bond.law for bonds in model.bonds):
        if law is not None and (law.kind == "bond" or law.flows):
            why = "a bond law" if law.kind == "bond" else "a law that reads rates or the time step"
            raise InputError(f"{law.name} is {why}; dissipation control needs damage laws of the deformation alone.")
    if not any(bonds.bond.law is not None for bonds in model.bonds):
        raise InputError("no bond of the model has a damage law; there is nothing to dissipate energy.")
    if any(condition.kind == "push" for condition in model.boundaries.conditions):
        raise InputError("the model has pushes; dissipation control loads by the displaced end alone.")


def modes(damage: Floats) -> Damage:
    """Return the damage (1 or 4, bonds) of each mode."""
    return Damage(*damage) if len(damage) > 1 else Damage(*4 * (damage[0],))


def as_stretch(rows: Floats) -> Stretch:
    """Return the stretch that eight rows (8, bonds) stand for."""
    return Stretch(rows[0], tuple(rows[1:4]), rows[4], tuple(rows[5:]))
