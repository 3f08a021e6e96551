"""A user's function through NVIDIA's compiler, on a machine with or without a GPU.

What a law needs on a GPU is learnt before one is at hand: that it compiles at all, its registers, its spills.
"""

import importlib.util
import math
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, get_args, get_origin

from pybondem import ops
from pybondem.engines.binding import bind
from pybondem.engines.compile_errors import explain, first_line, located, plain
from pybondem.engines.cuda_text import Text
from pybondem.errors import EngineError

# Words that are not written in Python, and CUDA's versions of them. `where`, `minimum`, `maximum` and `absolute` are
# compiled as they stand: each becomes a comparison and a selection, without a branch.
WORDS: dict[Any, Any] = {ops.exp: math.exp, ops.log: math.log, ops.sqrt: math.sqrt}
EXTRA = "pip install pybondem[cuda]"

Capability = tuple[int, int]
SOURCE = "<CUDA kernel>"

_ONE_AT_A_TIME = threading.RLock()  # who tells Numba which device there is tells all threads


class Compiled(NamedTuple):
    """What became of a function.

    ptx: NVIDIA's assembly of a kernel that calls it; registers: what a thread of it needs; spills: bytes that do not
    fit into registers and go to memory and back, 0 in a good kernel; frame: bytes of a thread in memory of its own,
    with what is handed over to functions that are not inlined. All but the first are None where there is no `ptxas`.
    """

    ptx: str
    registers: int | None
    spills: int | None
    frame: int | None = None


def missing() -> str | None:
    """Return why nothing can be compiled for a GPU here, in one sentence, or None where it can."""
    if sys.platform == "darwin":
        return "there is no CUDA for macOS"
    if importlib.util.find_spec("numba_cuda") is None:
        return f"the cuda extra is not installed: {EXTRA}"
    try:
        import_module("numba.cuda.cudadrv.nvvm").NVVM()
    except Exception as error:  # whatever a library that is absent or of another version raises
        return f"the compiler of the cuda extra does not load ({error}): {EXTRA}"
    return None


def compile_for_gpu(
    function: Callable[..., Any], argument_types: Sequence[Any], capability: Capability = (9, 0)
) -> Compiled:
    """Compile a function for a GPU and say what it takes; needs neither a GPU nor a driver.

    function: plain Python in the words of `pybondem.ops`, which takes numbers and named tuples of numbers or vectors,
    and returns a number, or a tuple of numbers and tuples; argument_types: for each argument `float` or the named
    tuple; capability: what the GPU can do, (9, 0) for an H100; what the compiler does not know becomes the next one
    below. Raises EngineError where the compiler is missing or cannot compile the function, with the user's own line.
    """
    if why := missing():
        raise EngineError(f"{function.__name__} cannot be compiled for a GPU: {why}.")
    try:
        ptx = assembly(function, argument_types, capability)
    except EngineError:
        raise
    except Exception as error:  # Numba raises anything, AttributeError too, at what it does not know
        raise EngineError(explain(error, function)) from None
    return Compiled(ptx, *_needs(ptx))


def assembly(function: Callable[..., Any], argument_types: Sequence[Any], capability: Capability) -> str:
    """Return the assembly of a kernel around a function; the function goes first, alone, for the sake of its errors.

    Raises what the compiler raises, and EngineError where the function does not return numbers.
    """
    import numba
    from numba import cuda

    with _device_of(capability):
        inlined = cuda.jit(device=True, forceinline=True)
        law = bind(function, WORDS, inlined, {})
        names = ", ".join(f"a{k}" for k in range(len(argument_types)))  # a function of *a is only compiled when called
        called = inlined(eval(f"lambda {names}: law({names})", {"law": law}))
        given = tuple(numba.typeof(_zeros(kind)) for kind in argument_types)
        returned = called.compile_device(given).signature.return_type
        results = _numbers("value", returned)
        if not results:
            where = located(first_line(function))
            raise EngineError(f"{function.__name__} must return numbers, and returns {plain(str(returned))} ({where}).")
        floats = numba.float64[::1]
        ptx, _ = cuda.compile_ptx(_kernel(law, argument_types, results), (floats, floats), cc=capability)
    return str(ptx)


@contextmanager
def _device_of(capability: Capability) -> Iterator[None]:
    """Let Numba believe in a device of this capability.

    `compile_ptx` takes the capability as an argument, but each device function that its kernel calls asks the device
    for it, hence the driver. Nothing else is asked of the device, and what Numba had is put back.
    """
    dispatcher: Any = import_module("numba.cuda.dispatcher")
    with _ONE_AT_A_TIME:
        real = dispatcher.get_current_device
        dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=capability)
        try:
            yield
        finally:
            dispatcher.get_current_device = real


# The kernel of a program ----------------------------------------------------------------------------------------


def kernel_of(text: Text) -> Callable[..., Any]:
    """Return the kernel `advance` of a text, for `cuda.jit`; its phases and their bodies are inlined into it."""
    from numba import cuda

    inlined = cuda.jit(device=True, forceinline=True)
    made: dict[Any, Any] = {}
    names: dict[str, Any] = {"cuda": cuda, **text.words, **text.types}
    names |= {name: bind(body, WORDS, inlined, made) for name, body in text.bodies.items()}
    before = set(names)
    exec(compile(text.source, SOURCE, "exec"), names)
    names |= {name: inlined(names[name]) for name in set(names) - before - {"advance", "__builtins__"}}
    kernel: Callable[..., Any] = names["advance"]
    return kernel


def compile_kernel(text: Text, capability: Capability = (9, 0), launch_bounds: Any = None) -> Compiled:
    """Compile the kernel of a program for a GPU and say what it takes; needs neither a GPU nor a driver.

    launch_bounds: threads of a block, or these and the blocks that must fit on a multiprocessor; by default the threads
    of the text. Raises EngineError where the compiler is missing.
    """
    if why := missing():
        raise EngineError(f"the kernel cannot be compiled for a GPU: {why}.")
    from numba import cuda

    with _device_of(capability):
        kinds = tuple(argument_types(text))
        bounds = launch_bounds or text.threads
        ptx, _ = cuda.compile_ptx(kernel_of(text), kinds, cc=capability, launch_bounds=bounds)
    return Compiled(str(ptx), *_needs(str(ptx)))


def at_bounds(made: Compiled, blocks: int) -> Compiled:
    """Return what a kernel, compiled with launch bounds, needs where so many blocks must fit on a multiprocessor.

    The bound is one line of the assembly, which is all that is translated again: a tenth of the time.
    """
    ptx, found = re.subn(r"(?<=\.minnctapersm )\d+", str(blocks), made.ptx)
    assert found == 1, "the kernel was compiled without a number of blocks"
    return Compiled(ptx, *_needs(ptx))


def argument_types(text: Text) -> Iterator[Any]:
    """Yield Numba's types of what the kernel of a text takes: steps, arguments, private arrays."""
    import numba

    yield numba.int64
    for value in text.arguments.values():
        yield (
            numba.types.Array(numba.from_dtype(value.dtype), value.ndim, "C")
            if hasattr(value, "ndim") and value.ndim
            else numba.typeof(value)
        )
    for array in text.private.values():
        yield numba.types.Array(numba.from_dtype(array.dtype), len(array.shape), "C")


# The kernel around the function ---------------------------------------------------------------------------------


def _members(kind: Any) -> list[Any] | None:
    """Return the types of the members of a tuple, named (the type itself) or not (tuple[a, b, ...]); None of a number.

    A member is a number unless its annotation says that it is one of these.
    """
    if get_origin(kind) is tuple:
        return list(get_args(kind))
    if isinstance(kind, type) and issubclass(kind, tuple):
        said = getattr(kind, "__annotations__", {})
        return [said.get(name) for name in kind._fields]  # type: ignore[attr-defined]
    return None


def _zeros(kind: Any) -> Any:
    """Return a value of a type, with all its numbers zero."""
    members = _members(kind)
    if members is None:
        return 0.0
    values = [_zeros(member) for member in members]
    return tuple(values) if get_origin(kind) is tuple else kind(*values)


def _expression(kind: Any, numbers: Iterator[str], names: dict[str, Any]) -> str:
    """Return the source of a value of a type, made of the next `numbers`; what it calls is put into `names`."""
    members = _members(kind)
    if members is None:
        return next(numbers)
    inside = "".join(f"{_expression(member, numbers, names)}, " for member in members)
    if get_origin(kind) is tuple:
        return f"({inside})"
    name = f"type_{len(names)}"
    names[name] = kind
    return f"{name}({inside})"


def _numbers(name: str, kind: Any) -> list[str] | None:
    """Return the sources of the numbers in a value of one of Numba's types; None where it holds anything else."""
    from numba import types

    if not isinstance(kind, types.BaseTuple):
        return [name] if isinstance(kind, types.Float | types.Integer | types.Boolean) else None
    found: list[str] = []
    for k, member in enumerate(kind):
        numbers = _numbers(f"{name}[{k}]", member)
        if numbers is None:
            return None
        found += numbers
    return found


def _kernel(law: Any, argument_types: Sequence[Any], results: Sequence[str]) -> Callable[..., Any]:
    """Return a kernel that reads the arguments from one array and writes the results to another."""
    names: dict[str, Any] = {"law": law}
    numbers = (f"inputs[{k}]" for k in count())
    given = ", ".join(_expression(kind, numbers, names) for kind in argument_types)
    lines = ["def kernel(inputs, outputs):", f"    value = law({given})"]
    lines += [f"    outputs[{k}] = {number}" for k, number in enumerate(results)]
    exec("\n".join(lines), names)
    made: Callable[..., Any] = names["kernel"]
    return made


# What it needs --------------------------------------------------------------------------------------------------


def _needs(ptx: str) -> tuple[int | None, int | None, int | None]:
    """Return registers, spilled bytes and frame of a kernel, None where there is no ptxas, or only an older one."""
    ptxas = import_module("cuda.pathfinder").find_nvidia_binary_utility("ptxas") or shutil.which("ptxas")
    if ptxas is None:
        return None, None, None
    target = ptx.split(".target ", 1)[1].split()[0]
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "kernel.ptx")
        source.write_text(ptx)
        asked = [ptxas, "-c", f"-arch={target}", "-v", str(source), "-o", str(source.with_suffix(".cubin"))]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    used = re.search(r"Used (\d+) registers", said)
    if done.returncode == 0 and used:
        spills, frame = (sum(map(int, re.findall(rf"(\d+) bytes {what}", said))) for what in ("spill", "stack frame"))
        return int(used[1]), spills, frame
    if "Unsupported .version" in said or "gpu-name" in said:
        return None, None, None
    raise EngineError(f"{ptxas} does not take what the compiler made: {said.strip().splitlines()[0]}")
