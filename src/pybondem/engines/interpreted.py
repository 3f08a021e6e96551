"""The interpreted way: the same bodies in plain Python, one particle and one bond at a time.

The baseline that the PyBONDEM-GPU paper calls NumPy, and a place to set a breakpoint.
"""

from typing import Any

from pybondem.engines.compile_errors import stopped
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
        except Exception as error:  # a law is a user's function, and numbers of plain Python refuse what others take
            said = stopped(error, [law.user for law in self._loops.program.laws])
            if said is None:
                raise
            raise LawError(said) from error


class Interpreted:
    """Engine "interpreted"."""

    name = "interpreted"

    def prepare(self, program: Program) -> InterpretedRunner:
        """Return a runner for the program."""
        return InterpretedRunner(program)
