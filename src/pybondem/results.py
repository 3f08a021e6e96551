"""The result folder of a run: history tables, particles and bonds for ParaView, figures, a summary."""

import time as clocks
from pathlib import Path
from typing import Any

import numpy as np

from pybondem.energies import Energies
from pybondem.measure import Record
from pybondem.output.folder import provenance, result_folder, write_json
from pybondem.output.report import closing_block
from pybondem.output.table import HistoryWriter
from pybondem.simulation import Simulation

FRAMES = 50
BOOK = {f"energy_{name}" for name in Energies._fields}


class Results:
    """Writes what a simulation leaves, while it runs.

    Every record becomes a table (`history.csv`, or NAME.csv), particles and bonds a VTKHDF time series that ParaView
    opens, and at the end figures and `summary.json`. Frames are written at records, `frame_every` steps apart; by
    default at every record, and half as often after each 50 frames. Use it as a context manager; an interrupted run
    leaves everything it has. slow_until [s]: set it where the run is meant to be quasi-static up to then, and the
    largest ratio of kinetic to strain energy is judged.
    """

    def __init__(self, sim: Simulation, name: str, *, folder: str | Path | None = None, frame_every: int = 0,
                 quiet: bool = False) -> None:  # fmt: skip
        from pybondem.output.vtkhdf import VtkSeries

        self.sim, self.name, self.quiet = sim, name, quiet
        self.folder = result_folder(name, path=folder)
        self.figures: dict[str, Path] = {}
        self.facts: dict[str, str] = {}
        self.summary: dict[str, Any] = {}
        self._began, self._first_step, self._stepped = clocks.perf_counter(), sim.step, sim.stepping
        self._tables: dict[str, tuple[Record, HistoryWriter]] = {}
        self.slow_until: float | None = None
        self._frame_every, self._last_frame = frame_every, -1
        model = sim.model
        pairs = np.concatenate([b.pairs for b in model.bonds]) if model.bonds else np.empty((0, 2), np.int64)
        set_number = np.repeat(np.arange(len(model.bonds)), [len(b.pairs) for b in model.bonds])
        self._particles = VtkSeries(
            self.folder / "particles.vtkhdf", model.x,
            point_fields={"velocity": 3, "spin": 3, "force": 3},
            point_constants={"radius": model.radius, "part": model.part_of.astype(np.int32)},
        )  # fmt: skip
        self._bonds = VtkSeries(
            self.folder / "bonds.vtkhdf", model.x, pairs=pairs, cell_fields={"damage": 1, "force": 3, "energy": 1},
            cell_constants={"bond_set": set_number.astype(np.int32)},
        )  # fmt: skip
        sim.observe(self._observe)
        for record in sim.records:
            self._open(record)
        self.frame()

    def _open(self, record: Record) -> None:
        writer = HistoryWriter(self.folder / f"{record.name}.csv", record.units)
        for row in range(len(record["time"].values)):
            writer.append({name: column.values[row] for name, column in record.columns.items()})
        self._tables[record.name] = (record, writer)

    def _observe(self, sim: Simulation) -> None:
        for record in sim.records:
            if record.name not in self._tables:
                self._open(record)
            elif sim.step % record.every == 0:
                self._tables[record.name][1].append({name: column.last for name, column in record.columns.items()})
        if sim.step - self._last_frame >= self._interval():
            self.frame()

    def _interval(self) -> int:
        """Return the steps between frames."""
        if self._frame_every:
            return self._frame_every
        return min((r.every for r in self.sim.records), default=1) << (self._particles.steps // FRAMES)

    def frame(self) -> None:
        """Append particles and bonds as they are now to the time series."""
        sim = self.sim
        p = sim.particles
        self._particles.append(sim.time, p.x, point_data={"velocity": p.v, "spin": p.w, "force": p.force})
        sets = [sim.bonds(b) for b in sim.model.bonds]
        empty = {"damage": np.empty(0), "force": np.empty((0, 3)), "energy": np.empty(0)}
        data = {n: np.concatenate([getattr(s, n) for s in sets]) if sets else e for n, e in empty.items()}
        self._bonds.append(sim.time, p.x, cell_data=data)
        self._last_frame = sim.step

    def __enter__(self) -> "Results":
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        self.close("done" if kind is None else "stopped by hand" if issubclass(kind, KeyboardInterrupt) else "failed")

    def close(self, outcome: str = "done") -> None:
        """Write the last frame, figures and summary, close the files, and say what there is."""
        sim = self.sim
        if sim.step > self._last_frame and np.isfinite(sim.particles.x).all():
            self.frame()
        self._particles.close()
        self._bonds.close()
        for _, writer in self._tables.values():
            writer.close()
        self._draw()
        wall = clocks.perf_counter() - self._began
        facts = self._run_facts(wall)
        summary = {"outcome": outcome, **facts, **self.summary, "provenance": provenance()}
        write_json(self.folder / "summary.json", summary)
        files = {"summary": self.folder / "summary.json", "ParaView": self.folder / "particles.vtkhdf"} | self.figures
        shares = {"time steps": facts["stepping_s"], "records, files, figures": wall - facts["stepping_s"]}
        closing_block(
            self.name, wall=wall, steps=facts["steps"], particles=len(sim.model), outcome=outcome, time=sim.time,
            shares=shares, energy_error=facts.get("energy_error"), kinetic_ratio=facts.get("kinetic_ratio"),
            broken=sim.broken, total_bonds=sim.bond_count, facts=self.facts, files=files, quiet=self.quiet,
        )  # fmt: skip

    def _run_facts(self, wall: float) -> dict[str, Any]:
        sim = self.sim
        steps, stepping = sim.step - self._first_step, max(sim.stepping - self._stepped, 1e-9)
        return {
            "case": self.name, "particles": len(sim.model), "bonds": sim.bond_count, "broken": sim.broken,
            "engine": sim.engine.name, "dt_s": sim.dt, "critical_dt_s": sim.limit.dt, "steps": steps,
            "time_s": sim.time, "wall_s": wall, "stepping_s": stepping, "steps_per_s": steps / stepping,
            "particle_steps_per_s": steps * len(sim.model) / stepping, "energy": sim.energies._asdict(), **self._book(),
        }  # fmt: skip

    def _book(self) -> dict[str, float]:
        """Return the largest residual of the energy book over its largest term, and kinetic over strain energy."""
        record = next((r for r, _ in self._tables.values() if set(r.columns) >= BOOK), None)
        if record is None:
            return {}
        columns = {n: np.abs(record[f"energy_{n}"].values) for n in Energies._fields}
        largest = max(c.max() for n, c in columns.items() if n != "residual")
        if largest == 0.0:
            return {}
        facts = {"energy_error": float(columns["residual"].max() / largest)}
        if self.slow_until is not None:
            slow = record["time"].values <= self.slow_until
            facts["kinetic_ratio"] = float(columns["kinetic"][slow].max() / max(columns["strain"][slow].max(), 1e-300))
        return facts

    def _draw(self) -> None:
        """Draw the energy book, and each other recorded column against time."""
        from pybondem.output.figures import energy_book, line_figure

        for record, _ in self._tables.values():
            if len(record["time"].values) < 2:
                continue
            rest = [n for n in record.columns if n != "time"]
            time = record["time"].values
            if set(rest) >= BOOK:
                columns = {n: record[f"energy_{n}"].values for n in Energies._fields}
                residual = columns.pop("residual")
                book = {n: values for n, values in columns.items() if np.any(values)}
                path = self.folder / "energy.png"
                if book:
                    self.figures["energy"] = energy_book(path, time, book, residual)
                rest = [n for n in rest if n not in BOOK]
            for name in rest:
                path = self.folder / f"{record.name}-{name}.png"
                unit = record[name].unit.replace("1", "")
                line_figure(path, time, {name: record[name].values}, labels=("time", name), units=("s", unit))
