"""Kernels up to the call that hands them to the driver, on a machine without one: compiled, linked, kept, launched.

What asks for a device gets a stand-in, in a process of its own; numba-cuda does the rest as it would on an H100. Skips
where the cuda extra is not installed.
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pybondem.engines.cuda_compile import missing
from pybondem.engines.cuda_launch import most_at_once

pytestmark = pytest.mark.skipif(missing() is not None, reason=f"no compiler for GPUs: {missing()}")

STAND_IN = """
import contextlib, ctypes
from types import SimpleNamespace
import numpy as np
import pybondem as bd
from pybondem.assembly import assemble, step_program
from pybondem.engines import cuda, cuda_compile, cuda_launch
from pybondem.engines.cuda_device import Gpu
from pybondem.engines.cuda_half_bonds import half_bond_text
from pybondem.engines.cuda_text import stage_text
import numba.cuda
from numba.cuda import codegen, dispatcher
from numba.cuda.cudadrv import devices, driver
from numba.cuda.cudadrv.devicearray import DeviceNDArray

h100 = SimpleNamespace(compute_capability=(9, 0), id=0, MULTIPROCESSOR_COUNT=132)
context = SimpleNamespace(device=h100, get_active_blocks_per_multiprocessor=lambda function, threads, memory: 2)
dispatcher.get_current_device = lambda: h100
dispatcher.get_context = devices.get_context = numba.cuda.current_context = lambda *_: context
devices._runtime.ensure_context = contextlib.nullcontext
dispatcher._Kernel.bind = lambda kernel: kernel._codelibrary.get_cubin()

rod = bd.Model(bd.packing.hcp(1e-2, inside=bd.Cylinder(RADIUS, 0.1), axis="z"), density=2500.0)
law = bd.strength(tension=5e6, shear=3e6)
rod.bond(rod.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), law, damping=0.1))
done = assemble(rod)
program = step_program(done, (0.0, 0.0, -9.81), None)
"""

KEEP = """
text = stage_text(program)
kernel = cuda_launch.compiled(text)
made = kernel.compile(tuple(cuda_compile.argument_types(text)))
print(sum(kernel._cache_hits.values()), sum(kernel._cache_misses.values()), made.cooperative)
"""

FRAMES = """
import struct
kernel = cuda_launch.compiled(half_bond_text(program), 3)
cubin = kernel.compile(tuple(cuda_compile.argument_types(half_bond_text(program))))._codelibrary.get_cubin().code

def told(attribute):  # of each function, by its symbol: see EIATTR_REGCOUNT, EIATTR_FRAME_SIZE of an ELF for CUDA
    found, at = {}, -1
    while (at := cubin.find(bytes([4, attribute, 8, 0]), at + 1)) >= 0:
        symbol, size = struct.unpack("<II", cubin[at + 4 : at + 12])
        found[symbol] = size
    return found

registers = told(0x2F)
kernel = max(registers, key=registers.get)
print(registers[kernel], told(0x11)[kernel])
"""

LAUNCH = """
class Pointer:
    device_ctypes_pointer = ctypes.c_void_p(4096)

    def view(self, *_):
        return self

class Memory(cuda_launch.Device):
    def empty(self, shape, dtype):
        return DeviceNDArray(shape, np.empty(shape, dtype).strides, np.dtype(dtype), gpu_data=Pointer())

    def free(self):
        return 2**33

    def upload(self, host, there):
        assert host.shape == there.shape, (host.shape, there.shape)

gpu = Gpu("H100", (9, 0), 2**33, 2**33, "580")
cuda.usable, cuda.Device, numba.cuda.synchronize = lambda: gpu, Memory, lambda: None
driver._to_core_stream = lambda stream: stream
def linked(library):
    blocks = next(n for n in (3, 2, 1) if n == 1 or f".minnctapersm {n}" in library.get_asm_str())
    return SimpleNamespace(kernel=None, name="advance", attrs=SimpleNamespace(local=LOCAL[3 - blocks]))

codegen.CUDACodeLibrary.get_cufunc = linked
dispatcher.LaunchConfig = lambda **given: given
launches = []
dispatcher.launch = lambda stream, config, kernel, *arguments: launches.append((config, arguments))
engine = cuda.Cuda(VARIANT)
runner = engine.prepare(program)
for steps in (1, 2, 900, 5):
    runner.advance(steps, 1e-7, done.tables.schedule(0, steps, 1e-7))
for config, arguments in launches:
    print(config["is_cooperative"], config["grid"][0], config["block"][0], arguments[0].value)
print(runner._text.blocks, [len(kernel.overloads) for kernel in cuda_launch._KERNELS.values()])
"""

AS_NUMBA_DOES = """
import warnings
warnings.simplefilter("ignore")  # a small grid
ours = launches[-1]
prepared = runner._launch.__closure__[[c for c in runner._launch.__code__.co_freevars].index("started")].cell_contents
(kernel,) = cuda_launch._KERNELS.values()
kernel[ours[0]["grid"], ours[0]["block"]](*prepared._values)
plain = [[getattr(word, "value", word) for word in words] for _, words in (ours, launches[-1])]
assert len(launches) == 5 and plain[0] == plain[1] and ours[0] == launches[-1][0]
"""

MOVED = """
def absent(name):
    raise ImportError(name)

cuda_launch.import_module = absent
"""

SMALL_KERNELS = """
from numba import float64, int64
found = float64[:, ::1], int64[::1], float64[:, ::1]
for launches, kinds in ((cuda_launch.strided_sums(), (float64[::1],) * 2), (cuda_launch.picking(), found)):
    print(len(launches.dispatcher.compile(kinds)._codelibrary.get_cubin().code) > 0)
"""


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[list[str]]]:
    """said(script, values): the words of each line that a script prints after the stand-in, with a cache of its own."""
    monkeypatch.setenv("PYBONDEM_CACHE", str(tmp_path))

    def run(script: str, **values: object) -> list[list[str]]:
        given = "".join(f"{name} = {value!r}\n" for name, value in values.items())
        done = subprocess.run([sys.executable, "-c", given + STAND_IN + script], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert not done.stderr
        return [line.split() for line in done.stdout.splitlines()]

    return run


def test_kernels_that_are_no_step_compile(said):
    assert said(SMALL_KERNELS, RADIUS=6e-3) == [["True"], ["True"]]


def test_a_compiled_kernel_is_found_on_disk_by_the_next_process(said):
    assert [said(KEEP, RADIUS=6e-3) for _ in range(2)] == [[["0", "1", "True"]], [["1", "0", "True"]]]


@pytest.mark.parametrize("variant", ["bonds", "half-bonds"])
def test_one_cooperative_launch_for_any_number_of_steps_and_one_kernel_for_all(said, variant):
    """Its arguments are those that numba-cuda itself hands to the driver, those of earlier launches among them."""
    *launches, (blocks, *kernels) = said(LAUNCH + AS_NUMBA_DOES, RADIUS=2e-2, VARIANT=variant, LOCAL=[16])
    assert launches == [["True", blocks, "128", steps] for steps in ("1", "2", "900", "5")]
    assert 1 < int(blocks) < 264
    assert kernels == ["[1]"]


def test_no_more_blocks_are_launched_than_the_gpu_holds_at_once(said):
    *launches, (blocks, *_) = said(LAUNCH, RADIUS=0.2, VARIANT="bonds", LOCAL=[0])
    assert int(blocks) > 264
    assert {grid for _, grid, _, _ in launches} == {"264"}  # two on each of 132 multiprocessors


def test_where_names_of_numba_have_moved_its_own_launches_do(said):
    *launches, (blocks, *kernels) = said(MOVED + LAUNCH, RADIUS=2e-2, VARIANT="bonds", LOCAL=[16])
    assert launches == [["True", blocks, "128", steps] for steps in ("1", "2", "900", "5")]
    assert kernels == ["[1]"]


def test_a_kernel_that_spills_is_compiled_for_fewer_threads_at_once(said):
    """For as many as add nothing to what is in memory at the loosest bound."""
    *_, (_, *kernels) = said(LAUNCH, RADIUS=6e-3, VARIANT="half-bonds", LOCAL=[100, 80, 48])
    assert " ".join(kernels) == "[1, 1, 1]"


@pytest.mark.parametrize(
    ("outside", "blocks", "compiled"),
    [
        ({3: 16}, 3, [3]),  # of the calls where blocks meet
        ({3: 900, 1: 900}, 3, [3, 1]),  # a frame, and no spills
        ({3: 100, 2: 48, 1: 48}, 2, [3, 1, 2]),
        ({3: 100, 2: 56, 1: 48}, 1, [3, 1, 2]),
    ],
)
def test_spills_are_what_a_bound_adds_to_the_loosest(outside, blocks, compiled):
    asked = []
    assert most_at_once(128, lambda n: asked.append(n) or outside[n]) == blocks  # type: ignore[func-returns-value]
    assert list(dict.fromkeys(asked)) == compiled
    assert most_at_once(128, outside.__getitem__, at_once=5) == 5


def test_the_linked_kernel_of_an_elastic_step_has_384_threads_on_a_multiprocessor_without_spills(said):
    ((registers, frame),) = said(FRAMES, RADIUS=6e-3)
    assert 384 * int(registers) <= 65536
    assert int(frame) <= 16
