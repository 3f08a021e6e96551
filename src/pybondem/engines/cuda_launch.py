"""The GPU's memory and kernels through numba-cuda, with its errors in this package's words.

All that the engine asks of numba-cuda at run time stands in `Device`: another binding needs no more than these methods.
"""

import hashlib
import importlib.metadata
import math
import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from pybondem.engines.cpu import cache_folder, fingerprint
from pybondem.engines.cuda_compile import kernel_of
from pybondem.engines.cuda_device import FIRST, Gpu
from pybondem.engines.cuda_text import Text
from pybondem.errors import EngineError

DRIVER_ERRORS = {"CudaAPIError", "CudaDriverError", "CudaSupportError", "CUDAError"}  # of numba-cuda and of cuda.core
BUILD_ERRORS = {  # of those that make machine code: NVVM, nvJitLink, and what is around them
    "NvvmError", "NvvmSupportError", "nvvmError", "NVVMError", "LinkerError", "nvJitLinkError", "CCSupportError",
    "NvrtcError", "NvrtcSupportError",
}  # fmt: skip
FATAL = (  # after these errors of the driver, nothing in GPU memory can be had any more
    "ILLEGAL_ADDRESS", "LAUNCH_TIMEOUT", "ASSERT", "HARDWARE_STACK_ERROR", "ILLEGAL_INSTRUCTION", "MISALIGNED_ADDRESS",
    "INVALID_ADDRESS_SPACE", "INVALID_PC", "LAUNCH_FAILED", "ECC_UNCORRECTABLE", "DEVICE_LOST", "CONTEXT_IS_DESTROYED",
    "UNKNOWN",
)  # fmt: skip
SMALL = 64, 256  # blocks and threads of the kernels that are no step
RESIDENT = (384, 256, 1)  # threads that are to fit on a multiprocessor together: as many as do without spills
CALLS = 16  # bytes of a thread that a linked kernel keeps in memory for its calls where blocks meet

Launch = Callable[..., None]  # launch(steps, *values)

_KERNELS: dict[str, Any] = {}  # compiled code is never freed: compile each text once


class Device:
    """The GPU as the engine sees it.

    failed: None, or why nothing more can be had from it: after a fault in a kernel all that it holds is lost.
    """

    def __init__(self, gpu: Gpu) -> None:
        self.gpu = gpu
        self.failed: str | None = None
        self._sums: Any = None

    # Memory -----------------------------------------------------------------------------------------------------

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Any:
        """Return a new array in GPU memory, its values arbitrary; raises EngineError where it does not fit."""
        from numba import cuda

        with self._errors(int(np.prod(shape)) * np.dtype(dtype).itemsize):
            return cuda.device_array(shape, dtype)

    def upload(self, host: NDArray[Any], there: Any) -> None:
        """Copy an array to one of the same shape in GPU memory."""
        with self._errors():
            if host.size:
                there.copy_to_device(host)

    def download(self, there: Any, host: NDArray[Any]) -> None:
        """Copy an array in GPU memory to one of the same shape here."""
        with self._errors():
            if host.size:
                there.copy_to_host(host)

    def free(self) -> int:
        """Return the free GPU memory [bytes], with all given back that nothing refers to any more."""
        from numba import cuda

        with self._errors():
            context = cuda.current_context()
            context.memory_manager.deallocations.clear()  # of arrays; context.deallocations are of streams and events
            return int(context.get_memory_info().free)

    def total(self, there: Any) -> float:
        """Return the sum of an array of numbers in GPU memory; 16 384 partial sums are copied back."""
        from numba import cuda

        with self._errors():
            if self._sums is None:
                self._sums = cuda.device_array(math.prod(SMALL))
            strided_sums()(there.reshape(there.size), self._sums)
            return float(self._sums.copy_to_host().sum())

    def picked(self, there: Any, at: NDArray[np.integer[Any]]) -> NDArray[Any]:
        """Return items (the last index, at least one) of an array in GPU memory."""
        from numba import cuda

        rows = there.size // there.shape[-1]
        with self._errors((rows + 1) * 8 * len(at)):
            found = cuda.device_array((rows, len(at)), there.dtype)
            picking()(there.reshape(rows, there.shape[-1]), cuda.to_device(at), found)
            return np.asarray(found.copy_to_host()).reshape(*there.shape[:-1], len(at))

    # Kernels ----------------------------------------------------------------------------------------------------

    def kernel(self, text: Text, values: Sequence[Any], at_once: int | None) -> Launch:
        """Return what launches a text on arguments like these (numbers, arrays in GPU memory) and waits for its end.

        at_once: blocks that must fit on one multiprocessor; None: as many as do without spills. Compiled once per text
        and process; kept on disk. A cooperative launch: all its blocks are on the GPU at the same time.
        """
        with self._errors():
            kernel, made = fitting(text, values, at_once)
            most = made.max_cooperative_grid_blocks(text.threads)
            if most < 1:
                too_large = f"a block of {text.threads} threads is too large"
                raise EngineError(f"{self.gpu.name} cannot run the kernel: {too_large}.")
            started = launcher(kernel, made, min(text.blocks, most), text.threads)

        def launch(steps: int, *values: Any) -> None:
            from numba import cuda

            with self._errors():
                started(steps, *values)
                cuda.synchronize()

        return launch

    @contextmanager
    def _errors(self, needed: int | None = None) -> Iterator[None]:
        """Turn an error of the driver into an EngineError; needed: bytes asked for."""
        if self.failed is not None:
            raise EngineError(self.failed)
        try:
            self._refuse_another_gpu()
            yield
        except Exception as error:
            kinds = {kind.__name__ for kind in type(error).__mro__}
            if kinds & BUILD_ERRORS:
                raise EngineError(
                    f"no kernel can be built for {self.gpu.name}: {' '.join(str(error).split())}."
                ) from error
            if not kinds & DRIVER_ERRORS:
                raise
            if "OUT_OF_MEMORY" in str(error):
                raise out_of_memory(self.gpu, needed, self.free()) from error
            what = " ".join(str(error).split())
            if not any(word in what for word in FATAL):
                raise EngineError(f"the GPU {self.gpu.name} refuses: {what}.") from error
            self.failed = (
                f"the GPU {self.gpu.name} has failed ({what}) and what it held is lost; the last record or checkpoint "
                "written is valid. Start a new process to use the GPU again."
            )
            raise EngineError(self.failed) from error

    def _refuse_another_gpu(self) -> None:
        """Raise EngineError where numba-cuda works on another GPU than the one that was asked what it can do."""
        from numba import cuda

        number = cuda.current_context().device.id
        if number != FIRST:
            raise EngineError(
                f"the engine cuda runs on GPU {FIRST} ({self.gpu.name}), and cuda.select_device({number}) has chosen "
                f"another; hide the others with CUDA_VISIBLE_DEVICES={number} instead."
            )


def launcher(kernel: Any, made: Any, blocks: int, threads: int) -> Launch:
    """Return what launches a kernel with so many blocks of threads: `Prepared`, or numba-cuda's own, slower way.

    kernel: the dispatcher; made: what it has compiled for the arguments.
    """
    try:
        return Prepared(made, blocks, threads)
    except (AttributeError, ImportError):  # names that numba-cuda keeps to itself, in another version of it
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a small model does not fill a GPU
            configured: Launch = kernel[blocks, threads]
        return configured


class Prepared:
    """Launches of a compiled kernel with so many blocks of threads.

    An argument that is the very object of the last launch is not translated for the driver again, which is most of
    what a launch by numba-cuda costs: 60 arguments, seven numbers and more for each array. All that is not public in
    numba-cuda is looked up when this is made: AttributeError or ImportError then, and never in the midst of a run.
    """

    def __init__(self, made: Any, blocks: int, threads: int) -> None:
        dispatcher: Any = import_module("numba.cuda.dispatcher")
        self._stream = import_module("numba.cuda.cudadrv.driver")._to_core_stream(0)
        cooperative = {"is_cooperative" if dispatcher.CUDA_CORE_GE_1_0 else "cooperative_launch": True}
        self._config = dispatcher.LaunchConfig(grid=(blocks, 1, 1), block=(threads, 1, 1), shmem_size=0, **cooperative)
        self._launch, self._context = dispatcher.launch, dispatcher.get_context
        self._prepare, self._kinds = made._prepare_args, made.argument_types
        self._function = made._codelibrary.get_cufunc
        _ = self._function().kernel  # a name as above
        self._values: list[Any] = [self] * len(made.argument_types)
        self._words: list[list[Any]] = [[] for _ in made.argument_types]

    def __call__(self, *values: Any) -> None:
        """Launch."""
        for n, value in enumerate(values):
            if value is not self._values[n]:
                words: list[Any] = []
                self._prepare(self._kinds[n], value, 0, [], words)
                self._values[n], self._words[n] = value, words
        self._context()  # makes it the one of this thread
        every = [word for words in self._words for word in words]
        self._launch(self._stream, self._config, self._function().kernel, *every)


def fitting(text: Text, values: Sequence[Any], at_once: int | None) -> tuple[Any, Any]:
    """Return the dispatcher of a text, and what it has compiled for arguments like these.

    at_once: blocks on one multiprocessor; None: as many as leave each thread the registers that it needs, by what the
    linked kernel keeps elsewhere.
    """

    @cache
    def made(blocks: int) -> tuple[Any, Any]:
        kernel = compiled(text, blocks)
        return kernel, kernel.compile(tuple(kernel.typeof_pyval(value) for value in (1, *values)))

    return made(most_at_once(text.threads, lambda blocks: int(made(blocks)[1].local_mem_per_thread), at_once))


def most_at_once(threads: int, outside: Callable[[int], int], at_once: int | None = None) -> int:
    """Return how many blocks must fit on a multiprocessor: at_once, or as many as do without spills.

    outside(blocks): bytes of a thread in memory of its own when compiled so. They hold what cannot be in registers
    whatever their number, such as what is handed over where blocks meet: spills are what a bound adds to those of the
    loosest one, which is compiled only where that decides.
    """
    if at_once is not None:
        return at_once
    *tight, loosest = dict.fromkeys(max(1, most // threads) for most in RESIDENT)
    for blocks in tight:
        there = outside(blocks)
        if there <= CALLS or there <= outside(loosest):
            return blocks
    return loosest


def compiled(text: Text, at_once: int = 1) -> Any:
    """Return the kernel of a text as numba-cuda's dispatcher, which finds on disk what an earlier process compiled.

    at_once: blocks that must fit on one multiprocessor, which bounds the registers of a thread. Link-time optimisation
    is off, so that what runs is near to the code whose registers and spills are looked at without a GPU.
    """
    from numba import cuda

    version = importlib.metadata.version("numba-cuda")
    bounds = (text.threads, at_once)
    key = hashlib.sha256(f"{fingerprint(text)} {version} {bounds}".encode()).hexdigest()[:24]
    if key not in _KERNELS:
        path = cache_folder() / f"pybondem_cuda_{key}.py"
        if not path.exists():
            with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
                file.write('"""Kernel of a step program; made by pybondem, may be deleted."""\n\n' + text.source)
            os.replace(file.name, path)
        kernel = kernel_of(text)  # Numba's cache keeps its files beside the one that a function says it is from
        code = kernel.__code__.replace(co_filename=str(path))
        own = FunctionType(code, kernel.__globals__, kernel.__name__)
        _KERNELS[key] = cuda.jit(own, cache=True, lto=False, launch_bounds=bounds)  # without `own`, lto is lost
    return _KERNELS[key]


def out_of_memory(gpu: Gpu, needed: int | None, free: int) -> EngineError:
    """Return what to raise where GPU memory does not suffice; needed: bytes asked for, free: bytes there are."""
    asked = "more memory is" if needed is None else f"{needed:,} bytes are"
    return EngineError(
        f"the GPU {gpu.name} is full: {asked} needed and {free:,} bytes are free of {gpu.total:,}; the arrays of this "
        "process are as they were. Take fewer particles, or engine='cpu'."
    )


@cache
def strided_sums() -> Any:
    """Return what launches a kernel in which each thread sums every so many-th of some numbers."""
    from numba import cuda

    def kernel(values: Any, sums: Any) -> None:
        thread = cuda.grid(1)
        total = 0.0
        for k in range(thread, values.size, cuda.gridsize(1)):
            total += values[k]
        sums[thread] = total

    return _small(kernel)


@cache
def picking() -> Any:
    """Return what launches a kernel that copies some columns of a table."""
    from numba import cuda

    def kernel(values: Any, at: Any, found: Any) -> None:
        for k in range(cuda.grid(1), at.size, cuda.gridsize(1)):
            for row in range(values.shape[0]):
                found[row, k] = values[row, at[k]]

    return _small(kernel)


def _small(kernel: Callable[..., None]) -> Any:
    from numba import cuda

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return cuda.jit(kernel)[SMALL]
