"""Laws through NVIDIA's compiler without a GPU, and what is said where a compiler cannot take one.

The assembly is read back by a few lines of Python that do what each instruction says; laws in plain Python are the
truth for it. Tests that need the compiler skip where the cuda extra is not installed.
"""

import inspect
import math
import operator
import random
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import BuiltinFunctionType, SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

import pybondem as bd
from pybondem import ops
from pybondem.engines import cuda_compile
from pybondem.engines.binding import bind
from pybondem.engines.compile_errors import explain
from pybondem.engines.cuda_compile import WORDS, Compiled, compile_for_gpu, missing
from pybondem.errors import EngineError
from pybondem.ops import Vector, absolute, cross, exp, log, maximum, minimum, norm, sqrt, where
from pybondem.physics.types import Deformation, Rate, Stiffness

HERE = Path(__file__).name
MISSING = missing()
needs_compiler = pytest.mark.skipif(MISSING is not None, reason=f"no compiler for GPUs: {MISSING}")
CAPABILITIES = [(8, 0), (9, 0), (10, 0)]


class Pair(NamedTuple):
    """Two numbers of a law."""

    a: float
    b: float


class Pull(NamedTuple):
    """Members of every kind: a number, a vector and a named tuple."""

    opening: float
    slip: Vector
    pair: Pair


class Nothing(NamedTuple):
    """The memory of a law without one."""


def user_law(pull: Pull, memory: Nothing, limit: float) -> tuple[Any, Any]:
    """Vectors in, a number and a vector out, with every word that is one instruction."""
    size = maximum(norm(pull.slip), absolute(pull.opening) / pull.pair.b)
    damage = minimum(1.0, where(pull.opening > limit, size, sqrt(size) * pull.pair.a))
    return damage, cross(pull.slip, (limit, 2.0, pull.opening))


def creep_law(pair: Pair) -> Any:
    """Library functions, with branches inside."""
    return exp(-pair.a) + log(pair.b) + pair.a**pair.b


def with_kinds(law: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the function of a damage law and the types of its arguments."""
    return law.function, (Deformation, Stiffness, law.memory, type(law.parameters), Rate, float)


STRENGTH = with_kinds(bd.strength(tension=5e6, shear=3e6))
BILINEAR = with_kinds(bd.bilinear(slip_peak=1e-5, slip_end=4e-5))
USER = (user_law, (Pull, Nothing, float))
LAWS = pytest.mark.parametrize(("law", "kinds"), [STRENGTH, BILINEAR, USER], ids=["strength", "bilinear", "user"])


# The assembly, read back ----------------------------------------------------------------------------------------


def same(a: Any) -> Any:
    return a


INSTRUCTIONS: dict[str, Callable[..., Any]] = {
    "mov": same, "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv,
    "neg": operator.neg, "abs": abs, "sqrt": math.sqrt, "fma": lambda a, b, c: a * b + c,
    "max": max, "min": min, "selp": lambda a, b, yes: a if yes else b,
    "and": lambda a, b: a and b, "or": lambda a, b: a or b, "not": operator.not_,
}  # fmt: skip
COMPARISONS = {"lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge, "eq": operator.eq}


def run(ptx: str, inputs: list[float], outputs: int) -> list[float]:
    """Do what a kernel without branches says; numbers are finite, so that comparisons with u are those without."""
    registers: dict[str, Any] = {}
    results = [math.nan] * outputs

    def value(name: str) -> Any:
        return struct.unpack(">d", bytes.fromhex(name[2:]))[0] if name.startswith("0d") else registers[name]

    for line in ptx[ptx.index("\n{") : ptx.index("\tret;")].splitlines():
        name, _, rest = line.strip().rstrip(";").partition(" ")
        operands = re.sub(r"[\t ]", "", rest).split(",")
        word, *kinds = name.split(".")
        if name == "ld.global.f64":
            registers[operands[0]] = inputs[offset(operands[1])]
        elif name == "st.global.f64":
            results[offset(operands[0])] = value(operands[1])
        elif word == "setp":
            compare = COMPARISONS[kinds[0].removesuffix("u") if kinds[0] != "equ" else "eq"]
            registers[operands[0]] = compare(*map(value, operands[1:]))
        elif word in INSTRUCTIONS and kinds[-1] in ("f64", "pred"):
            registers[operands[0]] = INSTRUCTIONS[word](*map(value, operands[1:]))
        else:
            assert word in ("", "{", "ld", "cvta") or name.startswith(".reg"), line
    return results


def offset(address: str) -> int:
    """Return the index of the number at an address such as [%rd4+48]."""
    return int(address.strip("[]").partition("+")[2] or 0) // 8


def flat(value: Any) -> list[float]:
    return [x for member in value for x in flat(member)] if isinstance(value, tuple) else [value]


def arguments(law: Any, kinds: tuple[Any, ...], numbers: list[float]) -> list[Any]:
    """Return the arguments that a law takes, made of numbers in their order."""
    if law is user_law:
        return [Pull(numbers[0], tuple(numbers[1:4]), Pair(*numbers[4:6])), Nothing(), numbers[6]]
    ahead = iter(numbers)
    return [next(ahead) if kind is float else kind(*(next(ahead) for _ in kind._fields)) for kind in kinds]


# What compiles --------------------------------------------------------------------------------------------------


@needs_compiler
@LAWS
@pytest.mark.parametrize("capability", CAPABILITIES)
def test_a_law_becomes_double_precision_in_registers(law, kinds, capability):
    made = compile_for_gpu(law, kinds, capability)
    assert f".target sm_{capability[0]}{capability[1]}" in made.ptx
    assert re.search(r"\b(fma\.rn|mul|add)\.f64\b", made.ptx) or "sub.f64" in made.ptx
    assert ".f32" not in made.ptx
    assert "call" not in made.ptx
    assert ".func" not in made.ptx  # all inlined
    if made.registers is None:
        pytest.skip("ptxas was not found: registers and spills are not known")
    assert 8 <= made.registers <= 64
    assert made.spills == 0


@needs_compiler
@LAWS
@pytest.mark.parametrize("capability", CAPABILITIES)
def test_the_assembly_does_what_the_law_says(law, kinds, capability):
    ptx = compile_for_gpu(law, kinds, capability).ptx
    rng = random.Random(7)
    seen = set()
    for _ in range(200):
        numbers = [rng.uniform(0.1, 2.0) for _ in range(30)]
        expected = flat(law(*arguments(law, kinds, numbers)))
        assert run(ptx, numbers, len(expected)) == pytest.approx(expected, rel=1e-13, abs=1e-15)
        seen.add(expected[0])
    assert len(seen) > 1  # both sides of the branches


@needs_compiler
def test_library_functions_keep_double_precision():
    """The exponential looks at its argument's upper half as a float, but computes in doubles."""
    made = compile_for_gpu(creep_law, (Pair,))
    assert not re.search(r"\b(add|sub|mul|fma|div|sqrt|ex2|lg2|cvt)\.\S*f32", made.ptx)
    assert made.spills in (0, None)


def twice(a):
    return 2.0 * a


@needs_compiler
def test_one_number_is_enough():
    assert run(compile_for_gpu(twice, (float,)).ptx, [3.0], 1) == [6.0]


def test_every_word_that_is_not_python_is_known_to_cuda():
    assert {w for w in vars(ops).values() if isinstance(w, BuiltinFunctionType)} <= set(WORDS)


# What it needs --------------------------------------------------------------------------------------------------


@needs_compiler
def test_spills_are_seen():
    """So many numbers at once in sixteen registers must go to memory."""
    made = compile_for_gpu(*STRENGTH)
    if made.registers is None:
        pytest.skip("ptxas was not found: registers and spills are not known")
    crowded = "".join(f"\tld.volatile.global.f64 \t%x{k}, [%rd4+{8 * k}];\n" for k in range(40))
    crowded += "".join(f"\tst.volatile.global.f64 \t[%rd3+{8 * k}], %x{k};\n" for k in range(40))
    ptx = made.ptx.replace("\n)\n{", "\n)\n.maxnreg 24\n{").replace("\tret;", f"\t.reg .f64 %x<40>;\n{crowded}\tret;")
    registers, spills, _ = cuda_compile._needs(ptx)
    assert registers == 24
    assert spills >= 40 * 8


@needs_compiler
def test_without_ptxas_nothing_is_said_of_registers(monkeypatch):
    monkeypatch.setattr(import_module("cuda.pathfinder"), "find_nvidia_binary_utility", lambda name: None)
    monkeypatch.setattr(cuda_compile.shutil, "which", lambda name: None)
    made = compile_for_gpu(*STRENGTH)
    assert made == Compiled(made.ptx, None, None)


@needs_compiler
@pytest.mark.parametrize("said", ["Unsupported .version 9.0; current version is '8.4'", "Value 'sm_90' for 'gpu-name'"])
def test_an_older_ptxas_is_none(monkeypatch, said):
    answer = SimpleNamespace(returncode=255, stdout="", stderr=f"ptxas fatal : {said}")
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: answer)
    assert compile_for_gpu(*STRENGTH)[1:] == (None, None, None)


@needs_compiler
def test_what_ptxas_refuses_is_said():
    with pytest.raises(EngineError, match=r"does not take what the compiler made: ptxas .*error"):
        cuda_compile._needs(".version 9.0\n.target sm_90\n.address_size 64\n.entry broken() { nonsense; }\n")


# What is missing ------------------------------------------------------------------------------------------------


def test_without_the_extra_it_is_asked_for(monkeypatch):
    monkeypatch.setattr(cuda_compile.sys, "platform", "linux")
    monkeypatch.setattr(cuda_compile.importlib.util, "find_spec", lambda name: None)
    assert missing() == "the cuda extra is not installed: pip install pybondem[cuda]"
    with pytest.raises(EngineError, match=r"^\S+ cannot .* GPU: the cuda extra .* pybondem\[cuda\]\.$"):
        compile_for_gpu(*STRENGTH)


def test_an_extra_that_does_not_load_is_said(monkeypatch):
    def fails(name):
        raise AttributeError("module 'numpy' has no attribute 'row_stack'")

    monkeypatch.setattr(cuda_compile.sys, "platform", "linux")
    monkeypatch.setattr(cuda_compile.importlib.util, "find_spec", lambda name: "here")
    monkeypatch.setattr(cuda_compile, "import_module", fails)
    assert "does not load (module 'numpy' has no attribute 'row_stack'): pip install" in (missing() or "")


def test_macos_has_no_cuda(monkeypatch):
    monkeypatch.setattr(cuda_compile.sys, "platform", "darwin")
    assert missing() == "there is no CUDA for macOS"


@needs_compiler
def test_a_machine_is_left_as_it_was():
    dispatcher = import_module("numba.cuda.dispatcher")
    before = dispatcher.get_current_device
    compile_for_gpu(*STRENGTH)
    with pytest.raises(EngineError):
        compile_for_gpu(a_dict, (Pair,))
    assert dispatcher.get_current_device is before


# What does not compile ------------------------------------------------------------------------------------------

HISTORY: list[float] = []
FILLED = [1.0]
TABLE = {"a": 1.0}


def a_dict(p):
    table = {"peak": p.a, "end": "x"}  # here
    return table["peak"]


def a_table(p):
    return p.a * TABLE["a"]  # here


def a_set(p):
    both = {p.a, p.b}  # here
    return 1.0 * len(both)


def a_format(p):
    name = f"{p.a:.3f}"  # here
    return len(name)


def a_percent(p):
    name = "%f" % p.a  # noqa: UP031  # here
    return len(name)


def a_list(p):
    values = []

    def put(x):
        values.append(x)  # here

    put(p.a)
    return values[0]


def a_generator(p):
    return sum(x for x in (p.a, p.b))  # here


def an_unknown_call(p):
    return p.b + open(p.a)  # here


def an_undefined_name(p):
    x = p.a
    return x * not_there  # noqa: F821  # here


def a_try(p):
    try:
        return p.a / p.b
    except ZeroDivisionError:  # here
        return 0.0


def a_history(p):
    x = p.a
    HISTORY.append(x)  # here
    return x


def a_filled_history(p):
    x = p.a
    FILLED.append(x)  # here
    return x


def an_array(p):
    both = np.zeros(2)  # here
    both[0] = p.a
    return both[0]


def a_recursion(p):
    if p.a > 1.0:
        return a_recursion(Pair(p.a - 1.0, p.b))  # here
    return p.a


def an_import(p):
    import math  # here

    return math.sqrt(p.a)


def a_wrong_member(p):
    x = p.a
    return x + p.c  # here


def a_changed_member(p):
    p.a = 3.0  # here
    return p.a


def two_kinds(p):
    r = (1.0, 2.0)
    if p.a > 0.0:
        r = 3.0
    return r  # here


def a_wrong_call(p):
    x = p.a
    return sqrt(x, p.b)  # here


def a_word_of_the_package(p):
    x = p.a
    return norm(x)  # here


BAD = [  # function, what is said, whether only CUDA refuses it
    (a_dict, "it cannot hold a dict", True),
    (a_table, "TABLE is a dict from outside", False),
    (a_set, "it cannot hold a set", True),
    (a_format, "it cannot format text", False),
    (a_percent, "no compiled version of text % number", False),
    (a_list, "has no append", True),
    (a_generator, "it cannot hold a generator", False),
    (an_unknown_call, "no compiled version of open", False),
    (an_undefined_name, "the name not_there is not defined", False),
    (a_try, "it cannot hold try and except", False),
    (a_history, "HISTORY is a list from outside", False),
    (a_filled_history, r"FILLED is a list from outside|has no append", False),
    (an_array, r"no compiled version of zeros\(number\)", True),
    (a_recursion, "it calls itself", False),
    (an_import, "it cannot hold an import inside a function", False),
    (a_wrong_member, "Pair has no c", False),
    (a_changed_member, "a of Pair cannot be set; make a new Pair", False),
    (two_kinds, r"r is of two kinds, (number and tuple|tuple and number)", False),
    (a_wrong_call, r"no compiled version of sqrt\(number, number\)", False),
    (a_word_of_the_package, r"no compiled version of number\[number\]", False),
]
IDS = [function.__name__ for function, _, _ in BAD]


def marked(function: Any) -> int:
    """Return the number of the line of a function that is marked as wrong."""
    lines, first = inspect.getsourcelines(function)
    return first + next(k for k, line in enumerate(lines) if "# here" in line)


def check_sentence(said: str, function: Any, reason: str, line: int) -> None:
    source = inspect.getsourcelines(sys.modules[__name__])[0][line - 1].strip()
    assert "\n" not in said
    assert said.startswith(f"{function.__name__} cannot be compiled: ")
    assert said.endswith(f" ({HERE}, line {line}: {source}).")
    assert re.search(reason, said)


def compile_for_cpu(function: Any) -> Any:
    pair = numba.types.NamedUniTuple(numba.float64, 2, Pair)
    return bind(function, {ops.sqrt: np.sqrt}, numba.njit, {}).compile((pair,))


@pytest.mark.parametrize(("function", "reason", "only_cuda"), BAD, ids=IDS)
def test_numba_on_the_cpu_is_explained(function, reason, only_cuda):
    if only_cuda:
        assert compile_for_cpu(function)
        return
    with pytest.raises(Exception) as caught:  # noqa: PT011  of many kinds
        compile_for_cpu(function)
    check_sentence(explain(caught.value, function), function, reason, marked(function))


@needs_compiler
@pytest.mark.parametrize(("function", "reason", "only_cuda"), BAD, ids=IDS)
def test_cuda_names_the_line_of_the_user(function, reason, only_cuda):
    with pytest.raises(EngineError) as caught:
        compile_for_gpu(function, (Pair,))
    check_sentence(str(caught.value), function, reason, marked(function))
    assert caught.value.__suppress_context__


@pytest.mark.parametrize(("function", "reason", "only_cuda"), BAD, ids=IDS)
def test_the_line_is_that_of_the_innermost_function_of_the_user(function, reason, only_cuda):
    """Also where the call goes through a function of any number of arguments, as in a declared law."""

    def through(*a):
        return function(*a)

    def outer(p):
        return through(p)

    if only_cuda and MISSING is not None:
        pytest.skip(f"no compiler for GPUs: {MISSING}")
    if not only_cuda:
        with pytest.raises(Exception) as caught:  # noqa: PT011  of many kinds
            compile_for_cpu(outer)
        check_sentence(explain(caught.value, outer), outer, reason, marked(function))
    if MISSING is None:
        with pytest.raises(EngineError) as refused:
            compile_for_gpu(outer, (Pair,))
        check_sentence(str(refused.value), outer, reason, marked(function))


def test_colours_of_the_terminal_and_unknown_errors_are_taken():
    first = a_dict.__code__.co_firstlineno
    check_sentence(explain(ValueError("\x1b[1mall\x1b[0m wrong\nfor long"), a_dict), a_dict, "led: all wrong ", first)
    check_sentence(explain(ValueError(), a_dict), a_dict, "compiled: ValueError ", first)


def test_what_the_user_wrote_does_not_speak_for_the_compiler():
    """An excerpt of the source in the message holds words that mean something else from the compiler."""
    said = 'no luck\n\nFile "law.py", line 3:\ndef f(p):\n    return p  # format spec\n    ^\n\nDuring: Pass one'
    assert "compiled: no luck (" in explain(ValueError(said), a_dict)


@needs_compiler
def test_a_declared_law_is_explained_by_its_own_lines():
    """What stands between the law and the engine belongs to the package, and is not to blame."""

    @bd.damage_law(parameters={"rate": "1/m"})
    def listed(d, p):
        values = [d.opening * p.rate]
        values.append(1.0)  # here
        return values[0]

    function, kinds = with_kinds(listed(rate=1.0))
    with pytest.raises(EngineError, match="has no append") as caught:
        compile_for_gpu(function, kinds)
    assert f"{HERE}, line {marked(listed.user)}: values.append(1.0)  # here)." in str(caught.value)


@needs_compiler
@pytest.mark.parametrize(
    ("law", "kind"),
    [
        (lambda p: "x", "text"),
        (lambda p: None, "none"),
        (lambda p: (p.a, "x"), r"tuple\(number, text\)"),
        (lambda p: (), r"tuple\(\)"),
    ],
    ids=["text", "none", "mixed", "empty"],
)
def test_a_law_on_cuda_returns_numbers(law, kind):
    with pytest.raises(EngineError, match=rf"must return numbers, and returns {kind} \({re.escape(HERE)}, line \d+: "):
        compile_for_gpu(law, (Pair,))


@needs_compiler
def test_a_capability_below_what_cuda_knows_is_refused():
    with pytest.raises(EngineError, match=r"^twice cannot be compiled: .*capability 5\.0 is not supported"):
        compile_for_gpu(twice, (float,), capability=(5, 0))
