"""The same physics for another target: re-bind a function's own code to that target's words.

No source text is read or written: a bound function shares the code object of the original, and only the global names
and closure cells that it uses are replaced, recursively. Names looked up in a module (`bd.exp`, `math.exp`) are
replaced in a stand-in for that module.
"""

import builtins
from collections.abc import Callable, Mapping
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

Words = Mapping[Any, Any]
Finish = Callable[[FunctionType], Any]
LEFT_ALONE = {"numpy", "numba"}  # modules whose functions the targets know themselves


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the global values that a function uses, those of the functions written inside it included, by name."""
    names = names_of(function.__code__)
    return {n: function.__globals__[n] for n in sorted(names) if n in function.__globals__}


def names_of(code: CodeType) -> set[str]:
    """Return the global and attribute names in a code object and in those inside it."""
    return set(code.co_names).union(*(names_of(c) for c in code.co_consts if isinstance(c, CodeType)))


def parts_of(module: ModuleType, names: set[str]) -> dict[str, Any]:
    """Return what a module has of these names; nothing for the modules that targets know themselves."""
    if module.__name__.split(".")[0] in LEFT_ALONE:
        return {}
    return {n: getattr(module, n) for n in sorted(names) if hasattr(module, n)}


def bind(function: Callable[..., Any], words: Words, finish: Finish, made: dict[Any, Any]) -> Any:
    """Return `function` in another target's words.

    words: replacements for functions of `ops`, of `math` and of Python itself; finish: what makes a target's function
    of a plain one (a compiler, or the identity); made: the functions bound so far, extended here.
    """
    if function in made:
        return made[function]
    used = names_of(function.__code__)

    def translate(value: Any) -> Any:
        if isinstance(value, ModuleType):
            return stand_in(value)
        if not callable(value):
            return value
        if value in words:
            return words[value]
        return bind(value, words, finish, made) if isinstance(value, FunctionType) else value

    def stand_in(module: ModuleType) -> ModuleType:
        parts = parts_of(module, used)
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
