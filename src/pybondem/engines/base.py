"""What an engine is: something that makes a runner of a step program."""

from typing import Protocol

from pybondem.program import Program
from pybondem.state import Arrays


class Runner(Protocol):
    """A program made ready on one engine. It owns the program's arrays while it runs."""

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the program's stages `steps` times, dt [s] apart; schedule: the scheduled fields, a row for each step."""


class Engine(Protocol):
    """Runs step programs."""

    name: str

    def prepare(self, program: Program) -> Runner:
        """Return a runner for the program, compiled where the engine compiles."""
