"""The isolated fibre of the PyBONDEM-GPU paper (section 3.1): a hexagonally packed cylinder in tension.

One end is held, the other moved at constant velocity. The axial stiffness that the run measures is compared with the
static answer of the same lattice (conjugate gradients on the linear stiffness) and with the closed-form modulus of
the infinite lattice.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem.bonds import Bond, springs
from pybondem.check import fraction, positive
from pybondem.damping import local
from pybondem.errors import InputError
from pybondem.measure import energy, reaction, strain, unbalanced
from pybondem.model import Model, Selection
from pybondem.neighbours import pieces
from pybondem.output.figures import curve_against_theory
from pybondem.packing import hcp
from pybondem.packing.shapes import Cylinder as CylinderShape
from pybondem.results import Results
from pybondem.schedules import smooth
from pybondem.simulation import Simulation
from pybondem.statics import solve
from pybondem.theory.lattice import calibrate

Floats = NDArray[np.float64]
RECORDS = 200


@dataclass(frozen=True)
class Cylinder:
    """The cylinder; SI units.

    diameter of the particles, radius and height of the cylinder, E and nu of the material (nu from 0 to 1/5, the reach
    of the lattice along its c axis), density, strain reached at the end, transits: duration in transits of the sound
    wave, damping: local damping.
    """

    diameter: float = 1e-3
    radius: float = 5e-3
    height: float = 20e-3
    E: float = 1e9
    nu: float = 0.1
    density: float = 2500.0
    strain: float = 1e-4
    transits: float = 60.0
    damping: float = 0.2

    def __post_init__(self) -> None:
        for name in ("diameter", "radius", "height", "E", "density", "strain", "transits"):
            positive(f"{name} of cylinder", getattr(self, name))
        fraction("nu of cylinder", self.nu, 0.0, 0.2)

    @property
    def duration(self) -> float:
        """Duration of the test [s]."""
        return self.transits * self.height / float(np.sqrt(self.E / self.density))

    def build(self) -> "CylinderModel":
        """Return the model: bonds in closed form from (E, nu), the lowest layer held, the highest one driven."""
        model = Model(hcp(self.diameter, inside=CylinderShape(self.radius, self.height)), self.density, "cylinder")
        kn, ks = calibrate("hcp", self.E, self.nu, self.diameter)
        pairs = model.touching()
        count, _ = pieces(len(model), pairs[:, 0], pairs[:, 1])
        if count > 1:
            raise InputError(
                f"the cylinder falls into {count} pieces; take particles smaller than {self.diameter:g} m."
            )
        model.bond(pairs, Bond(springs(kn, ks)))
        z, half = model.x[:, 2], 0.25 * self.diameter
        bottom, top = model.where(z=(None, z.min() + half)), model.where(z=(z.max() - half, None))
        model.fix(bottom, "x y z")
        model.fix(top, "x y")
        rise = 0.2 * self.duration
        travel = self.strain * float(np.ptp(z))
        model.drive(top, vz=smooth(travel / (self.duration - 0.5 * rise), over=rise))
        return CylinderModel(self, model, bottom, top)

    def run(self, *, engine: str = "cpu", threads: int | None = None, folder: str | Path | None = None,
            quiet: bool = False) -> "CylinderResult":  # fmt: skip
        """Run the test, write the result folder, and return the measured stiffness with its errors."""
        built = self.build()
        sim = Simulation(built.model, engine=engine, threads=threads, safety=0.5, damping=local(self.damping))
        steps = round(self.duration / sim.dt)
        if steps < RECORDS:
            raise InputError(f"transits of cylinder is {self.transits}: {steps} steps, too few to measure; take more.")
        every = max(1, steps // RECORDS)
        record = sim.record(
            every, force=reaction(built.bottom, "z"), strain=strain(built.bottom, built.top, "z"),
            unbalanced=unbalanced(), book=energy(),
        )  # fmt: skip
        with Results(sim, "cylinder", folder=folder, frame_every=every * RECORDS // 20, quiet=quiet) as results:
            results.slow_until = self.duration
            sim.run(time=self.duration, title="cylinder", quiet=quiet)
            summary = built.compare(record["strain"].values, record["force"].values, engine, threads)
            results.summary.update(summary)
            results.facts.update({name: f"{100.0 * value:+.3f} %" for name, value in summary["errors"].items()})
            exact = summary["stiffness"]["static_solve_N"]
            results.figures["force"] = curve_against_theory(
                results.folder / "force-strain.png", (record["strain"].values, record["force"].values),
                (record["strain"].values, exact * record["strain"].values), labels=("strain", "force"), units=("", "N"),
                names=("simulation", "static solve of the lattice"),
            )  # fmt: skip
        return CylinderResult(results.folder, record["strain"].values, record["force"].values, summary)


@dataclass(frozen=True)
class CylinderModel:
    """The cylinder as a model with its held and driven ends."""

    test: Cylinder
    model: Model
    bottom: Selection
    top: Selection

    def compare(self, strains: Floats, force: Floats, engine: str, threads: int | None) -> dict[str, Any]:
        """Return the axial stiffness EA [N] by slope of the run, static solve and closed form, and the errors."""
        late = strains > 0.25 * strains[-1]
        measured = float(np.polyfit(strains[late], force[late], 1)[0])
        static = self.static_stiffness(engine, threads)
        closed = self.test.E * np.pi * self.test.radius**2
        return {
            "stiffness": {"measured_N": measured, "static_solve_N": static, "closed_form_N": closed},
            "note": "closed form: E times the nominal area; grains at the surface have fewer bonds and carry less",
            "errors": {"stiffness against the static solve": measured / static - 1.0,
                       "stiffness against the closed form": measured / closed - 1.0},
        }  # fmt: skip

    def static_stiffness(self, engine: str = "cpu", threads: int | None = None) -> float:
        """Return EA [N] of the same lattice under the same boundary conditions, by one static solve."""
        z = self.model.x[:, 2]
        prescribed = np.zeros((len(self.model), 6))
        prescribed[self.top.indices, 2] = np.ptp(z)
        return float(solve(self.model, prescribed, engine=engine, threads=threads).force[self.top.indices, 2].sum())


@dataclass(frozen=True)
class CylinderResult:
    """What the test gave: strain, force [N], summary with the errors, and the folder that holds everything."""

    folder: Path
    strain: Floats
    force: Floats
    summary: dict[str, Any]

    def show(self) -> None:
        """Print the measured stiffness, its errors, and where the pictures are."""
        for name, value in (self.summary["stiffness"] | self.summary["errors"]).items():
            print(f"{name:40s} {value:.6g}")
        print(self.folder)


def cylinder(**values: Any) -> Cylinder:
    """Return the cylinder with some of its values changed: cylinder(diameter=0.5e-3).run()."""
    return Cylinder(**values)
