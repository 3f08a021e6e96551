"""The interpreted way: the same bodies in plain Python, one particle and one bond at a time.

The baseline that the PyBONDEM-GPU paper calls NumPy, and a place to set a breakpoint.
"""

import traceback
from typing import Any

from pybondem.engines.lookups import INDEX_WORDS
from pybondem.engines.loops import Loops
from pybondem.errors import LawError
from pybondem.program import Program
from pybondem.state import Arrays


class InterpretedRunner:
    """A program as a plain Python function."""

    def __init__(self, program: Program) -> None:
        self._loops = Loops(program)
        names: dict[str, Any] = {**INDEX_WORDS, **self._loops.bodies, **self._loops.types, "prange": range}
        exec(compile(self._loops.source, "<step program>", "exec"), names)
        self._advance = names["advance"]

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the program's stages `steps` times, dt [s] apart."""
        try:
            self._advance(steps, *self._loops.values(dt, schedule))
        except (ArithmeticError, ValueError) as error:
            raise self._refused(error) from error

    def _refused(self, error: Exception) -> Exception:
        """Return what to raise for what numbers of plain Python refuse, and other engines take for nan or inf."""
        frames = traceback.extract_tb(error.__traceback__)
        for law in self._loops.program.laws:
            lines = [f for f in frames if f.filename == law.user.__code__.co_filename and f.name == law.user.__name__]
            if lines:
                where = f"line {lines[-1].lineno}: {lines[-1].line}"
                return LawError(f"the law {law.user.__name__} fails ({where}): {type(error).__name__}: {error}.")
        return error


class Interpreted:
    """Engine "interpreted"."""

    name = "interpreted"

    def prepare(self, program: Program) -> InterpretedRunner:
        """Return a runner for the program."""
        return InterpretedRunner(program)
