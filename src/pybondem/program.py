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

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pybondem.ops import Number

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


@dataclass(frozen=True)
class Block:
    """One contiguous block of bonds under one law: name, position of its first bond, number of bonds."""

    name: str
    first: int
    count: int


class Called(NamedTuple):
    """A law in the program: the function as its author wrote it, as the bodies call it, and types of its arguments."""

    user: Callable[..., Any]
    function: Callable[..., Any]
    types: tuple[Any, ...]


class Program(NamedTuple):
    """Stages and the arrays they work on.

    particles: arrays of particle fields; bonds: for each block its arrays of bond fields; shared: load, the lists of
    each particle's own bonds, boundary groups and schedules. A constant is a number, a tuple of numbers, or an array
    with one value per item, and is read by name like a field. laws: those that the bodies call, to speak of them.
    """

    stages: tuple[Stage, ...]
    blocks: tuple[Block, ...]
    particles: dict[str, Any]
    bonds: Mapping[str, dict[str, Any]]
    shared: dict[str, Any]
    laws: tuple[Called, ...] = ()

    def block(self, name: str) -> Block:
        """Return the block of that name."""
        return next(block for block in self.blocks if block.name == name)
