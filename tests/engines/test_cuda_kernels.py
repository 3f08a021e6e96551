"""Every published law through NVIDIA's compiler as a whole kernel, without a GPU: registers, spills, double precision.

Skips where the cuda extra is not installed. `pytest -s` prints what each kernel needs.
"""

import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest

import pybondem as bd
from pybondem.engines import cuda_compile
from pybondem.engines.cuda_compile import argument_types, compile_kernel, missing
from pybondem.engines.cuda_launch import compiled
from pybondem.engines.cuda_text import stage_text
from pybondem.errors import EngineError

MISSING = missing()
needs_compiler = pytest.mark.skipif(MISSING is not None, reason=f"no compiler for GPUs: {MISSING}")
BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
MOST_SPILLS = 32  # bytes; none at all depends on the toolkit
CAPABILITIES = [(8, 0), (9, 0), (10, 0)]
FEW = ("elastic", "plastic_slip")  # no law, and the one that needs most
variants = pytest.mark.parametrize("variant", ["bonds", "half-bonds"])


def some(laws: Any) -> list[Any]:
    """Return laws and capabilities as parameters of a test, all but a few of them marked as slow."""
    every = [(law, capability) for law in laws for capability in CAPABILITIES]
    quick = {(law, (9, 0)) for law in FEW} | {("plastic_slip", capability) for capability in CAPABILITIES}
    return [pair if pair in quick else pytest.param(*pair, marks=pytest.mark.slow) for pair in every]


@pytest.fixture(scope="module")
def gpu_compile() -> Any:
    """The module that compiles kernels for the benchmarks."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        import gpu_compile  # type: ignore[import-not-found]
    finally:
        sys.path.remove(str(BENCHMARKS))
    assert isinstance(gpu_compile, types.ModuleType)
    return gpu_compile


@bd.damage_law(parameters={"peak": "m", "viscosity": "s"}, memory={"longest": "m"})
def users(d, m, p, rate, dt):
    """A law of a user, with words that are not plain arithmetic."""
    longest = bd.maximum(m.longest, d.slip) + dt * rate.slip * bd.where(rate.opening > 0.0, 0.1, 0.0)
    return 1.0 - bd.exp(-bd.power(longest / p.peak, 1.5)) / bd.sqrt(1.0 + p.viscosity * rate.slip / d.length), longest


def hold_to_limits(found: Any) -> None:
    """Hold what a kernel needs to what a multiprocessor has."""
    if found.registers is None:
        pytest.skip("ptxas was not found: registers and spills are not known")
    assert found.registers * found.bounds[0] * found.bounds[1] <= 65536
    assert found.spills < MOST_SPILLS
    assert found.bounds[0] * found.bounds[1] >= 256  # of 2048: fewer could not wait for memory


@needs_compiler
@variants
@pytest.mark.parametrize(("law", "capability"), some(["elastic", *bd.laws.__all__]))
def test_a_cuda_kernel_with_each_law_fits_into_registers(gpu_compile, law, capability, variant):
    found = gpu_compile.needs(law, variant, capability)
    print("\n" + gpu_compile.line(found), end="")
    hold_to_limits(found)


@needs_compiler
@variants
@pytest.mark.parametrize("capability", CAPABILITIES)
def test_a_cuda_kernel_with_a_users_law_is_one_cooperative_kernel_in_doubles(gpu_compile, variant, capability):
    text = gpu_compile.VARIANTS[variant](gpu_compile.program(users(peak=1e-5, viscosity=1e-3)))
    made = compile_kernel(text, capability)
    assert made.ptx.count(".entry") == 1
    assert len(re.findall(r"call[^;]*cudaCGSynchronize", made.ptx)) == MEETINGS[variant].count("GRID")
    # Double precision throughout, but for the exponential, which looks at its argument's upper half as a float.
    assert not re.search(r"\b(add|sub|mul|fma|div|sqrt|rcp|ex2|lg2)\.\S*f32", made.ptx)
    # A copy of the loop over half-bonds might be contracted in another way, and both sides of a bond then not agree.
    assert len(re.findall(r"\bbar(rier)?\.(cta\.)?sync\b", made.ptx)) == (2 if variant == "half-bonds" else 0)
    shared = sum(int(n) for n in re.findall(r"\.shared .*\[(\d+)\]", made.ptx))
    assert shared == (6 * 128 * 8 if variant == "half-bonds" else 0)
    assert f".maxntid {text.threads}" in made.ptx
    if made.spills is not None:
        assert made.spills < MOST_SPILLS


@needs_compiler
def test_a_cuda_kernel_at_other_bounds_needs_what_it_does_compiled_for_them(gpu_compile):
    text = gpu_compile.VARIANTS["half-bonds"](gpu_compile.program(gpu_compile.published()["plastic_slip"]))
    loose, tight = (compile_kernel(text, (9, 0), (text.threads, blocks)) for blocks in (1, 3))
    assert cuda_compile.at_bounds(loose, 3)[1:] == tight[1:]
    assert tight.registers is None or tight[1:] != loose[1:]
    with pytest.raises(AssertionError, match="without a number of blocks"):
        cuda_compile.at_bounds(compile_kernel(text), 3)


MEETINGS = {  # what the kernel calls, and where a block (BLOCK) or the whole grid (GRID) waits for itself
    "bonds": "begin pack1 GRID bonds1 GRID turn GRID unpack unpack1 GRID",
    "half-bonds": "begin pack_bonds GRID evaluate BLOCK turn BLOCK GRID unpack unpack_bonds GRID",
}


@variants
def test_a_cuda_kernel_meets_between_its_phases(gpu_compile, variant):
    """The runs of the phases on the CPU wait of themselves: only the kernel's own text shows that it does."""
    text = gpu_compile.VARIANTS[variant](gpu_compile.program(users(peak=1e-5, viscosity=1e-3)))
    kernel = text.source[text.source.index("def advance") :]
    words = {"grid.sync": "GRID", "cuda.syncthreads": "BLOCK"}
    calls = [words.get(name, name) for name in re.findall(r"^ +([\w.]+)\(", kernel, re.MULTILINE)]
    assert " ".join(calls) == MEETINGS[variant]


@needs_compiler
def test_a_cuda_kernel_of_each_program_compiles(gpu_compile):
    """The energy book and the model's own stiffness, which have no start and no end of a step."""
    from pybondem.assembly import assemble, energy_program, linear_program

    model = bd.Model(bd.packing.line(3, spacing=1e-2, direction=(1, 2, 3), diameter=1e-2), density=2500.0)
    model.bond([[0, 1], [1, 2]], bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0)))
    for program in (energy_program(assemble(model)), linear_program(assemble(model))):
        made = compile_kernel(stage_text(program))
        assert made.ptx.count(".entry") == 1
        assert made.spills in (0, None)


@needs_compiler
def test_a_cuda_kernel_is_made_once(gpu_compile, tmp_path, monkeypatch):
    monkeypatch.setenv("PYBONDEM_CACHE", str(tmp_path))
    text = stage_text(gpu_compile.program(None))
    again = stage_text(gpu_compile.program(None))
    assert compiled(text) is compiled(again)
    assert compiled(text) is not compiled(again._replace(threads=64))
    assert compiled(text) is not compiled(text, at_once=2)
    assert len(list(argument_types(text))) == 1 + len(text.arguments) + len(text.private)


def test_a_cuda_kernel_needs_the_extra(monkeypatch, gpu_compile):
    monkeypatch.setattr(cuda_compile, "missing", lambda: "the cuda extra is not installed")
    with pytest.raises(EngineError, match="cannot be compiled for a GPU: the cuda extra is not installed"):
        compile_kernel(stage_text(gpu_compile.program(None)))
