"""The kernels that are no step, sums and columns of an array, run on the CPU one thread after another."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from pybondem.engines import cuda_launch
from pybondem.engines.cuda_device import Gpu
from pybondem.engines.cuda_launch import Device

GPU = Gpu("Test GPU", (8, 6), total=8 * 2**30, free=7 * 2**30, driver="590.10")


class There(np.ndarray):
    """An array in pretended GPU memory."""

    def copy_to_host(self) -> Any:
        return np.array(self)


class Kernel:
    """kernel[blocks, threads](...): a thread after another."""

    def __init__(self, place: "Threads", function: Callable[..., None]) -> None:
        self._place, self._function = place, function

    def __getitem__(self, grid: tuple[int, int]) -> Callable[..., None]:
        self._place.threads = grid[0] * grid[1]
        return self

    def __call__(self, *arguments: Any) -> None:
        for thread in range(self._place.threads):
            self._place.thread = thread
            self._function(*arguments)


class Threads:
    """What stands for numba.cuda."""

    def __init__(self) -> None:
        self.thread = self.threads = 0

    def grid(self, _: int) -> int:
        return self.thread

    def gridsize(self, _: int) -> int:
        return self.threads

    def jit(self, function: Callable[..., None]) -> Kernel:
        return Kernel(self, function)

    @staticmethod
    def device_array(shape: Any, dtype: Any = np.float64) -> Any:
        return np.full(shape, np.nan, dtype).view(There)

    @staticmethod
    def to_device(array: Any) -> Any:
        return np.array(array).view(There)

    @staticmethod
    def current_context() -> Any:
        return SimpleNamespace(device=SimpleNamespace(id=0))


@pytest.mark.parametrize("small", [(1, 1), (2, 32), (7, 100)])
@pytest.mark.parametrize("shape", [(3, 100), (257,)])
def test_sums_and_columns_are_taken_where_the_array_is(monkeypatch, small, shape):
    monkeypatch.setattr(numba, "cuda", Threads(), raising=False)
    monkeypatch.setattr(cuda_launch, "SMALL", small)
    for kernel in ("strided_sums", "picking"):
        monkeypatch.setattr(cuda_launch, kernel, getattr(cuda_launch, kernel).__wrapped__)
    device, values = Device(GPU), np.random.default_rng(1).normal(size=shape)
    there, at = Threads.to_device(values), np.array([99, 0, 5] * 30)
    assert device.total(there) == pytest.approx(values.sum(), rel=1e-12)
    assert np.array_equal(device.picked(there, at), values[..., at])
    assert type(device.picked(there, at[:1])) is np.ndarray
