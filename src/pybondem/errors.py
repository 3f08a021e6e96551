"""What the package raises: one base class, one class per kind of trouble."""


class BondemError(Exception):
    """Base of every error that pybondem raises on purpose."""


class InputError(BondemError, ValueError):
    """A value given by the user cannot be used: names the object, index, value, allowed range and a hint."""


class SelectionError(InputError):
    """A selection, part or name is empty, misspelt or contradictory."""


class EngineError(BondemError, RuntimeError):
    """An engine cannot run as asked on this machine."""


class UnstableError(BondemError, ArithmeticError):
    """The time step is above the critical one, or a run has blown up."""


class LawError(BondemError):
    """A law is not one: wrong arguments or results, a name it does not have, values that are not finite."""
