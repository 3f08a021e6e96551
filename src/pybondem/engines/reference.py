"""The reference engine: the same bodies on whole NumPy arrays. Readable, and the oracle for the others."""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np

from pybondem import ops
from pybondem.engines.binding import bind
from pybondem.engines.compile_errors import stopped
from pybondem.engines.lookups import GROUP, SCHEDULED
from pybondem.errors import LawError
from pybondem.program import Program, Stage
from pybondem.state import CHORD, GROWING, Arrays


def largest(*values: Any) -> Any:
    """Return the largest of several numbers, item by item."""
    return reduce(np.maximum, values)


def smallest(*values: Any) -> Any:
    """Return the smallest of several numbers, item by item."""
    return reduce(np.minimum, values)


# Functions of `math` that NumPy has under another name.
OTHER_NAMES = {"acos": "arccos", "asin": "arcsin", "atan": "arctan", "atan2": "arctan2", "pow": "power"}
MATH = {
    getattr(math, name): getattr(np, OTHER_NAMES.get(name, name))
    for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log10", "log1p", "log2", "expm1", "hypot", "floor")
}
MATH |= {getattr(math, name): getattr(np, other) for name, other in OTHER_NAMES.items()}
WORDS = MATH | {
    ops.sqrt: np.sqrt,
    ops.exp: np.exp,
    ops.log: np.log,
    ops.power: np.power,
    ops.where: np.where,
    ops.minimum: np.minimum,
    ops.maximum: np.maximum,
    ops.absolute: np.abs,
    abs: np.abs,
    max: largest,
    min: smallest,
}

_ON_ARRAYS: dict[Any, Any] = {}


def on_arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a physics function that takes NumPy arrays for numbers; one marked `branches` goes bond by bond."""
    return bind(function, WORDS, lambda f: one_by_one(f) if vars(f).get("branches") else f, _ON_ARRAYS)


def one_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a law that takes NumPy arrays but is called for one bond after another, as one that says `if` must be.

    What it takes: numbers, arrays (m,), and named tuples of them; what it returns: (answer, memory), see `LawFunction`.
    """

    def looped(*given: Any) -> Any:
        items = [part for group in given for part in (group if isinstance(group, tuple) else (group,))]
        columns = [np.atleast_1d(column) for column in np.broadcast_arrays(*items)]
        rows: list[Any] = list(zip(*columns, strict=True))
        found = [function(*_grouped(given, row)) for row in rows or [np.ones(len(columns))]]
        answers, memories = zip(*found, strict=True)
        if any(len(memory) != vars(function)["words"] for memory in memories):
            raise ValueError("a surplus of values")
        kind, many = type(answers[0]), slice(len(rows))
        alone = not issubclass(kind, tuple)
        answer = np.array(answers)[many] if alone else kind(*(np.array(c)[many] for c in zip(*answers, strict=True)))
        return answer, tuple(np.array(word)[many] for word in zip(*memories, strict=True))

    return looped


def _grouped(groups: tuple[Any, ...], numbers: Any) -> list[Any]:
    """Return numbers in the place of the arrays of `groups`."""
    rest = iter(numbers)
    return [type(g)(*(next(rest) for _ in g)) if isinstance(g, tuple) else next(rest) for g in groups]


class ReferenceRunner:
    """A program interpreted stage by stage, every stage on all its items at once."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._bodies = [on_arrays(s.body) if s.body else None for s in program.stages]

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the program's stages `steps` times, dt [s] apart."""
        with np.errstate(invalid="ignore", divide="ignore"):
            for step in range(steps):
                for stage, body in zip(self._program.stages, self._bodies, strict=True):
                    rows: dict[str, Any] = {name: a[step + 1 if stage.after else step] for name, a in schedule.items()}
                    rows["dt"] = dt
                    if body is None:
                        self._gather()
                    else:
                        self._run(stage, body, rows)

    def _run(self, stage: Stage, body: Callable[..., Any], rows: dict[str, Any]) -> None:
        """Evaluate one stage on all its items; raises LawError where a law stops."""
        try:
            self._write(stage, body(*(self._read(stage, name, rows) for name in stage.reads)))
        except Exception as error:
            said = stopped(error, [law.user for law in self._program.laws])
            if said is None:
                raise
            raise LawError(said) from error

    def _read(self, stage: Stage, name: Any, rows: dict[str, Any]) -> Any:
        """Return one argument of a body: a number, an array, a tuple of arrays, or a named tuple of these."""
        if isinstance(name, tuple):
            kind, *fields = name
            return kind(*(self._read(stage, f, rows) for f in fields))
        field, _, end = name.partition(".")
        if field in ("dt", GROWING.name):
            return rows[field]
        if field in SCHEDULED or field in GROUP:
            table = rows[field] if field in SCHEDULED else self._program.shared[field]
            return tuple(table[:, self._program.particles["group"]])
        if field == CHORD:
            start, bonds = self._program.particles["start"], self._program.bonds[stage.over]
            return tuple(start[:, bonds["j"]] - start[:, bonds["i"]])
        if end:
            return tuple(self._program.particles[field][:, self._program.bonds[stage.over][end]])
        value = self._home(stage)[field]
        return tuple(value) if isinstance(value, np.ndarray) and value.ndim == 2 else value

    def _write(self, stage: Stage, values: Any) -> None:
        """Store what a body returned, in the order of the stage's writes."""
        rest = list(values) if isinstance(values, tuple) else [values]
        for name in stage.writes:
            target = self._home(stage).get(name)
            if target is None:  # load and energy stand in one array for all blocks
                block = self._program.block(stage.over)
                target = self._program.shared[name][..., block.first : block.first + block.count]
            for row in target if target.ndim == 2 else [target]:
                row[...] = rest.pop(0)

    def _home(self, stage: Stage) -> dict[str, Any]:
        return self._program.particles if stage.over == "particles" else self._program.bonds[stage.over]

    def _gather(self) -> None:
        """Sum the loads of each particle's own bonds in the fixed order of its list."""
        shared, particles = self._program.shared, self._program.particles
        bond, side = shared["ends"] >> 1, (shared["ends"] & 1).astype(bool)
        owner = np.repeat(np.arange(len(shared["first"]) - 1), np.diff(shared["first"].astype(np.int64)))
        for c in range(3):
            force = np.where(side, -1.0, 1.0) * shared["load"][c, bond]
            torque = np.where(side, shared["load"][6 + c, bond], shared["load"][3 + c, bond])
            for name, part in (("force", force), ("torque", torque)):
                particles[name][c] = np.bincount(owner, part, minlength=particles[name].shape[1])


class Reference:
    """Engine "reference"."""

    name = "reference"

    def prepare(self, program: Program) -> ReferenceRunner:
        """Return a runner for the program."""
        return ReferenceRunner(program)
