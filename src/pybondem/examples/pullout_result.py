"""Running the pull-out test and holding it against the analytic solution."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pybondem.damping import local
from pybondem.examples.pullout_setup import PullOutModel
from pybondem.measure import Record, applied, broken, displacement, energy, unbalanced
from pybondem.output.figures import curve_against_theory, profiles_against_theory
from pybondem.results import Results
from pybondem.simulation import Interrupted, Simulation
from pybondem.theory import PullOut

Floats = NDArray[np.float64]
RECORDS = 400
STAGES = (0.4, 0.95)  # of the load at which softening begins, then evenly spaced up to the turning point
SOFTENING_STAGES = 4
STABLE = 0.99  # of the displacement at the turning point, up to which loads are compared


@dataclass(frozen=True)
class Profile:
    """Shear stress along the interface at one displacement: simulated at the joints, and analytic [m, Pa]."""

    zones: str
    displacement: float
    height: Floats
    shear: Floats
    theory: Floats
    error: float


@dataclass(frozen=True)
class PullOutResult:
    """What the test gave: curves, profiles, errors, the folder that holds them; steps, and their seconds."""

    folder: Path
    displacement: Floats
    load: Floats
    profiles: tuple[Profile, ...]
    summary: dict[str, Any]
    steps: int
    seconds: float

    def show(self) -> None:
        """Print the comparison with the theory and where the pictures are."""
        for name, value in self.summary["errors"].items():
            print(f"{name:40s} {100.0 * value:+8.2f} %")
        print(self.folder)


def run_pullout(
    built: PullOutModel, engine: str, threads: int | None, folder: str | Path | None, quiet: bool
) -> PullOutResult:
    """Run the test and write its result folder."""
    test = built.test
    sim = Simulation(built.model, engine=engine, threads=threads, safety=0.5, damping=local(test.damping))
    every = max(1, round(test.duration / sim.dt / RECORDS))
    record = sim.record(
        every, load=applied(built.pulled, test.axis), displacement=displacement(built.pulled, test.axis),
        unbalanced=unbalanced(), broken=broken(), book=energy(),
    )  # fmt: skip
    shear: list[Floats] = [sim.interface(built.joints)[1]]
    sim.observe(lambda s: shear.append(s.interface(built.joints)[1]))
    with Results(sim, "pullout", folder=folder, frame_every=every * RECORDS // 50, quiet=quiet) as results:
        try:
            sim.run(time=test.duration, title="pull-out", quiet=quiet)
        except Interrupted:  # compared as far as it came
            conclude(built, sim, record, np.array(shear), results)
            raise
        profiles, summary = conclude(built, sim, record, np.array(shear), results)
    u, load = record["displacement"].values, record["load"].values
    return PullOutResult(results.folder, u, load, profiles, summary, sim.step, sim.stepping)


def conclude(
    built: PullOutModel, sim: Simulation, record: Record, shear: Floats, results: Results
) -> tuple[tuple[Profile, ...], dict[str, Any]]:
    """Hold a run against the theory, draw and summarise it; returns profiles and summary."""
    u, load = record["displacement"].values, record["load"].values
    stable = u <= STABLE * last_stable_displacement(built.test.theory())
    results.slow_until = float(record["time"].values[stable].max())
    profiles = compare_profiles(built, u, shear)
    summary = compare(built, sim, u, load, profiles)
    draw(built, results, u, load, profiles)
    results.summary.update(summary)
    results.facts.update({name: f"{100.0 * value:+.2f} %" for name, value in summary["errors"].items()})
    return profiles, summary


def stage_displacements(theory: PullOut) -> list[float]:
    """Return the end displacements [m] of the compared profiles: elastic, then softening up to the last stable one."""
    elastic = [theory.state_at_load(f * theory.onset_load()).displacement for f in STAGES]
    return elastic + list(np.linspace(elastic[-1], last_stable_displacement(theory), SOFTENING_STAGES + 2)[1:-1])


def last_stable_displacement(theory: PullOut) -> float:
    """Return the displacement [m] up to which a slowly moved end follows the path: turning point, or the end of it."""
    turn = theory.turning_point()
    return turn.displacement if turn else theory.slip_end


def compare_profiles(built: PullOutModel, displacement: Floats, shear: Floats) -> tuple[Profile, ...]:
    """Return the shear profiles at the stages that the run has reached, each with the analytic one at its joints."""
    theory = built.test.theory()
    profiles = []
    for wanted in stage_displacements(theory):
        if wanted > displacement[-1]:
            break
        k = int(np.argmin(np.abs(displacement - wanted)))
        state = theory.state_at_displacement(float(displacement[k]))
        height = built.surface.height
        exact = state.shear(np.clip(height, 0.0, built.test.length))
        error = float(np.abs(shear[k] - exact).max() / theory.tau_max)
        profiles.append(Profile(state.zones, float(displacement[k]), height, shear[k], exact, error))
    return tuple(profiles)


def compare(
    built: PullOutModel, sim: Simulation, u: Floats, load: Floats, profiles: tuple[Profile, ...]
) -> dict[str, Any]:
    """Return the summary: what was built, what came out, and the errors against the analytic solution."""
    test, theory = built.test, built.test.theory()
    peak, last = theory.peak(), last_stable_displacement(theory)
    stable = u <= STABLE * last
    exact = np.array([theory.state_at_displacement(float(x)).load for x in u[stable]])
    errors: dict[str, float] = {}
    if u[-1] > 1.05 * peak.displacement:
        errors["peak load"] = float(load.max() / peak.load - 1.0)
    errors["load up to the turning point"] = float(np.abs(load[stable] - exact).max() / peak.load)
    errors |= {f"shear stress, {p.zones}, u = {1e3 * p.displacement:.3f} mm": p.error for p in profiles}
    book = sim.energies
    if u[-1] > last and sim.bonds(built.joints).damage.min() >= 1.0:
        errors["energy of debonding"] = book.damage / theory.work_of_debonding - 1.0
    return {
        "geometry": {
            "diameter_m": test.fitted_diameter, "layers": test.layers, "length_m": test.length,
            "free_length_m": test.fitted_free_length, "interface_bonds": len(built.joints.pairs),
            "interface_area_m2": float(built.surface.area.sum()), "scale": built.scales,
        },
        "theory": {"peak_load_N": peak.load, "peak_displacement_m": peak.displacement,
                   "last_stable_displacement_m": last,
                   "work_of_debonding_J": theory.work_of_debonding, "lam_L": theory.lam * test.length,
                   "peak_load_with_shear_lag_N": test.theory(shear_lag=True).peak().load},
        "result": {"peak_load_N": float(load.max()), "peak_displacement_m": float(u[np.argmax(load)])},
        "errors": errors,
    }  # fmt: skip


def draw(built: PullOutModel, results: Results, u: Floats, load: Floats, profiles: tuple[Profile, ...]) -> None:
    """Draw load against displacement and the shear profiles, with the analytic solution."""
    theory = built.test.theory()
    path, peak = theory.path(), theory.peak()
    results.figures["load"] = curve_against_theory(
        results.folder / "load-displacement.png", (u, load), (path.displacement, path.load),
        labels=("displacement of the fibre end", "load"), units=("m", "N"),
        marks={"peak": (peak.displacement, peak.load)},
    )  # fmt: skip
    if not profiles:
        return
    names = [f"{p.zones}  {1e3 * p.displacement:.2f} mm" for p in profiles]
    x = np.linspace(0.0, built.test.length, 400)
    exact = [theory.state_at_displacement(p.displacement).shear(x) for p in profiles]
    results.figures["shear"] = profiles_against_theory(
        results.folder / "shear-profiles.png", {n: (p.height, p.shear) for n, p in zip(names, profiles, strict=True)},
        {n: (x, e) for n, e in zip(names, exact, strict=True)}, labels=("position along the interface", "shear stress"),
        units=("m", "Pa"), legend_title="stage, end displacement",
    )  # fmt: skip
