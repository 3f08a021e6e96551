"""Engines by name; each is imported only when it is asked for."""

from pybondem.check import choice
from pybondem.engines.base import Engine
from pybondem.errors import EngineError, InputError

ENGINES = ("cpu", "reference", "interpreted", "cuda")
VARIANTS = ("cuda:bonds", "cuda:half-bonds")  # by what a thread of the GPU evaluates; "cuda" takes the faster one


def make_engine(name: str, threads: int | None = None) -> Engine:
    """Return an engine by name: "cpu" (Numba, the default), "cuda" (Numba on an NVIDIA GPU), "reference" (NumPy),
    "interpreted" (plain Python).

    "cuda:bonds" and "cuda:half-bonds" are variants of "cuda", which takes the one that should be faster on the GPU at
    hand; see `engines.cuda.Cuda`. threads: of "cpu", None for the physical cores; others pass over it. Raises
    InputError for another name, EngineError where there is no GPU to be used.
    """
    name = choice("engine", name, (*ENGINES, *VARIANTS))
    if name == "reference":
        from pybondem.engines.reference import Reference

        return Reference()
    if name == "interpreted":
        from pybondem.engines.interpreted import Interpreted

        return Interpreted()
    if name.startswith("cuda"):
        from pybondem.engines.cuda import Cuda

        return Cuda("bonds" if name == "cuda:bonds" else "half-bonds" if name == "cuda:half-bonds" else None)
    from pybondem.engines.cpu import Cpu

    if threads is not None and not isinstance(threads, int):
        raise InputError(f"threads is {threads!r}; it must be a whole number.")
    return Cpu(threads)


def usable_engines() -> tuple[str, ...]:
    """Return the names of the engines that this machine can run."""
    from pybondem.engines.cuda_device import usable

    try:
        usable()
    except EngineError:
        return tuple(name for name in ENGINES if name != "cuda")
    return ENGINES
