"""Engines by name; each is imported only when it is asked for."""

from pybondem.check import choice
from pybondem.engines.base import Engine
from pybondem.errors import EngineError, InputError

ENGINES = ("cpu", "reference", "interpreted")


def make_engine(name: str, threads: int | None = None) -> Engine:
    """Return an engine by name: "cpu" (Numba, the default), "reference" (NumPy), "interpreted" (plain Python)."""
    if name == "cuda":
        raise EngineError(f"there is no GPU engine in this version; the engines are {', '.join(ENGINES)}.")
    name = choice("engine", name, ENGINES)
    if name == "reference":
        from pybondem.engines.reference import Reference

        return Reference()
    if name == "interpreted":
        from pybondem.engines.interpreted import Interpreted

        return Interpreted()
    from pybondem.engines.cpu import Cpu

    if threads is not None and not isinstance(threads, int):
        raise InputError(f"threads is {threads!r}; it must be a whole number.")
    return Cpu(threads)
