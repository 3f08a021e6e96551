"""The GPU's memory and kernels through numba-cuda, with its errors in this package's words.

All that the engine asks of numba-cuda at run time stands in `Device`: another binding needs no more than these methods.
"""

import hashlib
import importlib.metadata
import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from pybondem.engines.cpu import cache_folder, fingerprint
from pybondem.engines.cuda_compile import kernel_of
from pybondem.engines.cuda_device import Gpu
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
SUM_BLOCKS, SUM_THREADS = 64, 256
RESIDENT = (384, 256, 1)  # threads that are to fit on a multiprocessor together: as many as do without spills
MOST_LOCAL = 32  # bytes of a thread that are not in registers: 16 for calls where blocks meet, the same for spills

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
            context.deallocations.clear()
            return int(context.get_memory_info().free)

    def total(self, there: Any) -> float:
        """Return the sum of an array of numbers in GPU memory; a few thousand partial sums are copied back."""
        from numba import cuda

        with self._errors():
            if self._sums is None:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    kernel = strided_sums()[SUM_BLOCKS, SUM_THREADS]
                self._sums = kernel, cuda.device_array(SUM_BLOCKS * SUM_THREADS)
            kernel, sums = self._sums
            kernel(there.reshape(there.size), sums)
            return float(sums.copy_to_host().sum())

    # Kernels ----------------------------------------------------------------------------------------------------

    def kernel(self, text: Text, values: Sequence[Any], at_once: int | None) -> Launch:
        """Return what launches a text on arguments like these (numbers, arrays in GPU memory) and waits for its end.

        at_once: blocks that must fit on one multiprocessor; None: as many as do without spills. Compiled once per text
        and process; kept on disk. A cooperative launch: all its blocks are on the GPU at the same time.
        """
        with self._errors():
            made = fitting(text, values, at_once)
            most = made.max_cooperative_grid_blocks(text.threads)
            if most < 1:
                too_large = f"a block of {text.threads} threads is too large"
                raise EngineError(f"{self.gpu.name} cannot run the kernel: {too_large}.")
            prepared = Prepared(made, min(text.blocks, most), text.threads)

        def launch(steps: int, *values: Any) -> None:
            from numba import cuda

            with self._errors():
                prepared(steps, *values)
                cuda.synchronize()

        return launch

    @contextmanager
    def _errors(self, needed: int | None = None) -> Iterator[None]:
        """Turn an error of the driver into an EngineError; needed: bytes asked for."""
        if self.failed is not None:
            raise EngineError(self.failed)
        try:
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


class Prepared:
    """Launches of a compiled kernel with so many blocks of threads.

    An argument that is the very object of the last launch is not translated for the driver again, which is most of
    what a launch by numba-cuda costs: 60 arguments, seven numbers and more for each array.
    """

    def __init__(self, made: Any, blocks: int, threads: int) -> None:
        self._dispatcher: Any = import_module("numba.cuda.dispatcher")
        self._stream = import_module("numba.cuda.cudadrv.driver")._to_core_stream(0)
        cooperative = {"is_cooperative" if self._dispatcher.CUDA_CORE_GE_1_0 else "cooperative_launch": True}
        self._config = self._dispatcher.LaunchConfig(
            grid=(blocks, 1, 1), block=(threads, 1, 1), shmem_size=0, **cooperative
        )
        self._made = made
        self._values: list[Any] = [self] * len(made.argument_types)
        self._words: list[list[Any]] = [[] for _ in made.argument_types]

    def __call__(self, *values: Any) -> None:
        """Launch."""
        for n, value in enumerate(values):
            if value is not self._values[n]:
                words: list[Any] = []
                self._made._prepare_args(self._made.argument_types[n], value, 0, [], words)
                self._values[n], self._words[n] = value, words
        self._dispatcher.get_context()  # makes it the one of this thread
        kernel = self._made._codelibrary.get_cufunc().kernel
        every = [word for words in self._words for word in words]
        self._dispatcher.launch(self._stream, self._config, kernel, *every)


def fitting(text: Text, values: Sequence[Any], at_once: int | None) -> Any:
    """Return a text compiled for arguments like these, with so many blocks on one multiprocessor.

    at_once None: as many as leave each thread the registers that it needs, by what the linked kernel keeps elsewhere.
    """
    bounds = [max(1, most // text.threads) for most in RESIDENT] if at_once is None else [at_once]
    for blocks in dict.fromkeys(bounds):
        kernel = compiled(text, blocks)
        made = kernel.compile(tuple(kernel.typeof_pyval(value) for value in (1, *values)))
        if made.local_mem_per_thread <= MOST_LOCAL:
            break
    return made


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


def strided_sums() -> Any:
    """Return a kernel in which each thread sums every so many-th of some numbers."""
    from numba import cuda

    def kernel(values: Any, sums: Any) -> None:
        thread = cuda.grid(1)
        total = 0.0
        for k in range(thread, values.size, cuda.gridsize(1)):
            total += values[k]
        sums[thread] = total

    return cuda.jit(kernel)
