"""Which GPU there is, what fits into it, and why none can be used: asked of NVIDIA's driver, without Numba.

Nothing here needs the cuda extra, and nothing fails where there is neither a driver nor a GPU.
"""

import ctypes
import os
import sys
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from pybondem.engines.cuda_compile import Capability, missing
from pybondem.errors import EngineError
from pybondem.state import BOND_FIELDS, ENERGY, LOAD, PARTICLE_FIELDS, Field

NEEDED_CUDA, NEEDED_DRIVER = (13, 0), "580"  # of the toolkit in the cuda extra, and the first driver that runs it
LEAST_CAPABILITY = (7, 5)  # that this toolkit compiles for
FIRST = 0  # number of the GPU, among those that are seen
NO_DEVICE = 100  # CUDA_ERROR_NO_DEVICE
BONDS_PER_PARTICLE = 6  # of a close packing
INDEX = 4  # bytes
SEEN, KEPT, TOLD = (
    16 * 8,
    7 * 8,
    6 * 8,
)  # bytes of what neighbours read of a particle, of what else it hands on, of sums
HALF_RATE = {(8, 0), (9, 0), (10, 0)}  # GPUs that compute at half speed in double precision; others at 1/32 or 1/64
GIB = 2.0**30

Variant = Literal["bonds", "half-bonds"]


class Gpu(NamedTuple):
    """A GPU: its name, what it can do ((9, 0) for an H100), its memory and what of it is free [bytes], its driver."""

    name: str
    capability: Capability
    total: int
    free: int
    driver: str


# Asking the driver ----------------------------------------------------------------------------------------------


def _library(windows: str, linux: str) -> Any:
    """Return one of the libraries that come with NVIDIA's driver; raises OSError where it is not there."""
    return ctypes.CDLL(windows if sys.platform == "win32" else linux)


def _driver() -> Any:
    """Return the driver, started; raises EngineError where there is none or it sees no GPU."""
    try:
        driver = _library("nvcuda.dll", "libcuda.so.1")
    except OSError:
        raise EngineError("there is no NVIDIA driver on this machine (libcuda was not found).") from None
    code = driver.cuInit(0)
    if code == NO_DEVICE:
        hidden = os.environ.get("CUDA_VISIBLE_DEVICES")
        why = "" if hidden is None else f"; CUDA_VISIBLE_DEVICES is {hidden!r}"
        raise EngineError(f"the NVIDIA driver sees no GPU on this machine{why}.")
    if code != 0:
        raise EngineError(f"the NVIDIA driver does not start: {_error(driver, code)}.")
    return driver


def _error(driver: Any, code: int) -> str:
    """Return what the driver calls one of its errors."""
    name = ctypes.c_char_p()
    known = driver.cuGetErrorName(code, ctypes.byref(name)) == 0 and name.value is not None
    return name.value.decode() if known and name.value else f"error {code}"


def _number(driver: Any, ask: Callable[..., int], *given: int) -> int:
    """Return the whole number that a function of the driver writes to its first argument."""
    value = ctypes.c_int(0)
    _done(driver, ask(ctypes.byref(value), *given))
    return value.value


def _done(driver: Any, code: int) -> None:
    """Raise EngineError where a function of the driver has returned an error."""
    if code != 0:
        raise EngineError(f"the NVIDIA driver does not answer: {_error(driver, code)}.")


def driver_version() -> str:
    """Return the version of the driver, such as "580.65.06", or "unknown"."""
    text = ctypes.create_string_buffer(80)
    try:
        management = _library("nvml.dll", "libnvidia-ml.so.1")
        found = management.nvmlInit_v2() == 0 and management.nvmlSystemGetDriverVersion(text, 80) == 0
    except (OSError, AttributeError):
        found = False
    return text.value.decode() if found and text.value else "unknown"


def gpu() -> Gpu:
    """Return the GPU that would be used, the first that CUDA_VISIBLE_DEVICES leaves to be seen.

    Raises EngineError where there is no driver or no GPU.
    """
    driver = _driver()
    if _number(driver, driver.cuDeviceGetCount) == 0:
        raise EngineError("the NVIDIA driver sees no GPU on this machine.")
    device = _number(driver, driver.cuDeviceGet, FIRST)
    name = ctypes.create_string_buffer(100)
    _done(driver, driver.cuDeviceGetName(name, 100, device))
    major, minor = (_number(driver, driver.cuDeviceGetAttribute, which, device) for which in (75, 76))
    free, total = _memory(driver, device)
    return Gpu(name.value.decode(), (major, minor), total, free, driver_version())


def _memory(driver: Any, device: int) -> tuple[int, int]:
    """Return free and total memory [bytes], asked within the device's own context, which is left as it was."""
    context, free, total = ctypes.c_void_p(), ctypes.c_size_t(0), ctypes.c_size_t(0)
    if (code := driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)) != 0:
        raise EngineError(f"the GPU cannot be opened: {_error(driver, code)}.")
    try:
        _done(driver, driver.cuCtxPushCurrent_v2(context))
        try:
            _done(driver, driver.cuMemGetInfo_v2(ctypes.byref(free), ctypes.byref(total)))
        finally:
            _done(driver, driver.cuCtxPopCurrent_v2(ctypes.byref(context)))
    finally:
        driver.cuDevicePrimaryCtxRelease_v2(device)
    return free.value, total.value


# Whether it can be used -----------------------------------------------------------------------------------------


def usable() -> Gpu:
    """Return the GPU that the cuda engine runs on.

    Raises EngineError with the cause where it cannot: no GPU, no driver or one that is too old, a GPU that is too old,
    the cuda extra not installed, Numba's simulator switched on.
    """
    _no_simulator()
    if sys.platform == "darwin":
        raise EngineError("the engine cuda cannot run: there is no CUDA for macOS; the engine cpu runs everywhere.")
    return _fit(gpu())


def _no_simulator() -> None:
    """Raise EngineError where Numba's simulator is switched on: it is never taken for a GPU."""
    if os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0"):
        raise EngineError(
            "NUMBA_ENABLE_CUDASIM is set, and Numba's simulator of a GPU is wrong where blocks wait for each other; "
            "unset it."
        )


def _fit(found: Gpu) -> Gpu:
    """Return a GPU; raises EngineError where it cannot be used."""
    _new_enough(found)
    if why := missing():
        raise EngineError(f"{found.name} cannot be used: {why}.")
    return found


def _new_enough(found: Gpu) -> None:
    """Raise EngineError where a GPU or its driver is too old."""
    driver = _driver()
    version = _number(driver, driver.cuDriverGetVersion)
    cuda = version // 1000, version % 1000 // 10
    needed = "{}.{}".format(*NEEDED_CUDA)
    if cuda < NEEDED_CUDA:
        raise EngineError(
            f"the NVIDIA driver {found.driver} (CUDA {cuda[0]}.{cuda[1]}) is too old: CUDA {needed} needs driver "
            f"{NEEDED_DRIVER} or newer."
        )
    if found.capability < LEAST_CAPABILITY:
        raise EngineError(
            "{} has compute capability {}.{}: CUDA {} needs {}.{} or more.".format(
                found.name, *found.capability, needed, *LEAST_CAPABILITY
            )
        )


# What fits ------------------------------------------------------------------------------------------------------


def fastest(capability: Capability) -> Variant:
    """Return the variant of the step that should be faster on a GPU.

    Where double precision is slow each bond is evaluated only once. By counts of instructions and of memory traffic; no
    GPU has been measured yet.
    """
    return "half-bonds" if capability in HALF_RATE else "bonds"


def bytes_per_particle(variant: Variant) -> float:
    """Return the GPU memory that a particle takes with its bonds in a close packing, elastic with dashpots [bytes].

    A law adds 8 bytes per bond for each of its parameters that is not uniform; and 8 for each word that it remembers
    or books, twice that in the variant "bonds", which has a packed copy, three times in "half-bonds", which has two.
    """
    uniform_or_absent = {"mass", "inertia", "drag", "drag_torque", "dragged"}
    particle = sum(_size(f) for f in PARTICLE_FIELDS if f.name not in uniform_or_absent) + INDEX
    changing = sum(_size(f) for f in BOND_FIELDS if f.name in ("power", "damped"))
    bond = _size(LOAD) + _size(ENERGY) + changing
    if variant == "bonds":
        bond += 4 * INDEX + changing  # both ends; its place in the lists of both; what changes, packed
        particle += SEEN + KEPT + TOLD
    else:
        bond += 2 * (3 * INDEX + changing)  # for each end: both ends, which bond, what changes
        particle += 2 * SEEN + KEPT
    return float(particle + BONDS_PER_PARTICLE * bond)


def _size(field: Field) -> int:
    return field.components * np.dtype(field.dtype).itemsize


def particles_that_fit(free: int, each: float) -> int:
    """Return how many particles of so many bytes each fit into free memory [bytes], a twentieth left to the driver."""
    return int(0.95 * free / each)


def gibibytes(size: float) -> str:
    """Return a size in words."""
    return f"{size / GIB:.3g} GiB"


def described() -> str:
    """Return what there is to say about the GPU of this machine, or why none can be used, in one sentence."""
    try:
        _no_simulator()
        found = gpu()
    except EngineError as error:
        return f"none: {str(error).rstrip('.')}"
    millions = particles_that_fit(found.free, bytes_per_particle(fastest(found.capability))) / 1e6
    said = (
        f"{found.name}, driver {found.driver}, {gibibytes(found.free)} of {gibibytes(found.total)} free: about "
        f"{millions:.3g} million bonded particles fit"
    )
    try:
        _fit(found)
    except EngineError as error:
        return f"{said}; it cannot be used: {str(error).rstrip('.')}"
    return said
