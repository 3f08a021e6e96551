"""The cylinder example: the stiffness it measures, against a direct solve of its lattice and the closed-form modulus."""

from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from examples.result_folder import pictures, read_columns, read_series, read_summary
from oracles.lattice_statics import Lattice, held, hexagonal_modulus, hexagonal_springs

from pybondem.errors import InputError
from pybondem.examples import Cylinder, cylinder

SIZE = {"diameter": 2e-3, "radius": 5e-3, "height": 20e-3}


def stiffness(case: Cylinder) -> float:
    """Return EA [N] of the lattice of a case, by a direct solve: bottom held, top raised by one height."""
    built = case.build()
    x = built.model.x
    (bonds,) = built.model.bonds
    z = x[:, 2]
    low, high = (np.flatnonzero(np.abs(z - end) < 1e-9) for end in (z.min(), z.max()))
    lattice = Lattice(x).bond(bonds.pairs, *hexagonal_springs(case.E, case.nu, case.diameter))
    _, force = lattice.solve(held(low, "x y z") | held(high, "x y") | held(high, "z", float(np.ptp(z))))
    return float(force[high, 2].sum())


class Run(NamedTuple):
    """A finished run: its case, result, exact stiffness [N], and what it printed."""

    case: Cylinder
    result: Any
    exact: float
    printed: str


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The example at a small size on the cpu engine."""
    case = cylinder(**SIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "120")
        import contextlib
        import io

        with contextlib.redirect_stdout(io.StringIO()) as printed:
            result = case.run(engine="cpu", folder=tmp_path_factory.mktemp("cylinder"))
    return Run(case, result, stiffness(case), printed.getvalue())
