"""The cpu engine: a program's loops compiled by Numba, on threads and SIMD lanes.

What makes LLVM vectorise them: `prange` loops (compiled with no-alias arguments, on one thread too), bodies that are
always inlined and return flat tuples, component-first arrays, unsigned indices, 512-bit vectors where there are any.
The same bits for every number of threads: each item is written by one iteration, sums are taken in fixed order.
"""

import hashlib
import importlib.util
import math
import os
import platform
import sys
import tempfile
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Protocol

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import config

from pybondem import ops
from pybondem.engines import cpu_words
from pybondem.engines.binding import bind, globals_of, names_of, parts_of
from pybondem.engines.compile_errors import refuse_laws
from pybondem.engines.lookups import INDEX_WORDS
from pybondem.engines.loops import Loops
from pybondem.errors import EngineError
from pybondem.program import Body, Called, Program
from pybondem.state import Arrays

SPINS = "2000"
BONDS_PER_THREAD = 1000  # fewer are faster on fewer threads

_BOUND: dict[Any, Any] = {}  # compiled code is never freed: bind each function once
_MODULES: dict[str, ModuleType] = {}


def prepare_numba() -> None:
    """Ask for full-width vectors and for OpenMP threads; both must be set before Numba is given its first function.

    Threads that wait at the end of a loop spin for some tens of microseconds, then sleep: for ever, as is OpenMP's
    way, a machine with other work on its cores slows down twentyfold; not at all, and small models do.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", SPINS)
    if "NUMBA_CPU_FEATURES" not in os.environ and not config.CPU_FEATURES:
        config.CPU_FEATURES = llvm.get_host_cpu_features().flatten() + ",-prefer-256-bit"
    if "NUMBA_THREADING_LAYER" not in os.environ:
        try:
            from numba.np.ufunc import omppool  # noqa: F401
        except ImportError:
            config.THREADING_LAYER = "workqueue"
            said = "OpenMP (libgomp) was not found: threads run on Numba's workqueue, slower on small models."
            warnings.warn(said, stacklevel=2)
        else:
            config.THREADING_LAYER = "omp"


prepare_numba()


def inlined(function: FunctionType) -> Any:
    """Return a function that is always inlined, with IEEE division."""
    return numba.njit(forceinline=True, error_model="numpy")(function)


WORDS: dict[Any, Any] = {
    word: bind(ours, {}, inlined, _BOUND)
    for word, ours in ((max, cpu_words.largest), (min, cpu_words.smallest), (np.clip, cpu_words.clip))
}
for word in ("exp", "log", "power"):
    WORDS[getattr(ops, word)] = bind(getattr(cpu_words, word), {}, inlined, _BOUND)
WORDS |= {
    ops.sqrt: np.sqrt,
    math.pow: WORDS[ops.power],
    np.power: WORDS[ops.power],
    np.exp: WORDS[ops.exp],
    np.log: WORDS[ops.log],
}
NUMPYS: dict[Any, Any] = {np.where: ops.where, np.maximum: ops.maximum, np.minimum: ops.minimum, np.abs: ops.absolute}
WORDS |= {numpys: bind(ours, {}, inlined, _BOUND) for numpys, ours in NUMPYS.items()}


def physical_cores() -> int:
    """Return the number of physical cores that this process may use."""
    available = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))
    siblings = set()
    for cpu in available:
        path = Path(f"/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list")
        siblings.add(path.read_text().strip() if path.exists() else str(cpu))
    return max(1, len(siblings))


def cache_folder() -> Path:
    """Return the folder of compiled programs: $PYBONDEM_CACHE, else the user's cache, else a temporary one."""
    home = os.environ.get("PYBONDEM_CACHE") or Path.home() / ".cache" / "pybondem"
    try:
        Path(home).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=home):
            return Path(home)
    except OSError:
        return Path(tempfile.mkdtemp(prefix="pybondem-"))


def package_source() -> bytes:
    """Return a digest of the source that compiled code is made of."""
    package = Path(__file__).parents[1]
    files = [
        package / "ops.py",
        *package.glob("*_bodies.py"),
        package / "bond_answers.py",
        package / "program.py",
        *package.glob("engines/*.py"),
        *package.glob("physics/**/*.py"),
    ]
    return _digest(tuple((path, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(files)))


@cache
def _digest(files: tuple[tuple[Path, int, int], ...]) -> bytes:
    return hashlib.sha256(b"".join(path.read_bytes() for path, _, _ in files)).digest()


class Generated(Protocol):
    """A text that is to be compiled, and the functions that it calls by name."""

    @property
    def source(self) -> str:
        """The text."""

    @property
    def bodies(self) -> Mapping[str, Body]:
        """What it calls."""


def fingerprint(text: Generated) -> str:
    """Return a key that changes with anything that the compiled code depends on."""
    key = hashlib.sha256(package_source())
    for name, body in text.bodies.items():
        key.update(name.encode() + _code_of(body, []))
    versions = (numba.__version__, llvm.llvm_version_info, np.__version__, sys.version, platform.machine())
    key.update(repr((text.source, versions, config.CPU_FEATURES, llvm.get_host_cpu_name())).encode())
    return key.hexdigest()[:24]


def _code_of(value: Any, seen: list[Any]) -> bytes:
    """Return what a value compiles to: a function's byte code, names and constants, and all values that it uses."""
    if isinstance(value, np.ndarray):
        return repr((value.dtype, value.shape)).encode() + value.tobytes()
    if isinstance(value, ModuleType):
        return value.__name__.encode()
    if not isinstance(value, FunctionType | CodeType):
        return repr(value).encode()
    if value in seen:
        return b"number %d" % seen.index(value)
    seen.append(value)
    if isinstance(value, CodeType):
        used = (value.co_code, value.co_names, *value.co_consts)  # the byte code holds only the places of its names
    else:
        values = [*globals_of(value).values(), *(cell.cell_contents for cell in value.__closure__ or ())]
        names = names_of(value.__code__)
        parts = [part for v in values if isinstance(v, ModuleType) for part in parts_of(v, names, {}).values()]
        used = (value.__code__, value.__defaults__, value.__kwdefaults__, *values, *parts)
    return b"\n".join(_code_of(v, seen) for v in used)


def compiled(loops: Loops) -> Any:
    """Return the compiled `advance`, from the cache where an earlier process has left it."""
    name = f"pybondem_step_{fingerprint(loops)}"
    if name in _MODULES:
        return _MODULES[name].advance
    path = cache_folder() / f"{name}.py"
    if not path.exists():
        text = '"""Loops of a step program; made by pybondem, may be deleted."""\n\n' + loops.source
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
            file.write(text)
        os.replace(file.name, path)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise EngineError(f"The compiled program {path} cannot be loaded; delete it and run again.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = _MODULES[name] = module  # Numba's cache looks the module up by name
    spec.loader.exec_module(module)
    vars(module).update(INDEX_WORDS, prange=numba.prange, **loops.types)
    vars(module).update({n: bind(body, WORDS, inlined, _BOUND) for n, body in loops.bodies.items()})
    module.advance = numba.njit(parallel=True, error_model="numpy", cache=True)(module.advance)  # type: ignore[attr-defined]
    return module.advance


def compile_law(law: Called) -> None:
    """Compile a law alone."""
    numbers = [1.0 if kind is float else kind(*(1.0 for _ in kind._fields)) for kind in law.types]
    bind(law.function, WORDS, inlined, _BOUND)(*numbers)


class CpuRunner:
    """A program as one compiled function."""

    def __init__(self, program: Program, threads: int) -> None:
        self._loops = Loops(program)
        bonds = sum(b.count for b in program.blocks)
        self._threads = max(1, min(threads, bonds // BONDS_PER_THREAD))
        self._advance = compiled(self._loops)

    def advance(self, steps: int, dt: float, schedule: Arrays) -> None:
        """Run the program's stages `steps` times, dt [s] apart."""
        numba.set_num_threads(self._threads)
        try:
            self._advance(steps, *self._loops.values(dt, schedule))
        except Exception:  # Numba raises more than its own errors
            refuse_laws(self._loops.program, compile_law)
            raise


class Cpu:
    """Engine "cpu"; threads: how many to use, physical cores by default."""

    name = "cpu"

    def __init__(self, threads: int | None = None) -> None:
        most = numba.config.NUMBA_NUM_THREADS
        if threads is not None and not 1 <= threads <= most:
            raise EngineError(f"threads is {threads}; this machine allows 1 to {most}.")
        self.threads = min(threads or physical_cores(), most)

    def prepare(self, program: Program) -> CpuRunner:
        """Return a runner for the program, compiled on first use on this machine (seconds), then cached."""
        return CpuRunner(program, self.threads)
