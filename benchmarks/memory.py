"""What a process keeps in memory: resident set, its peak, and the arrays of a simulation."""

import contextlib
import ctypes
import gc
import os
from pathlib import Path

import numpy as np

import pybondem as bd


def resident() -> int | None:
    """Return the resident set of this process [bytes] after its free memory is handed back; None where unknown."""
    gc.collect()
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)  # else what the C library keeps for later counts as used
    path = Path("/proc/self/statm")
    return int(path.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if path.exists() else None


def peak() -> int | None:
    """Return the largest resident set that this process has had [bytes]; None where unknown."""
    path = Path("/proc/self/status")
    lines = path.read_text().splitlines() if path.exists() else []
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), None)


def array_bytes(sim: bd.Simulation) -> int:
    """Return the size of the arrays that the engine steps on [bytes], each counted once."""
    held = (sim.state.particles, sim.state.shared, *sim.state.bonds.values())
    arrays = {id(a): a for group in held for a in group.values() if isinstance(a, np.ndarray)}
    return sum(a.nbytes for a in arrays.values())
