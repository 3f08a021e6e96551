"""What the tests share: the engines of this machine, small models, and ways to run them.

Every test that takes `engine` runs on each of them, and the last lines of the report say which these were. A machine
without a GPU is not silent about it, and fails where PYBONDEM_REQUIRE_GPU=1 asks for one; one without the compiler for
GPUs, which needs none, fails where PYBONDEM_REQUIRE_CUDA_COMPILER=1 asks for it.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from oracles.closed_forms import DP0

import pybondem as bd
from pybondem.engines.choose import ENGINES as OFFERED
from pybondem.engines.cuda_compile import missing

Floats = NDArray[np.float64]
NEED_GPU = {"cuda"}
COUNT_GPUS = """
import ctypes, sys
cuda, count = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"), ctypes.c_int()
print(0 if cuda.cuInit(0) or cuda.cuDeviceGetCount(ctypes.byref(count)) else count.value)
"""


# Engines --------------------------------------------------------------------------------------------------------


@cache
def gpus() -> int:
    """Return the number of CUDA devices: asked in a process of its own, which a driver may spoil for forking."""
    asked = subprocess.run([sys.executable, "-c", COUNT_GPUS], capture_output=True, text=True, check=False)
    return int(asked.stdout) if asked.returncode == 0 else 0


ENGINES = [name for name in OFFERED if name not in NEED_GPU or (gpus() and missing() is None)]


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> str:
    """Each engine that this machine can run, by name."""
    request.node.user_properties.append(("engine", request.param))
    return cast(str, request.param)


@pytest.fixture
def sized(engine: str) -> Callable[[Any, Any], Any]:
    """sized(full, reduced): the reduced size of a problem where every bond is a call of plain Python."""
    return lambda full, reduced: reduced if engine == "interpreted" else full


def gpu_line() -> str:
    """Return what there is to say about GPUs."""
    if not gpus():
        return "no GPU was seen"
    return f"{gpus()} GPU seen" + ("" if NEED_GPU & set(ENGINES) else f", but {missing()}")


def gpu_is_missing() -> bool:
    """Whether a GPU engine was asked for and cannot run."""
    return os.environ.get("PYBONDEM_REQUIRE_GPU") == "1" and not NEED_GPU & set(ENGINES)


def compiler_is_missing() -> bool:
    """Whether the compiler for GPUs was asked for and cannot be used, so that its tests were skipped."""
    return os.environ.get("PYBONDEM_REQUIRE_CUDA_COMPILER") == "1" and missing() is not None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which engines ran, on how many tests, and whether a GPU was seen."""
    reports = [r for group in terminalreporter.stats.values() for r in group if getattr(r, "when", None) == "call"]
    ran = [value for r in reports for name, value in r.user_properties if name == "engine"]
    counts = ", ".join(f"{name} ({ran.count(name)} tests)" for name in dict.fromkeys(ran)) or "none"
    red = {"red": True, "bold": True} if gpu_is_missing() else {}
    wanted = ", which PYBONDEM_REQUIRE_GPU=1 asks for" if gpu_is_missing() else ""
    terminalreporter.write_line(f"Engines: {counts}; {gpu_line()}{wanted}.", **red)
    if compiler_is_missing():
        said = f"No compiler for GPUs, which PYBONDEM_REQUIRE_CUDA_COMPILER=1 asks for: {missing()}."
        terminalreporter.write_line(said, red=True, bold=True)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail the run where a GPU, or the compiler for GPUs, was required and cannot be used."""
    if gpu_is_missing() or compiler_is_missing():
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


# Models ---------------------------------------------------------------------------------------------------------

PARALLEL = bd.parallel(E=DP0.E, stiffness_ratio=DP0.E / DP0.G, radius_ratio=DP0.bond_radius / DP0.radius)


@pytest.fixture
def dp0() -> Callable[..., bd.Bond]:
    """dp0(damage, damping): a parallel bond with the values of the set DP0."""
    return lambda damage=None, damping=0.0: bd.Bond(PARALLEL, damage, damping)


@pytest.fixture
def chain() -> Callable[..., tuple[bd.Model, Any]]:
    """chain(n, direction, bond, start): n touching spheres of the set DP0 in a row, bonded; model and bonds."""

    def make(
        n: int, direction: ArrayLike, bond: bd.Bond | None = None, start: ArrayLike = (0, 0, 0)
    ) -> tuple[bd.Model, Any]:
        model = bd.Model(bd.packing.line(n, DP0.length, direction, start, 2 * DP0.radius), density=DP0.density)
        return model, model.bond(model.touching(), bond or bd.Bond(PARALLEL))

    return make


@pytest.fixture
def pair(chain: Callable[..., tuple[bd.Model, Any]]) -> Callable[..., tuple[bd.Model, Any]]:
    """pair(direction, bond): two bonded spheres of the set DP0, the bond's middle at the origin."""

    def make(direction: ArrayLike, bond: bd.Bond | None = None) -> tuple[bd.Model, Any]:
        n = np.asarray(direction, float) / np.linalg.norm(direction)
        return chain(2, direction, bond, -0.5 * DP0.length * n)

    return make


@pytest.fixture
def cluster() -> Callable[[], tuple[bd.Model, Any]]:
    """A sphere and its 12 neighbours of a face-centred cubic packing, skew to the axes: 36 bonds."""

    def make() -> tuple[bd.Model, Any]:
        inside = bd.Sphere(1.01 * DP0.length)
        spheres = bd.packing.fcc(DP0.length, inside, axis=(1.0, -2.0, 0.5), row=(2.0, 1.0, 3.0))
        model = bd.Model(spheres, density=DP0.density)
        return model, model.bond(model.touching(), bd.Bond(PARALLEL))

    return make


@pytest.fixture
def cloud() -> Callable[..., tuple[bd.Model, Any]]:
    """cloud(seed, turn): some forty spheres of random size at random places, bonded, with dashpots.

    turn: a matrix (3, 3) that the places are turned by.
    """

    def make(seed: int, turn: ArrayLike | None = None) -> tuple[bd.Model, Any]:
        random, d = np.random.default_rng(seed), DP0.length
        x = bd.packing.fcc(d, bd.Sphere(1.75 * d)).x
        x = x + random.uniform(-0.06 * d, 0.06 * d, x.shape)
        radius = random.uniform(0.42 * d, 0.5 * d, len(x))
        model = bd.Model(bd.packing.Particles(x if turn is None else x @ np.asarray(turn).T, radius), density=2000.0)
        bond = bd.Bond(bd.springs(DP0.kn, DP0.ks, DP0.kt, DP0.kb), damping=0.1)
        pairs = bd.Model(bd.packing.Particles(x, radius), density=2000.0).touching(gap=0.2)
        return model, model.bond(pairs, bond)

    return make


# Running --------------------------------------------------------------------------------------------------------


@pytest.fixture
def watch() -> Callable[..., Floats]:
    """watch(sim, look, samples, every): look(sim) now and after every so many steps."""

    def run(sim: bd.Simulation, look: Callable[[bd.Simulation], Any], samples: int, every: int = 1) -> Floats:
        seen = [look(sim)]
        for _ in range(samples):
            sim.run(steps=every, quiet=True)
            seen.append(look(sim))
        return np.array(seen)

    return run


@pytest.fixture
def relax() -> Callable[..., Any]:
    """relax(sim, held, load, held_turns): run until what is unbalanced is below 1e-8 of the load, and return particles.

    held, held_turns: particles whose displacements, rotations are held (by default the same); load [N], by default the
    largest force on any particle. A moment counts as a force at the distance of two neighbours. Fails where 10 000
    steps do not do it.
    """
    arm = DP0.length

    def run(
        sim: bd.Simulation,
        held: Iterable[int],
        load: float | None = None,
        held_turns: Iterable[int] | None = None,
        chunk: int = 50,
    ) -> Any:
        free, free_turns = (np.ones(len(sim.model), bool) for _ in range(2))
        free[list(held)] = False
        free_turns[list(held if held_turns is None else held_turns)] = False
        for _ in range(10_000 // chunk):
            sim.run(steps=chunk, quiet=True)
            p = sim.particles
            largest = load or max(np.abs(p.force).max(), np.abs(p.torque).max() / arm)
            left = max(np.abs(p.force[free]).max(), np.abs(p.torque[free_turns]).max() / arm)
            if left <= 1e-8 * largest:
                return p
        pytest.fail(f"still unbalanced by {left / largest:.2g} of the load after {sim.step} steps.")

    return run
