"""The runtime of the cuda engine without a GPU: what is copied and when, what fits, what is said when something fails.

A small class stands for the GPU's memory and runs kernels one thread after another (`cuda_on_cpu`); the driver is one
too. What the kernels compute is the business of `test_cuda_phases`, and of every test of engines where there is a GPU.
"""

import gc
import logging
import sys
import weakref
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from engines.cuda_on_cpu import kernel
from typer.testing import CliRunner

import pybondem as bd
from pybondem.assembly import assemble, energy_program, step_program
from pybondem.cli import app
from pybondem.engines import cuda, cuda_device, cuda_launch
from pybondem.engines.cuda import Cuda
from pybondem.engines.cuda_compile import missing
from pybondem.engines.cuda_device import Gpu
from pybondem.engines.cuda_launch import Device
from pybondem.engines.cuda_memory import Mirror, Rows
from pybondem.engines.cuda_text import Text
from pybondem.errors import EngineError, InputError, LawError
from pybondem.stability import Stiffness

GPU = Gpu("Test GPU", (8, 6), total=8 * 2**30, free=7 * 2**30, driver="590.10")
TABLES = {"velocity", "spin", "push", "push_torque"}
Driven = Callable[[], tuple[bd.Model, Any]]


class PlainDevice:
    """A GPU whose memory is NumPy arrays: notes what is copied, counts what it holds, has an end."""

    def __init__(self, gpu: Gpu) -> None:
        self.gpu, self.failed = gpu, None
        self.uploaded: list[Any] = []
        self.downloaded: list[Any] = []
        self.picks: list[tuple[int, ...]] = []
        self.held, self.faulty = 0, False
        made.append(self)

    def empty(self, shape: tuple[int, ...], dtype: Any) -> Any:
        there = np.full(shape, np.nan if np.dtype(dtype).kind == "f" else 2**31, dtype)
        self.held += there.nbytes
        weakref.finalize(there, self._give_back, there.nbytes)
        return there

    def _give_back(self, size: int) -> None:
        self.held -= size

    def upload(self, host: Any, there: Any) -> None:
        assert host.shape == there.shape
        assert host.dtype == there.dtype
        self.uploaded.append(host)
        there[...] = host

    def download(self, there: Any, host: Any) -> None:
        self.downloaded.append(host)
        host[...] = there

    def total(self, there: Any) -> float:
        return float(there.sum())

    def picked(self, there: Any, at: Any) -> Any:
        self.picks.append(there.shape[:-1] + at.shape)
        return there[..., at]

    def free(self) -> int:
        return self.gpu.free - self.held

    def kernel(self, text: Text, values: Sequence[Any], at_once: int | None) -> Any:
        """Return a launch on the CPU, one thread after another."""
        advance = kernel(text, compiled=False)

        def launch(steps: int, *values: Any) -> None:
            if self.faulty:
                raise EngineError("the GPU has failed.")
            advance(steps, 0, np.empty((6, text.threads)), *values)

        return launch


made: list[PlainDevice] = []


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], PlainDevice]]:
    """plain(): the device of the last engine that was made; engines take a plain one in this test."""
    monkeypatch.setattr(cuda, "usable", lambda: GPU)
    monkeypatch.setattr(cuda, "Device", PlainDevice)
    yield lambda: made[-1]
    made.clear()


@pytest.fixture
def driven(cluster: Any) -> Driven:
    """A cluster of 13 spheres with a strength and dashpots: one is held, one is driven, one is pushed."""

    def make() -> tuple[bd.Model, Any]:
        model, _ = cluster()
        own = bd.Model(bd.packing.Particles(model.x, model.radius), density=2500.0)
        bond = bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), bd.strength(tension=5e6, shear=3e6), damping=0.1)
        bonds = own.bond(own.touching(), bond)
        own.fix(own.select([0]))
        own.drive(own.select([5]), vx=0.5)
        own.push(own.select([9]), fy=3.0)
        return own, bonds

    return make


def names(sim: bd.Simulation, copied: list[Any]) -> list[str]:
    """Return the names of the fields among copied arrays, sorted; what is not a field of the simulation is a table."""
    groups = (sim.state.particles, sim.state.shared, *sim.state.bonds.values())
    known = {id(dict.__getitem__(group, name)): name for group in groups for name in group}
    return sorted(known.get(id(array), "table") for array in copied)


def looked_at(device: PlainDevice) -> None:
    """Forget what was copied so far."""
    device.uploaded.clear()
    device.downloaded.clear()
    device.picks.clear()


# Where the arrays are -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [None, bd.local(0.2), bd.kinetic(every=5)], ids=["none", "local", "kinetic"])
@pytest.mark.parametrize("variant", ["bonds", "half-bonds"])
def test_a_run_gives_what_other_engines_give(plain, driven, variant, damping):
    seen = []
    for engine in ("interpreted", Cuda(variant, threads=8)):
        model, bonds = driven()
        sim = bd.Simulation(model, engine=engine, damping=damping, gravity=(0.0, 0.0, -9.81))
        record = sim.record(every=10, broken=bd.broken(), book=bd.energy())
        sim.run(steps=25, quiet=True)
        with sim.edit("v", "w") as (v, w):
            v[:, 0] += 0.1
            w[:] *= 0.5
        sim.run(steps=20, quiet=True)
        p = sim.particles
        seen.append([p.x, p.q, p.v, p.w, p.force, p.torque, p.work, sim.bonds(bonds).energy])
        seen[-1] += [column.values for name, column in record.columns.items() if name != "energy_residual"]
    for mine, theirs in zip(*seen, strict=True):
        assert np.abs(mine - theirs).max() <= 1e-11 * max(np.abs(mine).max(), 1e-9)


def test_nothing_comes_back_until_it_is_looked_at_and_then_once(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    sim.run(steps=3, quiet=True)
    looked_at(plain())
    sim.run(steps=40, quiet=True)
    assert plain().downloaded == []
    assert set(names(sim, plain().uploaded)) == {"table"}
    before = sim.particles
    assert names(sim, plain().downloaded) == sorted(["x", "q", "v", "w", "force", "torque", "work"])
    assert np.array_equal(sim.particles.x, before.x)
    assert sim.broken == 0
    assert names(sim, plain().downloaded)[-3:] == ["w", "work", "x"]
    assert sorted(set(names(sim, plain().downloaded)) - {"x", "q", "v", "w", "force", "torque", "work"}) == ["damage"]


def test_of_what_is_recorded_of_some_particles_no_others_come_back(plain, driven):
    model, _ = driven()
    sim = bd.Simulation(model, engine=Cuda("half-bonds", threads=8))
    some = model.select([5, 9])
    record = sim.record(every=5, load=bd.reaction(some, "x"), moved=bd.displacement(some, "x"))
    sim.run(steps=5, quiet=True)
    looked_at(plain())
    sim.run(steps=10, quiet=True)
    assert plain().picks == [(3, 2)] * 4  # force and x, after 10 and 15 steps
    assert plain().downloaded == []
    p = sim.particles
    assert record.columns["moved"].values[-1] == pytest.approx((p.x - model.x)[[5, 9], 0].mean(), rel=1e-12)


def test_only_the_edited_field_goes_up(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    sim.run(steps=3, quiet=True)
    looked_at(plain())
    with sim.edit("v") as v:
        v[:] = 0.25
    assert set(names(sim, plain().uploaded)) == {"v", "table"}
    assert names(sim, plain().uploaded).count("v") == 1
    sim.run(steps=1, quiet=True)
    assert names(sim, plain().uploaded).count("v") == 1


def test_energies_of_bonds_come_back_alone_from_the_same_copies(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    sim.run(steps=30, quiet=True)
    looked_at(plain())
    energy = sim.bond_energy()
    assert [a is energy for a in plain().downloaded] == [True]
    assert plain().uploaded == []
    assert energy.sum() > 0.0


def test_the_linear_program_takes_what_the_host_has_set_and_gives_what_it_reads(plain, driven):
    model, _ = driven()
    sim = bd.Simulation(model, engine=Cuda("bonds", threads=8))
    stiffness, truth = Stiffness(sim.state, sim.engine), Stiffness(sim.state, bd.engines.reference.Reference())
    rng = np.random.default_rng(3)
    for _ in range(3):
        looked_at(plain())
        u = rng.normal(size=(6, len(model)))
        forces = truth.all_forces(u)
        assert np.abs(stiffness.all_forces(u) - forces).max() <= 1e-12 * np.abs(forces).max()
    assert [len(plain().uploaded), len(plain().downloaded)] == [2, 2]  # v and w; force and torque


def test_gpu_memory_is_given_back_with_the_simulation(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    sim.run(steps=2, quiet=True)
    assert sim.energies.strain > 0.0
    assert plain().held > 0
    del sim
    gc.collect()
    assert plain().held == 0


def test_a_look_while_the_host_is_newer_keeps_what_the_host_has(plain):
    device = PlainDevice(GPU)
    mirror, host = Mirror(device), np.arange(6.0).reshape(2, 3)
    there = mirror.copy_of(host)
    mirror.written(host)
    there += 1.0
    assert mirror.total(host) == 21.0
    assert np.array_equal(mirror.picked(host, np.array([2, 0])), [[3.0, 1.0], [6.0, 4.0]])
    assert mirror.picked(host, np.array([], int)).shape == (2, 0)
    assert host.sum() == 15.0
    mirror.fetch(host)
    host[:] = -1.0
    mirror.changed(host)
    mirror.fetch(host)
    assert mirror.total(host) == -6.0
    assert np.array_equal(mirror.picked(host, np.array([1])), [[-1.0], [-1.0]])
    assert device.picks == [(2, 2)]
    assert mirror.copy_of(host).sum() == -6.0
    assert mirror.missing([host, np.zeros(4), host]) == 32


def test_room_for_tables_grows_and_is_used_again(plain):
    device = PlainDevice(GPU)
    rows = Rows(device)
    first = rows.for_table(np.zeros((9, 3, 2)))
    assert np.shares_memory(rows.for_table(np.zeros((4, 3, 2))), first)
    assert rows.for_table(np.zeros((4, 3, 2))).shape == (4, 3, 2)
    del first
    assert rows.for_table(np.zeros((20, 3, 2))).shape == (20, 3, 2)
    assert device.held == 20 * 6 * 8


# What goes wrong ------------------------------------------------------------------------------------------------


def test_too_little_memory_names_both_numbers_and_leaves_the_model_usable(plain, driven, monkeypatch):
    model, _ = driven()
    small = GPU._replace(free=cuda.LEFT_FREE + 2000)
    monkeypatch.setattr(cuda, "usable", lambda: small)
    with pytest.raises(EngineError, match=r"Test GPU is full: [\d,]+ bytes are needed and 67,110,864 bytes are free"):
        bd.Simulation(model, engine=Cuda("bonds", threads=8))
    assert plain().uploaded == []
    assert plain().held == 0
    bd.Simulation(model, engine="reference").run(steps=5, quiet=True)


def test_a_program_that_fits_no_more_leaves_the_running_one_alone(plain, driven):
    model, bonds = driven()
    sim = bd.Simulation(model, engine=Cuda("bonds", threads=8))
    sim.run(steps=5, quiet=True)
    x = sim.particles.x
    plain().gpu = GPU._replace(free=plain().held)
    with pytest.raises(EngineError, match="is full"):
        Stiffness(sim.state, sim.engine)
    sim.run(steps=5, quiet=True)
    assert not np.array_equal(sim.particles.x, x)
    assert np.isfinite(sim.bonds(bonds).force).all()


def test_what_fails_halfway_leaves_nothing_behind(plain, driven, monkeypatch):
    model, _ = driven()
    sim = bd.Simulation(model, engine=Cuda("bonds", threads=8))
    held, room, left = plain().held, PlainDevice.empty, 4

    def fill(self: PlainDevice, shape: tuple[int, ...], dtype: Any) -> Any:
        nonlocal left
        left -= 1
        if left < 0:
            raise EngineError("the GPU is full.")
        return room(self, shape, dtype)

    monkeypatch.setattr(PlainDevice, "empty", fill)
    model = driven()[0]  # other arrays than those that are there
    done = assemble(model)
    program = step_program(done, (0.0, 0.0, 0.0), None)
    for left in range(12):  # noqa: B007  in the private arrays, and among the copies
        with pytest.raises(EngineError, match="is full"):
            sim.engine.prepare(program)
        assert gc.collect() >= 0
        assert plain().held == held
    assert left < 0
    monkeypatch.undo()
    sim.run(steps=3, quiet=True)


def test_memory_that_only_a_cycle_holds_is_given_back_before_a_refusal(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    engine, model = sim.engine, driven()[0]
    gc.disable()
    try:
        sim.itself = sim  # type: ignore[attr-defined]
        plain().gpu = GPU._replace(free=2 * plain().held + cuda.LEFT_FREE)  # for one, which takes more as it is made
        del sim
        bd.Simulation(model, engine=engine).run(steps=2, quiet=True)
    finally:
        gc.enable()


def test_a_fault_names_the_steps_it_was_in(plain, driven):
    sim = bd.Simulation(driven()[0], engine=Cuda("bonds", threads=8))
    sim.run(steps=7, quiet=True)
    plain().faulty = True
    with pytest.raises(EngineError, match=r"^in steps 8 to 8 the GPU has failed\.$"):
        sim.run(steps=4, quiet=True)


class CudaAPIError(Exception):
    """Named as numba-cuda's."""


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Device]:
    """failing(message, number): a real device under which every call of the driver fails; number: of the GPU in use."""

    def make(message: str, number: int = 0) -> Device:
        def fail(*_: Any) -> Any:
            raise CudaAPIError(message)

        memory, pending = SimpleNamespace(free=1234), SimpleNamespace(deallocations=SimpleNamespace(clear=list))
        context = SimpleNamespace(
            device=SimpleNamespace(id=number), memory_manager=pending, get_memory_info=lambda: memory
        )
        calls = dict.fromkeys(("device_array", "synchronize", "jit"), fail)
        monkeypatch.setattr(numba, "cuda", SimpleNamespace(**calls, current_context=lambda: context), raising=False)
        return Device(GPU)

    return make


def test_a_full_gpu_is_no_fault(failing):
    device = failing("[2] Call to cuMemAlloc results in CUDA_ERROR_OUT_OF_MEMORY")
    with pytest.raises(EngineError, match=r"Test GPU is full: 240 bytes are needed and 1,234 bytes are free of 8,58"):
        device.empty((3, 10), np.float64)
    assert device.failed is None


def test_another_gpu_than_the_one_that_was_asked_is_refused(failing):
    device = failing("[2] CUDA_ERROR_OUT_OF_MEMORY", number=1)
    for ask in (device.free, lambda: device.empty((3,), np.float64), lambda: device.upload(np.zeros(3), None)):
        with pytest.raises(EngineError, match=r"runs on GPU 0 \(Test GPU\), and cuda\.select_device\(1\) has chosen"):
            ask()
    assert device.failed is None


def test_after_a_fault_every_call_says_that_the_state_is_lost(failing):
    device = failing("[700] Call to cuMemcpyDtoH results in CUDA_ERROR_ILLEGAL_ADDRESS\n")
    said = r"GPU Test GPU has failed \(\[700\] Call to cuMemcpyDtoH results in CUDA_ERROR_ILLEGAL_ADDRESS\) and what it"
    with pytest.raises(EngineError, match=said) as first:
        device.empty((3,), np.float64)
    assert "the last record or checkpoint written is valid" in str(first.value)
    for ask in (device.free, lambda: device.upload(np.zeros(3), None), lambda: device.download(None, np.zeros(3))):
        with pytest.raises(EngineError) as again:
            ask()
        assert str(again.value) == str(first.value)


class nvJitLinkError(Exception):
    """Named as the linker's."""


def test_what_the_linker_refuses_is_said_in_a_sentence(failing, monkeypatch):
    def refuse(*_: Any) -> Any:
        raise nvJitLinkError("ERROR_PTX_COMPILE\n Linker error log: unsupported toolchain")

    device = failing("")
    monkeypatch.setattr(cuda_launch, "fitting", refuse)
    with pytest.raises(
        EngineError, match=r"^no kernel can be built for Test GPU: ERROR_PTX_COMPILE Linker error log: uns"
    ):
        device.kernel(None, [], None)  # type: ignore[arg-type]
    assert device.failed is None


def test_an_error_of_our_own_is_not_taken_for_one_of_the_driver(failing):
    device = failing("")
    with pytest.raises(AttributeError):
        device.upload(np.zeros(3), None)
    assert device.failed is None


def test_too_many_threads_are_refused(plain):
    with pytest.raises(InputError, match=r"^threads of the engine cuda is 2048; it must not exceed 1024"):
        Cuda(threads=2048)


def test_a_variant_that_there_is_not_is_refused(plain):
    with pytest.raises(InputError, match="variant of the engine cuda"):
        Cuda("bond")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("capability", "variant"), [((9, 0), "half-bonds"), ((8, 0), "half-bonds"), ((8, 9), "bonds"), ((12, 0), "bonds")]
)
def test_the_variant_is_chosen_by_the_rate_of_double_precision(plain, monkeypatch, capability, variant):
    monkeypatch.setattr(cuda, "usable", lambda: GPU._replace(capability=capability))
    assert Cuda().variant == variant
    assert Cuda("bonds").variant == "bonds"


# The driver -----------------------------------------------------------------------------------------------------


class PlainDriver:
    """A driver's library: what it would write where it is told to."""

    def __init__(self, count: int = 1, cuda: int = 13000, capability: tuple[int, int] = (9, 0), start: int = 0) -> None:
        self._count, self._cuda, self._capability, self._start = count, cuda, capability, start
        self.pushed, self.deaf = 0, False

    def cuInit(self, flags: int) -> int:
        return self._start

    def cuGetErrorName(self, code: int, name: Any) -> int:
        name._obj.value = {803: b"CUDA_ERROR_SYSTEM_DRIVER_MISMATCH"}[code]
        return 0

    def cuDeviceGetCount(self, count: Any) -> int:
        return self._write(count, self._count)

    def cuDeviceGet(self, device: Any, number: int) -> int:
        return self._write(device, number)

    def cuDeviceGetName(self, name: Any, size: int, device: int) -> int:
        name.value = b"NVIDIA H100"
        return 0

    def cuDeviceGetAttribute(self, value: Any, which: int, device: int) -> int:
        return self._write(value, self._capability[which - 75])

    def cuDriverGetVersion(self, version: Any) -> int:
        return self._write(version, self._cuda)

    def cuDevicePrimaryCtxRetain(self, context: Any, device: int) -> int:
        return 0

    def cuDevicePrimaryCtxRelease_v2(self, device: int) -> int:
        return 0

    def cuCtxPushCurrent_v2(self, context: Any) -> int:
        self.pushed += 1
        return 0

    def cuCtxPopCurrent_v2(self, context: Any) -> int:
        self.pushed -= 1
        return 0

    def cuMemGetInfo_v2(self, free: Any, total: Any) -> int:
        if self.deaf:
            return 803
        assert self.pushed == 1  # it is asked of the current context
        self._write(total, 80 * 2**30)
        return self._write(free, 76 * 2**30)

    @staticmethod
    def _write(where: Any, value: int) -> int:
        where._obj.value = value
        return 0

    # The library for the management of GPUs, which knows the driver's version.

    def nvmlInit_v2(self) -> int:
        return 0

    def nvmlSystemGetDriverVersion(self, text: Any, size: int) -> int:
        text.value = {12040: b"550.54.15"}.get(self._cuda, b"580.65.06")
        return 0


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Callable[..., PlainDriver]:
    """driver(count, cuda, capability, start): this machine has such a driver, and the cuda extra."""
    monkeypatch.delenv("NUMBA_ENABLE_CUDASIM", raising=False)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.setattr(cuda_device, "missing", lambda: None)
    monkeypatch.setattr(sys, "platform", "linux")

    def install(**options: Any) -> PlainDriver:
        library = PlainDriver(**options)
        monkeypatch.setattr(cuda_device, "_library", lambda windows, linux: library)
        return library

    return install


def test_the_gpu_is_what_the_driver_says(driver):
    library = driver()
    assert cuda_device.usable() == Gpu("NVIDIA H100", (9, 0), 80 * 2**30, 76 * 2**30, "580.65.06")
    assert library.pushed == 0


def test_a_driver_that_does_not_tell_of_memory_is_no_gpu_without_memory(driver):
    library = driver()
    library.deaf = True
    with pytest.raises(EngineError, match="the NVIDIA driver does not answer: CUDA_ERROR_SYSTEM_DRIVER_MISMATCH"):
        cuda_device.gpu()
    assert library.pushed == 0


def test_info_never_takes_the_simulator_for_a_gpu(driver, monkeypatch):
    driver()
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    assert cuda_device.described().startswith("none: NUMBA_ENABLE_CUDASIM is set")


def no_library(windows: str, linux: str) -> Any:
    raise OSError


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (None, "there is no NVIDIA driver on this machine (libcuda was not found)."),
        ({"start": 100}, "the NVIDIA driver sees no GPU on this machine."),
        ({"count": 0}, "the NVIDIA driver sees no GPU on this machine."),
        ({"start": 803}, "the NVIDIA driver does not start: CUDA_ERROR_SYSTEM_DRIVER_MISMATCH."),
        ({"cuda": 12040}, "driver 550.54.15 (CUDA 12.4) is too old: CUDA 13.0 needs driver 580 or newer."),
        ({"capability": (7, 0)}, "NVIDIA H100 has compute capability 7.0: CUDA 13.0 needs 7.5 or more."),
    ],
)
def test_what_keeps_a_gpu_from_being_used_is_named(driver, monkeypatch, options, said):
    driver(**(options or {}))
    if options is None:
        monkeypatch.setattr(cuda_device, "_library", no_library)
    with pytest.raises(EngineError) as refused:
        Cuda()
    assert str(refused.value).startswith("the engine cuda cannot run: ")
    assert said in str(refused.value)


def test_a_hidden_gpu_a_missing_extra_and_the_simulator_are_named(driver, monkeypatch):
    driver(start=100)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    with pytest.raises(EngineError, match=r"no GPU on this machine; CUDA_VISIBLE_DEVICES is ''\."):
        cuda_device.usable()
    driver()
    monkeypatch.setattr(cuda_device, "missing", lambda: "the cuda extra is not installed: pip install pybondem[cuda]")
    with pytest.raises(EngineError, match=r"NVIDIA H100 cannot be used: the cuda extra is not installed: pip install"):
        cuda_device.usable()
    monkeypatch.setenv("NUMBA_ENABLE_CUDASIM", "1")
    with pytest.raises(EngineError, match="NUMBA_ENABLE_CUDASIM is set"):
        cuda_device.usable()


def test_there_is_no_silent_way_to_the_cpu(driver, driven):
    driver(count=0)
    with pytest.raises(EngineError, match="sees no GPU"):
        bd.Simulation(driven()[0], engine="cuda")


def test_info_says_which_gpu_there_is_and_what_fits(driver):
    driver()
    said = next(line for line in CliRunner().invoke(app, ["info"]).stdout.splitlines() if line.startswith("GPU"))
    start, _, fits = said.partition(": about ")
    assert start.split(maxsplit=1)[1] == "NVIDIA H100, driver 580.65.06, 76 GiB of 80 GiB free"
    millions = float(fits.split()[0])
    assert 30.0 < millions < 90.0
    driver(cuda=12040)
    assert "it cannot be used: the NVIDIA driver 550.54.15 (CUDA 12.4) is too old" in cuda_device.described()
    driver(count=0)
    assert cuda_device.described() == "none: the NVIDIA driver sees no GPU on this machine"


@pytest.mark.parametrize("variant", ["bonds", "half-bonds"])
def test_what_fits_is_told_from_what_is_taken(plain, variant):
    grains = bd.packing.hcp(1e-2, inside=bd.Cylinder(radius=10e-2, height=0.6), axis="z")
    rod = bd.Model(grains, density=2500.0)
    bonds = rod.bond(rod.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), damping=0.1))
    done = assemble(rod)
    engine = Cuda(variant)
    runners = [
        engine.prepare(make(done)) for make in (lambda d: step_program(d, (0.0, 0.0, 0.0), None), energy_program)
    ]
    taken = (plain().held + 8 * len(bonds.pairs)) / len(rod)  # room for the energies is made at the first look
    told = cuda_device.bytes_per_particle(variant)
    assert told == pytest.approx(taken * 6.0 * len(rod) / len(bonds.pairs), rel=0.06)  # bonds are most of it
    assert told > taken
    assert len(runners) == 2


# With the compiler of the cuda extra ----------------------------------------------------------------------------

needs_compiler = pytest.mark.skipif(missing() is not None, reason=f"no compiler for GPUs: {missing()}")


@needs_compiler
def test_free_memory_is_told_after_arrays_are_given_back(monkeypatch):
    """In the context that numba-cuda keeps, where an array that nobody holds waits to be given back."""
    from numba.cuda.cudadrv import driver

    monkeypatch.setattr(
        driver, "_logger", logging.getLogger("numba.cuda"), raising=False
    )  # made with the first context
    context = driver.Context(SimpleNamespace(id=0), None)
    waiting, memory = [24, 8], context.memory_manager
    memory.deallocations.memory_capacity = GPU.total
    for size in waiting:
        memory.deallocations.add_item(waiting.remove, size, size)
    monkeypatch.setattr(memory, "get_memory_info", lambda: SimpleNamespace(free=GPU.free - sum(waiting)))
    monkeypatch.setattr(numba.cuda, "current_context", lambda: context)
    assert Device(GPU).free() == GPU.free


@needs_compiler
def test_a_law_that_no_gpu_can_run_is_refused_with_its_own_line(plain, driven, monkeypatch):
    @bd.damage_law(parameters={"rate": "1/m"}, memory={"longest": "m"})
    def listed(d: Any, m: Any, p: Any) -> Any:
        """A law with what neither compiler takes."""
        longest = bd.maximum(m.longest, d.opening)
        return {"damage": p.rate * longest}["damage"] * 0.0, longest

    def refuse(self: Any, text: Text, values: Any, at_once: int | None) -> Any:
        if "b0_m_longest" in text.arguments:
            raise AttributeError("build_map")
        return taken(self, text, values, at_once)

    taken = PlainDevice.kernel
    monkeypatch.setattr(PlainDevice, "kernel", refuse)
    model, _ = driven()
    own = bd.Model(bd.packing.Particles(model.x, model.radius), density=2500.0)
    own.bond(own.touching(), bd.Bond(bd.parallel(E=1e9, stiffness_ratio=2.0), listed(rate=1.0)))
    with pytest.raises(LawError, match=r"listed cannot .*test_cuda_runtime\.py, line \d+.*reference and interpreted"):
        bd.Simulation(own, engine=Cuda("bonds", threads=8), dt=1e-9)
