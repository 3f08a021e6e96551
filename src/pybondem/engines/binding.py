"""The same physics for another target: re-bind a function's own code to that target's words.

No source text is read or written: a bound function shares the code object of the original, and only the global names
and closure cells that it uses are replaced, recursively. Names looked up in a module (`bd.exp`, `math.exp`) are
replaced in a stand-in for that module.
"""

import builtins
import dis
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

Words = Mapping[Any, Any]
Finish = Callable[[FunctionType], Any]
GLOBALS = {"LOAD_GLOBAL", "LOAD_NAME"}
LEFT_ALONE = {"numpy", "numba"}  # modules whose functions the targets know themselves, but for those among the words


def codes_of(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and those inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from codes_of(constant)


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the global values that a function uses, those of the functions written inside it included, by name."""
    return {n: function.__globals__[n] for n in sorted(_global_names(function.__code__)) if n in function.__globals__}


@cache
def _global_names(code: CodeType) -> frozenset[str]:
    steps = (step for inner in codes_of(code) for step in dis.get_instructions(inner))
    return frozenset(step.argval for step in steps if step.opname in GLOBALS)


def names_of(code: CodeType) -> set[str]:
    """Return the global and attribute names in a code object and in those inside it."""
    return {name for inner in codes_of(code) for name in inner.co_names}


def parts_of(module: ModuleType, names: set[str], words: Words) -> dict[str, Any]:
    """Return what a module has of these names; of a module that targets know themselves only what is a word."""
    parts = {n: getattr(module, n) for n in sorted(names) if hasattr(module, n)}
    known = module.__name__.split(".")[0] in LEFT_ALONE
    return parts if not known or any(is_word(part, words) for part in parts.values()) else {}


def is_word(value: Any, words: Words) -> bool:
    """Return whether a value is a word with a replacement."""
    return callable(value) and value in words


def frozen(function: Callable[..., Any], words: Words) -> Any:
    """Return a copy of a function that knows all it uses as it is now: later changes of those do not reach it.

    Arrays are copied and locked; `words` stay what they are, so that the copy can be bound.
    """

    def locked(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return value
        copy = value.copy()
        copy.setflags(write=False)
        return copy

    return bind(function, {word: word for word in words}, lambda f: f, {}, locked)


def bind(function: Callable[..., Any], words: Words, finish: Finish, made: dict[Any, Any],
         constant: Callable[[Any], Any] = lambda value: value) -> Any:  # fmt: skip
    """Return `function` in another target's words.

    words: replacements for functions of `ops`, of `math`, of NumPy and of Python itself; finish: what makes a target's
    function of a plain one (a compiler, or the identity); made: the functions bound so far, extended here; constant:
    what to put in the place of a value that is no function.
    """
    if function in made:
        return made[function]
    used = names_of(function.__code__)

    def translate(value: Any) -> Any:
        if isinstance(value, ModuleType):
            return stand_in(value)
        if not callable(value):
            return constant(value)
        if value in words:
            return words[value]
        return bind(value, words, finish, made, constant) if isinstance(value, FunctionType) else value

    def stand_in(module: ModuleType) -> ModuleType:
        parts = parts_of(module, used, words)
        translated = {name: translate(part) for name, part in parts.items()}
        if all(translated[name] is part for name, part in parts.items()):
            return module
        other = ModuleType(module.__name__)
        vars(other).update(translated)
        return other

    names = {n: w for n in used if (w := words.get(getattr(builtins, n, None))) is not None}
    names |= {name: translate(value) for name, value in globals_of(function).items()} | {"__builtins__": __builtins__}
    cells = tuple(CellType(translate(cell.cell_contents)) for cell in function.__closure__ or ())
    plain = FunctionType(function.__code__, names, function.__name__, function.__defaults__, cells)
    plain.__kwdefaults__ = function.__kwdefaults__
    vars(plain).update(vars(function))
    made[function] = finish(plain)
    return made[function]
