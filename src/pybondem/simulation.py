"""A simulation: model x engine x time step."""

import itertools
import signal
import threading
import time as clocks
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pybondem.assembly import Assembly, Drag, assemble, energy_program, step_program
from pybondem.bond_view import bond_fields, failed_pairs, interface, number_of, refuse_values
from pybondem.check import choice, finite_array, fraction, nonnegative, positive, vector, whole_number
from pybondem.damping import Kinetic
from pybondem.energies import Energies, energies, leapfrog_kinetic
from pybondem.engines.base import Engine, Runner
from pybondem.engines.choose import make_engine
from pybondem.errors import InputError, UnstableError
from pybondem.measure import Measure, Record
from pybondem.model import BondSet, Model, Selection
from pybondem.output.progress import Progress, waiting
from pybondem.program import Program
from pybondem.stability import Limit, stability_limit

Floats = NDArray[np.float64]
LONGEST_BLOCK = 0.25  # seconds between two looks at the progress line, the keyboard and the state
MOST_STEPS = 4096  # rows of the schedule tables of one block
EDITABLE = ("x", "q", "v", "w")


@dataclass
class Session:
    """What simulations take where they are not told: set by the command line, or once by a script.

    engine, threads: as in `Simulation`; started: called with a simulation when it first runs.
    """

    engine: str = "cpu"
    threads: int | None = None
    quiet: bool = False
    started: Callable[["Simulation"], None] | None = None


session = Session()


class Interrupted(KeyboardInterrupt):
    """Ctrl-C was pressed: the block of steps was finished and everything written.

    found: what a driver has come to by then, None for a simulation.
    """

    def __init__(self, said: str = "", found: Any = None) -> None:
        super().__init__(said)
        self.found = found


class Simulation:
    """A model made ready to run.

    engine: "cpu" (the default), "cuda" (an NVIDIA GPU, in the faster of the variants "cuda:bonds" and
    "cuda:half-bonds"), "reference", "interpreted", or an engine of your own making; dt: time step [s], by default
    `safety` times the critical step of the model's own stiffness; damping: `local`, `viscous` or `kinetic` (see
    `damping`), None for none; gravity (3,) [m/s2]; threads: of the cpu engine, by default the physical cores. Raises
    InputError for bad values, UnstableError for a step above the critical one, EngineError where "cuda" cannot run.
    """

    def __init__(self, model: Model, *, engine: str | Engine | None = None, dt: float | None = None,
                 safety: float = 0.3, damping: Drag | Kinetic | None = None, gravity: ArrayLike = (0.0, 0.0, 0.0),
                 threads: int | None = None) -> None:  # fmt: skip
        if not isinstance(model, Model):
            raise InputError(f"Simulation needs a Model, got {type(model).__name__}.")
        if damping is not None and not isinstance(damping, Drag | Kinetic):
            raise InputError(f"damping is {damping!r}; give local(...), viscous(...), kinetic(...) or None.")
        self.model = model
        self._changes = model.changes
        gx, gy, gz = vector("gravity", gravity).tolist()
        self.gravity: tuple[float, float, float] = (gx, gy, gz)
        if engine is None or isinstance(engine, str):
            engine = make_engine(engine or session.engine, session.threads if threads is None else threads)
        if not hasattr(engine, "prepare"):
            raise InputError(f"engine is {engine!r}; give the name of one, such as 'cpu', or an engine.")
        self.engine: Engine = engine
        self.step = 0
        self._damage_grows = True
        self.stepping = 0.0  # wall time spent in the engine's steps [s]
        self.records: list[Record] = []
        self._kinetic = damping if isinstance(damping, Kinetic) else None
        self._kinetic_taken, self._kinetic_before = 0.0, 0.0
        self._energy: tuple[Program, Runner] | None = None
        self._interrupted = False
        self._observers: list[Callable[[Simulation], None]] = []
        with waiting("laying out the model, finding its time step, compiling", session.quiet):
            self.state: Assembly = assemble(model)
            self.limit: Limit = stability_limit(self.state, self.engine)
            self.dt = self._time_step(dt, safety)
            program = step_program(self.state, self.gravity, damping if isinstance(damping, Drag) else None)
            self._runner = self.engine.prepare(program)
            self._evaluate()

    def _time_step(self, dt: float | None, safety: float) -> float:
        """Return the time step [s]: the one asked for, or safety times the critical one."""
        if dt is None:
            fraction("safety", safety, 1e-6, 1.0)
            return safety * self.limit.dt if np.isfinite(self.limit.dt) else 1e-6
        dt = positive("dt", dt, "s")
        if dt > self.limit.dt:
            raise UnstableError(
                f"dt is {dt:.4g} s, above the critical step {self.limit.dt:.4g} s, which is set by the bonds of "
                f"particle {self.limit.particle}; leave dt out to have it chosen, or lower it."
            )
        return dt

    # Running ----------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.step * self.dt

    def record(self, every: int, name: str | None = None, **measures: Measure) -> Record:
        """Keep a table of measures every so many steps, from now on; see `measure`. Returns the growing table.

        name: that of its CSV file, by default history, history-2, ... Raises InputError for a name that is taken.
        """
        self._check_model()
        every = whole_number("every of record", every)
        for key, measure in measures.items():
            if not isinstance(measure, Measure):
                raise InputError(f"record was given {key}={measure!r}; give a measure: reaction(...), energy() ...")
        taken = {r.name for r in self.records}
        if name is None:
            name = next(n for k in itertools.count(1) if (n := "history" if k == 1 else f"history-{k}") not in taken)
        if name in taken or not name.replace("-", "_").isidentifier():
            raise InputError(f"a record cannot be named {name!r}: the name is taken, or cannot be that of a file.")
        record = Record(name, every, measures)
        record.take(self)
        self.records.append(record)
        return record

    def observe(self, observer: Callable[["Simulation"], None]) -> None:
        """Call observer(simulation) whenever a record falls due; for writers of files."""
        self._observers.append(observer)

    @property
    def watched(self) -> bool:
        """Whether something writes files of this simulation (see `observe`)."""
        return bool(self._observers)

    def run(self, steps: int | None = None, *, time: float | None = None, until: Callable[[], bool] | None = None,
            title: str = "run", quiet: bool = False) -> "Simulation":  # fmt: skip
        """Advance by `steps`, or by `time` [s], or until a condition holds (looked at after every record).

        Shows progress unless quiet. Ctrl-C ends after the current block of steps and raises Interrupted. Raises
        InputError unless one of the three is given, UnstableError where the motion is no longer finite.
        """
        self._check_model()
        total = self._steps_to_take(steps, time, until)
        last = None if total is None else self.step + total
        first, block = self.step, 1
        if session.started is not None and self.step == 0:
            session.started(self)
        with self._keyboard(), Progress(title, total, len(self.model), quiet=quiet or session.quiet) as progress:
            while (last is None or self.step < last) and not self._interrupted:
                n = min(block, self._steps_to_record(), MOST_STEPS if last is None else last - self.step)
                before = self.stepping
                self._advance(n)
                spent = max(self.stepping - before, 1e-9)
                block = int(np.clip(n * LONGEST_BLOCK / spent, 1, min(2 * block, MOST_STEPS)))
                done = self._take_records() and until is not None and until()
                if progress.due():
                    self._show(progress, self.step - first)
                if done:
                    break
        if self._interrupted:
            self._interrupted = False
            raise Interrupted(f"stopped by hand after step {self.step}, t = {self.time:.6g} s.")
        return self

    @property
    def damage_grows(self) -> bool:
        """Whether damage may grow, True at first. Set to False, every damage law keeps its damage and its memory.

        For unloading without further damage, say. Setting it raises InputError where bonds are under a bond law, whose
        loads are its own.
        """
        return self._damage_grows

    @damage_grows.setter
    def damage_grows(self, grows: bool) -> None:
        for bonds in self.model.bonds:
            if bonds.bond.law is not None and bonds.bond.law.kind == "bond":
                raise InputError(
                    f"damage cannot be frozen under {bonds.bond.law.name}: it is a bond law; see damage_law."
                )
        self._damage_grows = bool(grows)

    def _show(self, progress: Progress, steps: int) -> None:
        """Bring the live line up to date; what an engine holds elsewhere is not fetched for its sake."""
        if self.state.particles.source is not None:
            progress.update(steps, time=self.time)
            return
        progress.update(
            steps, time=self.time, unbalanced=self.unbalanced, broken=self.broken, total_bonds=self.bond_count
        )

    def _check_model(self) -> None:
        if self.model.changes != self._changes:
            raise InputError("the model was changed after its Simulation was made; make a new Simulation of it.")

    def _steps_to_take(self, steps: Any, time: Any, until: Any) -> int | None:
        if (steps is not None) + (time is not None) > 1 or steps is time is until is None:
            raise InputError("run needs steps, or time [s], or until; give one of steps and time.")
        if until is not None and not callable(until):
            raise InputError(f"until of run is {until!r}; give a function, such as lambda: pull.force.last < 1.0.")
        if until is not None and not self.records:
            raise InputError("run(until=...) looks at its condition after every record; make a record first.")
        if steps is not None:
            return whole_number("steps", steps, 0)
        return None if time is None else round(nonnegative("time", time, "s") / self.dt)

    def _steps_to_record(self) -> int:
        every = [r.every for r in self.records] + ([self._kinetic.every] if self._kinetic else [])
        return min((k - self.step % k for k in every), default=MOST_STEPS)

    def _take_records(self) -> bool:
        due = [r for r in self.records if self.step % r.every == 0]
        for record in due:
            record.take(self)
        if due:
            for observer in self._observers:
                observer(self)
        return bool(due)

    def _advance(self, n: int) -> None:
        """Advance n steps inside the engine."""
        began = clocks.perf_counter()
        self._runner.advance(n, self.dt, self.state.tables.schedule(self.step, n, self.dt, self._damage_grows))
        self.stepping += clocks.perf_counter() - began
        self.step += n
        if not np.isfinite(self.state.particles.total("x")):
            bad = ~np.isfinite(self.state.particles["x"]).all(axis=0)
            raise UnstableError(
                f"the motion is not finite any more at step {self.step} (t = {self.time:.4g} s), at {bad.sum()} "
                f"particles, the first is {self.state.order[bad].min()}; lower dt ({self.dt:.3g} s)."
            )
        refuse_values(self.state, (self.step - n + 1, self.step))
        if self._kinetic and self.step % self._kinetic.every == 0:
            self._stop_at_peak()

    def _stop_at_peak(self) -> None:
        """Kinetic damping: zero all velocities of free components once the kinetic energy falls."""
        now = leapfrog_kinetic(self)
        if now < self._kinetic_before:
            p, tables = self.state.particles, self.state.tables
            p["v"] *= tables.hold[:, p["group"]]
            p["w"] *= tables.turn_hold[:, p["group"]]
            p.changed("v")
            p.changed("w")
            self._load()
            self._kinetic_taken += now - leapfrog_kinetic(self)
            now = 0.0
        self._kinetic_before = now

    def _evaluate(self) -> None:
        """Evaluate the loads where the model stands, and start the energy book afresh."""
        self._load()
        self._kinetic_before = 0.0
        self._at_start = 0.0
        self._at_start = self.energies.residual

    def _load(self) -> None:
        """Evaluate the loads where the model stands: a step of no length."""
        now = self.state.tables.schedule(self.step, 0, self.dt, self._damage_grows)
        self._runner.advance(1, 0.0, {name: np.concatenate([row, row]) for name, row in now.items()})
        refuse_values(self.state, (self.step, self.step))

    @contextmanager
    def _keyboard(self) -> Iterator[None]:
        """Let the first Ctrl-C end the run after the current block; a second one breaks off."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.getsignal(signal.SIGINT)

        def note(number: int, frame: Any) -> None:
            signal.signal(signal.SIGINT, before)
            self._interrupted = True

        signal.signal(signal.SIGINT, note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    # Looking ----------------------------------------------------------------------------------------------------

    @property
    def particles(self) -> SimpleNamespace:
        """Copies of the particle fields in the model's own order: x, v, w, force, torque (n, 3), q (n, 4), ..."""
        p, n = self.state.particles, len(self.model)
        names = ("x", "q", "v", "w", "force", "torque", "work")
        fields = {name: p[name].T[self.state.position] for name in names}
        fields["dragged"] = p["dragged"][self.state.position] if "dragged" in p else np.zeros(n)
        fields |= {name: np.broadcast_to(p[name], n)[self.state.position] for name in ("mass", "inertia")}
        return SimpleNamespace(**fields)

    @contextmanager
    def edit(self, *names: str) -> Iterator[Any]:
        """Change particle fields in place, in model order: `with sim.edit("v") as v: v[:] = ...`.

        names: one or several of x, q, v, w; several come as a tuple: `with sim.edit("v", "w") as (v, w)`. The energy
        book starts afresh. Raises InputError for another name, a value that is not finite, or q not of unit length;
        nothing is changed then.
        """
        for name in names:
            choice("field to edit", name, EDITABLE)
        fields = {name: self.state.particles[name].T[self.state.position] for name in names}
        yield next(iter(fields.values())) if len(names) == 1 else tuple(fields.values())
        for name, values in fields.items():
            finite_array(name, values, values.shape)
            if name == "q" and np.abs(np.linalg.norm(values, axis=1) - 1.0).max() > 1e-9:
                raise InputError("q was set to quaternions that are not of unit length.")
        for name, values in fields.items():
            self.state.particles[name][:] = values[self.state.order].T
            self.state.particles.changed(name)
        self._evaluate()

    def bonds(self, bonds: BondSet) -> SimpleNamespace:
        """Return copies of the fields of a bond set, in the order of its pairs.

        force (m, 3): force on the first end [N]; damage (m,); energy (m,) [J]; i, j, kn, ks, kt, kb, area, ... (m,);
        m_NAME and p_NAME (m,): each word of the law's memory and each of its parameters; damages (m, 4): of each mode;
        answer (m, 6): loads of a bond law. Raises InputError for bonds of another model.
        """
        return bond_fields(self.state, number_of(self.state, bonds), self.bond_energy())

    def interface(self, joints: BondSet) -> tuple[Floats, Floats]:
        """Return slip (m,) [m] and shear stress (m,) [Pa] of a set of joints, in the order of its pairs."""
        return interface(self.state, number_of(self.state, joints))

    @property
    def failed_pairs(self) -> NDArray[np.int64]:
        """Pairs of particles (k, 2) whose bonds have failed: those that a contact law will answer for."""
        return failed_pairs(self.state)

    def bond_energy(self) -> Floats:
        """Return the elastic energy of every bond in memory order (bonds,) [J]."""
        energy = np.zeros(self.bond_count)
        if not self.state.blocks:
            return energy
        if self._energy is None:
            program = energy_program(self.state)
            self._energy = program, self.engine.prepare(program)
        program, runner = self._energy
        program.shared["energy"] = energy
        runner.advance(1, 0.0, {"energy": energy})
        program.shared["energy"] = energy[:0]
        return energy

    @property
    def bond_count(self) -> int:
        """Number of bonds, broken ones included."""
        return sum(block.count for block in self.state.blocks)

    @property
    def broken(self) -> int:
        """Number of broken bonds (damage 1)."""
        return sum(int(np.count_nonzero(b["damage"] >= 1.0)) for b in self.state.bonds.values() if "damage" in b)

    @property
    def unbalanced(self) -> float:
        """Mean force on free components over the mean force in the bonds [-]."""
        p = self.state.particles
        free = 1.0 - self.state.tables.hold[:, p["group"]]
        load = self.state.shared["load"]
        inside = float(np.abs(load[:3]).mean()) if load.size else 0.0
        return float((np.abs(p["force"]) * free).sum() / max(free.sum(), 1.0)) / inside if inside > 0.0 else 0.0

    @property
    def energies(self) -> Energies:
        """The energy book now [J]."""
        book = energies(self, self._kinetic_taken)
        return book._replace(residual=book.residual - self._at_start)

    def total(self, name: str, where: Selection) -> Floats:
        """Return the sum of a particle field over a selection."""
        return self.state.particles.picked(name, self.state.position[self.model.own(where)]).sum(axis=1)

    def mean_displacement(self, where: Selection) -> Floats:
        """Return the mean displacement of a selection since the start (3,) [m]."""
        at = self.state.position[self.model.own(where)]
        return (self.state.particles.picked("x", at) - self.state.particles.picked("start", at)).mean(axis=1)
