"""What a compiler could not do with a user's function, in one sentence and with the user's own line.

Works on the exception alone: Numba's messages, its types and its traceback, on the CPU and for CUDA.
"""

import dis
import linecache
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from traceback import walk_tb
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

from pybondem.engines.binding import codes_of, globals_of, names_of, parts_of
from pybondem.errors import EngineError, LawError
from pybondem.program import Called, Program

PACKAGE = Path(__file__).parents[1]
PLACES = re.compile(
    r'^\s*File "(?P<shown>[^"]+)", line (?P<number>\d+)'  # above an excerpt of the source
    r"|(?:\bat|[Rr]aised from) (?P<path>\S.*?) \((?P<row>\d+)\)",
    re.MULTILINE,
)
# The user's source in a message must not speak for Numba, nor must its reasons why each of many candidates fails.
EXCERPT = re.compile(r'^\s*File "[^"]+", line \d+:\n(?:.+\n)*', re.MULTILINE)
CANDIDATES = re.compile(r"^\s*There (?:is|are) \d+ candidate implementation.*", re.MULTILINE | re.DOTALL)
COLOUR = re.compile(r"\x1b\[[\d;]*m")
FRAME = re.compile(r"\s*(Failed in|During:|$)")
TYPES = (  # Numba's notation -> what the user wrote
    (re.compile(r"Function\(<(?:built-in function|ufunc|intrinsic|class|function) '?([\w.]+)'?.*?>\)"), r"\1"),
    (re.compile(r"Literal\[(\w+)\]\([^()]*\)"), r"\1"),
    (re.compile(r"\bDictType\[[^]]*\](?:<iv=[^>]*>)?"), "dict"),
    (re.compile(r"\bUniTuple\([^()]*\)"), "tuple"),
    (re.compile(r"\bTuple\("), "tuple("),
    (re.compile(r"\b(?:reflected )?(list|set)\([^()]*\)(?:<iv=[^>]*>)?"), r"\1"),
    (re.compile(r"\b(\w+)\(\w+ x \d+\)"), r"\1"),  # a named tuple
    (re.compile(r"\b(?:readonly )?array\([^()]*\)"), "array"),
    (re.compile(r"\b(?:unicode_type|str)\b"), "text"),
    (re.compile(r"\b(?:float64|u?int64|int)\b"), "number"),
)
OPERATORS = {
    "add": "+", "iadd": "+", "sub": "-", "isub": "-", "mul": "*", "imul": "*", "truediv": "/", "itruediv": "/",
    "mod": "%", "imod": "%", "pow": "**", "floordiv": "//", "matmul": "@",
    "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!=", "and_": "&", "or_": "|", "contains": "in",
}  # fmt: skip
CONSTRUCTS = {
    "IMPORT_NAME": "an import inside a function",
    "LOAD_BUILD_CLASS": "a class inside a function",
    "STORE_GLOBAL": "an assignment to a name from outside",
    "MATCH_CLASS": "a match statement",
}
UNDEFINED = re.compile(r"NameError: (?:global )?name '(\w+)' is not defined")
FROM_OUTSIDE = r"\1 is a \2 from outside; only numbers, tuples and functions can be used from there"
REASONS: tuple[tuple[re.Pattern[str], str], ...] = (  # the first that is found in a message speaks for it
    (re.compile(r"exception_match|set_try_status"), "it cannot hold try and except"),
    (re.compile(r"Can't unify return type"), "its branches return different things"),
    (re.compile(r"'NoneType' object has no attribute 'args'"), "one of its branches returns nothing"),
    (re.compile(r"has no attribute 'build_map'"), "it cannot hold a dict; use a named tuple"),
    (re.compile(r"has no attribute 'build_set'"), "it cannot hold a set; use a tuple"),
    (re.compile(r"format spec|f-string"), "it cannot format text"),
    (re.compile(r"yield in a closure|has no attribute 'get_function_type'"), "it cannot hold a generator"),
    (re.compile(r"The 'with .*construct is not supported"), "it cannot hold a with statement"),
    (UNDEFINED, r"the name \1 is not defined"),
    (
        re.compile(r"Untyped (?:global|freevar) name '(\w+)':.*<class '(?:builtin_function_or_method|type|module)'>"),
        r"there is no compiled version of \1",
    ),
    (re.compile(r"Untyped (?:global|freevar) name '(\w+)':.*<class '([\w.]+)'>"), FROM_OUTSIDE),
    (re.compile(r"Untyped (?:global|freevar) name '(\w+)': Cannot type empty (list|set|dict)"), FROM_OUTSIDE),
    (
        re.compile(r"The use of a (?:reflected )?(list|set|[Dd]ict)\S* type, assigned to variable '(\w+)' in globals"),
        r"\2 is a \1 from outside; only numbers, tuples and functions can be used from there",
    ),
    (
        re.compile(r"Unknown attribute '(\w+)' of type (?:reflected )?(list|set|dict|DictType)\b"),
        r"a list or dict has no \1 in compiled code, where nothing can grow; use a tuple",
    ),
    (re.compile(r"Unknown attribute '(\w+)' of type (.+)"), r"\2 has no \1"),
    (re.compile(r"No definition for lowering (\w+)\(.*?\)\.(\w+) ="), r"\2 of \1 cannot be set; make a new \1"),
    (
        re.compile(r"Cannot unify (.+) and (.+) for '(\w+?)(?:\.\d+)?'"),
        r"\3 is of two kinds, \1 and \2, in different branches",
    ),
    (re.compile(r"wrong tuple length for (\w+).*expected (\d+), got (\d+)"), r"\1 has \3 values, not \2"),
    (re.compile(r'Cannot bind .* due to "TypeError: (.+?)"'), r"a call does not fit the function that it calls: \1"),
    (re.compile(r"OverloadSelector object .*, \((\w+)"), r"there is nothing in CUDA for the type \1"),
)
UNSUPPORTED = re.compile(r"unsupported opcode \((\w+)\)")
NO_VERSION = re.compile(r"No implementation of function .+? found for signature:\s*>>> (?P<name>\w+)\((?P<given>.*)\)")


class Place(NamedTuple):
    """A line of a source file."""

    path: str
    line: int


def explain(error: Exception, function: Callable[..., Any]) -> str:
    """Return one sentence on why Numba could not compile a user's function: its name, the reason, the user's own line.

    error: what the compiler (on the CPU or for CUDA) or `binding.bind` raised for it; function: as the user wrote it.
    The line is the innermost one in user code, which may be that of another function that this one calls, but is one of
    this package only where there is nothing else.
    """
    functions = _reachable(function)
    loop = _loop(functions) if isinstance(error, RecursionError) else None
    if loop is not None:
        reason, place = "it calls itself", _line_of(*loop) or first_line(loop[0])
    else:
        reason, place = _reason(error), _place(error, functions)
    return f"{function.__name__} cannot be compiled: {reason} ({located(place)})."


def refuse_laws(program: Program, compile_law: Callable[[Called], object]) -> None:
    """Compile each law of a program alone; raises LawError with its author's own line for the first that cannot be."""
    for law in program.laws:
        try:
            compile_law(law)
        except Exception as error:
            said = str(error) if isinstance(error, EngineError) else explain(error, law.user)
            raise LawError(f"{said} The engines reference and interpreted compile nothing.") from None


def stopped(error: Exception, users: Iterable[Callable[..., Any]]) -> str | None:
    """Return one sentence on why a user's function stopped while it ran, with its line; None where none of them did."""
    frames = list(walk_tb(error.__traceback__))
    for function in users:
        codes = set(codes_of(function.__code__))
        lines = [line for frame, line in frames if frame.f_code in codes]
        if lines:
            place = located(Place(function.__code__.co_filename, lines[-1]))
            return f"the law {function.__name__} stops with {type(error).__name__}: {error} ({place})."
    inside = any(frame.f_code.co_name in ("remembering", "forgetful", "looped") for frame, _ in frames)
    for function in users:
        if inside or (isinstance(error, ValueError) and "values" in str(error)):
            return f"the law {function.__name__} does not return the same in all its branches: damage and its memory."
    return None


def located(place: Place) -> str:
    """Return "file, line n: source" of a place, without the source where there is none to read."""
    source = linecache.getline(place.path, place.line).strip()
    return f"{Path(place.path).name}, line {place.line}" + (f": {source}" if source else "")


def first_line(function: Callable[..., Any]) -> Place:
    """Return where a function is defined."""
    return Place(function.__code__.co_filename, function.__code__.co_firstlineno)


# The reason -----------------------------------------------------------------------------------------------------


def _reason(error: Exception) -> str:
    """Return what a compiler says, in plain words where they are known, else its first meaningful line."""
    message = CANDIDATES.sub("", EXCERPT.sub("", COLOUR.sub("", str(error))))
    for pattern, words in REASONS:
        if match := pattern.search(message):
            return plain(match.expand(words))
    if match := UNSUPPORTED.search(message):
        return f"it cannot hold {CONSTRUCTS.get(match[1], 'the Python instruction ' + match[1])}"
    if match := NO_VERSION.search(message):
        return f"there is no compiled version of {_call(match['name'], plain(match['given']))}"
    lines = [line.strip() for line in message.splitlines() if not FRAME.match(line)]
    said = PLACES.sub("", lines[0]) if lines else ""
    return plain(said).rstrip(" .,;:") or type(error).__name__


def _call(name: str, given: str) -> str:
    """Return a call as the user wrote it: with brackets, or with the sign of an operator."""
    first, _, second = given.partition(", ")
    if name in ("getitem", "static_getitem", "setitem", "static_setitem"):
        index, _, value = second.partition(", ")
        return f"{first}[{index}]" + (f" = {value}" if value else "")
    return f"{first} {OPERATORS[name]} {second}" if name in OPERATORS else f"{name}({given})"


def plain(text: str) -> str:
    """Return a text with Numba's names of types as a user would say them."""
    for pattern, words in TYPES:
        text = pattern.sub(words, text)
    return text


# The line -------------------------------------------------------------------------------------------------------


def _place(error: Exception, functions: list[FunctionType]) -> Place:
    """Return the innermost place of an error in the functions that may be blamed, else where the first begins."""
    blamed = [f for f in functions if PACKAGE not in Path(f.__code__.co_filename).parents] or functions
    if unknown := UNDEFINED.search(str(error)):  # whose place Numba forgets
        for f in blamed:
            if unknown[1] not in f.__globals__ and (place := _line_of(f, unknown[1], "LOAD_GLOBAL")):
                return place
    for path, line in (*_in_message(COLOUR.sub("", str(error))), *_in_traceback(error)):
        for code in (f.__code__ for f in blamed):
            if Path(path).name == Path(code.co_filename).name and line in _lines(code):
                return Place(code.co_filename, line)
    return first_line(blamed[0])


def _in_message(message: str) -> Iterator[Place]:
    """Yield the places that a message names: Numba puts the innermost first, its path in full or only as a tail."""
    for found in PLACES.finditer(message):
        yield Place(found["shown"] or found["path"], int(found["number"] or found["row"]))


def _in_traceback(error: Exception) -> Iterator[Place]:
    """Yield the places that the compiler's own frames were at work on, innermost first.

    Not every error says where it was: but an instruction, and whoever translates one, has a `loc`.
    """
    frames = [frame.f_locals for frame, _ in walk_tb(error.__traceback__)]
    places: list[Any] = [getattr(error, "loc", None)]
    for names in reversed(frames):
        places += [names.get("loc"), *(getattr(names.get(n), "loc", None) for n in ("inst", "expr", "self"))]
    for loc in places:
        if isinstance(getattr(loc, "line", None), int):
            yield Place(loc.filename, loc.line)


def _lines(code: CodeType) -> set[int]:
    """Return the numbers of the lines of a function, those of the functions written inside it included."""
    return {line for each in _codes(code) for _, _, line in each.co_lines() if line is not None}


# What a function uses -------------------------------------------------------------------------------------------


def _used(function: FunctionType) -> dict[str, FunctionType]:
    """Return the Python functions that a function uses, by the names that it has for them."""
    values = globals_of(function)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            values[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            continue
    names = names_of(function.__code__)
    parts = [parts_of(value, names, {}) for value in values.values() if isinstance(value, ModuleType)]
    named = [*values.items(), *(item for part in parts for item in part.items())]
    return {name: value for name, value in named if isinstance(value, FunctionType)}


def _reachable(function: Callable[..., Any]) -> list[FunctionType]:
    """Return a function and all those that it uses, directly or not."""
    found: list[FunctionType] = []
    ahead = [function]
    while ahead:
        next_one = ahead.pop(0)
        if isinstance(next_one, FunctionType) and next_one not in found:
            found.append(next_one)
            ahead += _used(next_one).values()
    return found


def _loop(functions: list[FunctionType]) -> tuple[FunctionType, str] | None:
    """Return the first function that comes back to itself, and the name by which it does."""
    for function in functions:
        for name, used in _used(function).items():
            if function in _reachable(used):
                return function, name
    return None


def _line_of(function: FunctionType, name: str, by: str = "") -> Place | None:
    """Return where a function first uses a name, by an instruction of this kind; None where it does not."""
    for code in _codes(function.__code__):
        for instruction in dis.get_instructions(code):
            line = instruction.positions and instruction.positions.lineno
            if line and instruction.argval == name and instruction.opname.startswith(by):
                return Place(code.co_filename, line)
    return None


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function and of the functions written inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _codes(inner)
