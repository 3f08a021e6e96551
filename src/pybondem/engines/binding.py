"""The same physics for another target: re-bind a function's own code to that target's words.

No source text is read or written: a bound function shares the code object of the original, and only the global names
and closure cells that it uses are replaced, recursively.
"""

from collections.abc import Callable, Mapping
from types import CellType, CodeType, FunctionType
from typing import Any

Words = Mapping[Any, Any]
Finish = Callable[[FunctionType], Any]


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the global values that a function uses, those of the functions written inside it included, by name."""
    return {n: function.__globals__[n] for n in sorted(_names(function.__code__)) if n in function.__globals__}


def _names(code: CodeType) -> set[str]:
    return set(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


def bind(function: Callable[..., Any], words: Words, finish: Finish, made: dict[Any, Any]) -> Any:
    """Return `function` in another target's words.

    words: replacements for functions of `ops`; finish: what makes a target's function of a plain one (a compiler, or
    the identity); made: the functions bound so far, extended here.
    """

    def translate(value: Any) -> Any:
        if not callable(value):
            return value
        if value in words:
            return words[value]
        return bind(value, words, finish, made) if isinstance(value, FunctionType) else value

    if function in made:
        return made[function]
    names = {name: translate(value) for name, value in globals_of(function).items()} | {"__builtins__": __builtins__}
    cells = tuple(CellType(translate(cell.cell_contents)) for cell in function.__closure__ or ())
    plain = FunctionType(function.__code__, names, function.__name__, function.__defaults__, cells)
    plain.__kwdefaults__ = function.__kwdefaults__
    made[function] = finish(plain)
    return made[function]
