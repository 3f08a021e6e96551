"""Reading a law: what its function names, whether it runs, what it returns; the same function with all arguments."""

import dis
import inspect
import linecache
import traceback
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from pybondem.check import nearest
from pybondem.engines.binding import frozen, globals_of
from pybondem.engines.reference import WORDS, on_arrays
from pybondem.errors import LawError
from pybondem.laws.parameters import Parameter
from pybondem.physics.types import (
    ComponentRates,
    Components,
    Damage,
    Deformation,
    LawFunction,
    Loads,
    PotentialFunction,
    Rate,
    Stiffness,
)

Function = Callable[..., Any]
NAMES = {"damage": ("d", "m", "p", "rate", "dt"), "bond": ("d", "k", "m", "p", "rate", "dt")}
ALL = NAMES["bond"]
FLOWS = {"rate", "dt"}  # what a law must ask for: it costs the velocities of both ends
EFFECTS = {"STORE_SUBSCR", "STORE_SLICE", "STORE_ATTR", "STORE_GLOBAL", "DELETE_SUBSCR", "DELETE_ATTR", "DELETE_GLOBAL"}
JUMPS = {*dis.hasjrel, *dis.hasjabs}
ENDS = {"RETURN_VALUE", "RETURN_CONST", "RAISE_VARARGS", "RERAISE", "JUMP_FORWARD", "JUMP_BACKWARD",
        "JUMP_BACKWARD_NO_INTERRUPT"}  # fmt: skip

# Without one of the arguments (d, k, m, p, rate, dt); compilers need the places as constants.
DROP: dict[str, Callable[[Function], Function]] = {
    "k": lambda f: lambda *a: f(*a[:1], *a[2:]),
    "m": lambda f: lambda *a: f(*a[:2], *a[3:]),
    "p": lambda f: lambda *a: f(*a[:3], *a[4:]),
    "rate": lambda f: lambda *a: f(*a[:4], *a[5:]),
    "dt": lambda f: lambda *a: f(*a[:5]),
}

# A bond of a few millimetres, hardly deformed: something to call a law with.
SAMPLES: dict[str, dict[str, Any]] = {
    "damage": {
        "d": Deformation(1e-6, 1e-6, 1e-3, 1e-3, 1e-3, 1e-6, 1e6, 1e6, 1e6, 1e6, 1e12, 1e12),
        "rate": Rate(1e-3, 1e-3, 1.0, 1.0),
    },
    "bond": {
        "d": Components(1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1e-3, 1e-3, 1e-6),
        "rate": ComponentRates(1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0),
    },
}


class Reading(NamedTuple):
    """What was found: the law with all arguments, modes of its damage (1 or 4), whether it asks for rates or time,
    whether it branches with `if`, and its potential with all arguments."""

    function: LawFunction
    modes: int
    flows: bool
    branches: bool
    potential: PotentialFunction | None


def sample(parameter: Parameter) -> float:
    """Return a value that a parameter may have."""
    for value in (parameter.typical, parameter.default, 1.0, parameter.most, parameter.least, parameter.above + 1.0):
        if value is not None and np.isfinite(value) and parameter.allows(value):
            return float(value)
    return 0.5 * (max(parameter.above, parameter.least) + parameter.most)


def read_function(name: str, user: Function, kind: str, values: Any, words: Any, potential: Function | None) -> Reading:
    """Return what a law's function is; values: sample parameters, words: the type of its memory.

    Raises LawError with the user's own line where it is not a law.
    """
    named = _arguments(name, user, NAMES[kind], kind)
    _refuse_effects(name, user)
    _refuse_missing_values(name, user)
    own = _frozen(name, user)
    nothing = words(*(0.0 for _ in words._fields))
    given = {**SAMPLES[kind], "k": Stiffness(1e6, 1e6, 1.0, 1.0), "m": nothing, "p": values, "dt": 1e-6}
    _check_names(name, user, named, given)
    modes = _returned(name, user, kind, words, _called(name, own, named, given))
    function = _with_all(_split(own, bool(words._fields)), named)
    energy = None
    if potential is not None:
        of = f"the potential of {name}"
        arguments = _arguments(of, potential, ("d", "k", "m", "p"), kind)
        held = _frozen(of, potential)
        _called(of, held, arguments, given)
        energy = _with_all(held, (*arguments, "rate", "dt"))
    branches = _branches(own, named, given)
    function.__name__ = name
    vars(function).update(branches=branches, words=len(words._fields))  # the reference engine asks
    return Reading(function, modes, bool(FLOWS & set(named)), branches, energy)


def _split(user: Function, remembers: bool) -> Function:
    """Return the law with its answer and its memory apart."""

    def forgetful(*a: Any) -> Any:
        return user(*a), ()

    def remembering(*a: Any) -> Any:
        returned = user(*a)
        return returned[0], returned[1:]

    return remembering if remembers else forgetful


def _with_all(function: Function, named: tuple[str, ...]) -> Function:
    """Return the function called with all arguments, of which it is handed those it names."""
    for name in ALL[1:]:
        if name not in named:
            function = DROP[name](function)
    return function


def _arguments(name: str, user: Function, allowed: tuple[str, ...], kind: str) -> tuple[str, ...]:
    """Return the names of a function's arguments. Raises LawError unless a law may read them, in their order."""
    if not inspect.isfunction(user):
        raise LawError(f"a {kind} law is made of a function, def law({', '.join(allowed[:3])}): ...; got {user!r}.")
    arguments = inspect.signature(user).parameters
    found = tuple(arguments)
    plain = all(p.kind is p.POSITIONAL_OR_KEYWORD and p.default is p.empty for p in arguments.values())
    expected = tuple(a for a in allowed if a in found)
    if not plain or found != expected or found[:1] != ("d",):
        raise LawError(
            f"{name} ({_where(user)}) takes ({', '.join(map(str, arguments.values()))}); a {kind} law takes d and what "
            f"it needs of {', '.join(allowed[1:])}, by these names and in this order."
        )
    return found


def _frozen(name: str, user: Function) -> Function:
    """Return a copy of a law that later changes of what it uses do not reach, so that all engines run the same."""
    try:
        copy: Function = frozen(user, WORDS)
    except ValueError as error:  # an empty cell
        raise LawError(
            f"{name} ({_where(user)}) uses a name from outside that has no value yet; define it first."
        ) from error
    except RecursionError as error:
        raise LawError(f"{name} ({_where(user)}) calls itself, or a function that does; a law cannot.") from error
    return copy


def _check_names(name: str, user: Function, named: tuple[str, ...], given: dict[str, Any]) -> None:
    """Raise LawError for a name that d, m, p ... do not have, in any branch of a law."""
    before = ""
    for step in dis.get_instructions(user):
        if step.opname == "LOAD_ATTR" and before in named and isinstance(given[before], tuple):
            there = given[before]._fields
            if step.argval not in there:
                line = step.positions.lineno if step.positions else None
                raise LawError(
                    f"{name} reads {before}.{step.argval} ({_at(user, line)}); there is no such name"
                    f"{nearest(step.argval, there)}: {before} has {', '.join(there) or 'nothing declared'}."
                )
        loaded = step.argval[-1] if isinstance(step.argval, tuple) else step.argval
        before = loaded if step.opname.startswith("LOAD_FAST") else ""


def _refuse_effects(name: str, user: Function, seen: tuple[Function, ...] = ()) -> None:
    """Raise LawError where a law, or a function that it calls, changes something, or uses what others may change."""
    cells = inspect.getclosurevars(user).nonlocals
    for value in (*globals_of(user).values(), *cells.values()):
        mine = inspect.isfunction(value) and not (value.__module__ or "").startswith("pybondem.")
        if mine and value not in (user, *seen):
            _refuse_effects(f"{name}, which calls {value.__name__},", value, (*seen, user))
    for step in dis.get_instructions(user):
        if step.opname in EFFECTS:
            line = step.positions.lineno if step.positions else None
            raise LawError(
                f"{name} ({_at(user, line)}) writes into something; a law makes new numbers and changes nothing, so "
                "that it can run on any engine and for all bonds at once."
            )
    for word, value in {**globals_of(user), **cells}.items():
        if isinstance(value, list | dict | set):
            raise LawError(
                f"{name} ({_where(user)}) uses {word}, a {type(value).__name__} from outside, which may change; give "
                "it numbers as parameters, or a tuple."
            )


def _refuse_missing_values(name: str, user: Function) -> None:
    """Raise LawError where a law uses a name of its own that has a value in some branches only.

    Python says so when such a branch is taken, compiled code takes what happens to be in memory.
    """
    steps = list(dis.get_instructions(user))
    at = {step.offset: k for k, step in enumerate(steps)}
    code = user.__code__
    arguments = frozenset(code.co_varnames[: code.co_argcount])
    known: dict[int, frozenset[str]] = {}
    waiting = [(0, arguments)]
    while waiting:
        k, has = waiting.pop()
        if k in known and known[k] <= has:
            continue
        has = known[k] = known.get(k, has) & has
        step = steps[k]
        names = step.argval if isinstance(step.argval, tuple) else (step.argval,)
        if step.opname.startswith("STORE_FAST"):
            has |= {n for n in names if isinstance(n, str)}
        if step.opcode in JUMPS and step.argval in at:
            waiting.append((at[step.argval], has))
        if step.opname not in ENDS and k + 1 < len(steps):
            waiting.append((k + 1, has))
    for k, has in known.items():
        step = steps[k]
        if step.opname.startswith("LOAD_FAST") and "AND_CLEAR" not in step.opname:
            names = step.argval if isinstance(step.argval, tuple) else (step.argval,)
            missing = [n for n in names if n not in has]
            if missing:
                line = step.positions.lineno if step.positions else None
                raise LawError(
                    f"{name} ({_at(user, line)}) uses {missing[0]}, which has a value in some branches only."
                )


def _called(name: str, user: Function, named: tuple[str, ...], given: dict[str, Any]) -> Any:
    """Return what a function answers to a sample of numbers. Raises LawError with the line where it fails."""
    try:
        with np.errstate(all="ignore"):
            numbers = [_as(np.float64, given[argument]) for argument in named]
            return on_arrays(user)(*numbers)
    except Exception as error:
        raise LawError(f"{name} fails {_line(user, error)}: {type(error).__name__}: {error}.") from error


def _as(kind: Callable[[Any], Any], value: Any) -> Any:
    """Return a number, or a named tuple of numbers, of another kind."""
    return type(value)(*map(kind, value)) if isinstance(value, tuple) else kind(value)


def _returned(name: str, user: Function, kind: str, words: Any, found: Any) -> int:
    """Return the number of modes of a law's damage. Raises LawError unless it returned its answer and its memory."""
    wanted = ["damage" if kind == "damage" else "its Loads", *words._fields]
    remembers = bool(words._fields)
    split = isinstance(found, tuple) and not isinstance(found, Damage | Loads)
    values = list(found) if split else [found]
    said = f"{name} ({_where(user)}) must return {', '.join(wanted)}"
    if split != remembers or len(values) != len(wanted):
        got = f"{len(values)} values" if split else "a list" if isinstance(found, list) else f"{_plain(found)} alone"
        raise LawError(f"{said}: {len(wanted)} value{'s' * remembers}; it returns {got}.")
    answer, memory = values[0], values[1:]
    if kind == "bond" and not isinstance(answer, Loads):
        raise LawError(f"{said}, as Loads(n, s, t, twist, bend_s, bend_t); it returns {_plain(answer)}.")
    numbers = [*answer] if isinstance(answer, Damage | Loads) else [answer]
    for value in (*numbers, *memory):
        if np.ndim(value) or np.asarray(value).dtype.kind not in "fiu":
            raise LawError(f"{said}, each a number; it returns {_plain(value)}.")
    return 4 if isinstance(answer, Damage) else 1


def _plain(value: Any) -> str:
    """Return a value as its author thinks of it: without NumPy's name around a number."""
    return repr(value.item() if isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0 else value)


def _branches(user: Function, named: tuple[str, ...], given: dict[str, Any]) -> bool:
    """Return whether a law cannot take arrays, as one that says `if` cannot."""
    try:
        with np.errstate(all="ignore"):
            two = [_as(lambda v: np.full(2, v), given[argument]) for argument in named]
            on_arrays(user)(*two)
    except Exception:  # it has been called with numbers before: it is arrays that it cannot take
        return True
    return False


def _where(user: Function) -> str:
    return f"{_short(user.__code__.co_filename)}, line {user.__code__.co_firstlineno}"


def _at(user: Function, number: int | None) -> str:
    """Return file, line and text of a line of a function."""
    if number is None:
        return _where(user)
    text = linecache.getline(user.__code__.co_filename, number).strip()
    return f"{_short(user.__code__.co_filename)}, line {number}{': ' + text if text else ''}"


def _line(user: Function, error: Exception) -> str:
    """Return where in a user's function an error arose, with the line itself."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == user.__code__.co_filename]
    return f"({_at(user, frames[-1].lineno if frames else None)})"


def _short(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1]
