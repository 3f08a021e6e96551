"""The live line of a run: on a terminal redrawn in place, elsewhere one plain line about every 10 s."""

from __future__ import annotations

import sys
import time as clocks
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple

from pybondem.errors import InputError
from pybondem.output.readable import compact, duration, quantity

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.live import Live

LIVE_EVERY = 0.1  #: s between two drawings of the live line
PLAIN_EVERY = 10.0  #: s between two plain lines (pipe, log file, batch queue)
_RATE_WINDOW = 20.0  # s; speed is that of this stretch, so that compiling at the start does not spoil the time left
_BAR_WIDTH = (8, 30)
_GAP = "  "


class _Field(NamedTuple):
    text: str
    rank: int  # 0 is kept longest when the terminal is narrow


class _State(NamedTuple):
    steps: int = 0
    time: float | None = None
    unbalanced: float | None = None
    broken: int | None = None
    total_bonds: int | None = None
    kinetic_ratio: float | None = None


class Progress:
    """Shows how far a run is; use it as a context manager and call :meth:`update` as often as is convenient.

    Parameters
    ----------
    title : what runs, such as ``"pull-out"``.
    total_steps : steps that this run will take, or None when it runs until a condition is met.
    particles : number of particles, for particle-steps per second.
    quiet : print nothing at all.
    console : rich console to print on; by default the standard output.
    clock : source of seconds, for tests.

    Raises
    ------
    InputError : ``total_steps`` or ``particles`` is negative.
    """

    def __init__(
        self,
        title: str,
        total_steps: int | None,
        particles: int,
        quiet: bool = False,
        *,
        console: Console | None = None,
        clock: Callable[[], float] = clocks.perf_counter,
    ) -> None:
        if (total_steps is not None and total_steps < 0) or particles < 0:
            raise InputError(
                f"progress of {title!r}: total_steps {total_steps} and particles {particles} must be >= 0."
            )
        self.title = title
        self.total_steps = total_steps
        self.particles = particles
        self._clock = clock
        self._console: Console | None = None if quiet else console or _standard_console()
        self._redraws = self._console is not None and _can_redraw(self._console)
        self._every = LIVE_EVERY if self._redraws else PLAIN_EVERY
        self._live: Live | None = None
        self._state = _State()
        self._shown = self._state
        self._samples: deque[tuple[float, int]] = deque()
        self._next = float("inf")
        self._bar = _BAR_WIDTH[1]

    def __enter__(self) -> Progress:
        now = self._clock()
        self._samples = deque([(now, 0)])
        if self._console is not None:
            self._next = now if self._redraws else now + self._every
        if self._redraws:
            from rich.live import Live

            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._console is not None and self._state != self._shown:
                self._show(self._clock())
        finally:
            if self._live is not None:
                self._live.stop()
                self._live = None

    def due(self) -> bool:
        """Whether :meth:`update` would print now: ask before measuring something only for this line."""
        return self._clock() >= self._next

    def update(
        self,
        steps_done: int,
        *,
        time: float | None = None,
        unbalanced: float | None = None,
        broken: int | None = None,
        total_bonds: int | None = None,
        kinetic_ratio: float | None = None,
    ) -> None:
        """Take note of the state and print it when it is time to.

        Parameters
        ----------
        steps_done : steps taken since this progress was entered.
        time : simulated time, s.
        unbalanced : unbalanced-force ratio, dimensionless.
        broken, total_bonds : numbers of bonds.
        kinetic_ratio : kinetic over strain energy, dimensionless.

        What is left out is not shown.
        """
        self._state = _State(steps_done, time, unbalanced, broken, total_bonds, kinetic_ratio)
        now = self._clock()
        if now >= self._next:
            self._show(now)

    def _show(self, now: float) -> None:
        assert self._console is not None  # _next is infinite when quiet
        self._samples.append((now, self._state.steps))
        while len(self._samples) > 2 and now - self._samples[1][0] >= _RATE_WINDOW:
            self._samples.popleft()
        if self._live is not None:
            self._live.update(self._line(self._console.width), refresh=True)
        else:
            fields = [field.text for field in self._fields()]
            self._console.print(_GAP.join([self.title, *fields]), markup=False, highlight=False, soft_wrap=True)
        self._shown = self._state
        self._next = now + self._every

    def _steps_per_second(self) -> float:
        (start, before), (end, after) = self._samples[0], self._samples[-1]
        return (after - before) / (end - start) if end > start else 0.0

    def _fields(self) -> list[_Field]:
        state, speed = self._state, self._steps_per_second()
        fields = []
        if self.total_steps is None:
            fields.append(_Field(f"{state.steps} steps", 0))
        else:
            share = state.steps / self.total_steps if self.total_steps else 1.0
            left = (self.total_steps - state.steps) / speed if speed > 0.0 else float("nan")
            fields.append(_Field(f"{int(100 * share):3d}%", 0))
            fields.append(_Field(f"{duration(0.0 if share >= 1.0 else left)} left", 1))
        if state.time is not None:
            fields.append(_Field(f"t {quantity(state.time, 's')}", 2))
        fields.append(_Field(f"{compact(speed)} steps/s", 7))
        fields.append(_Field(f"{compact(speed * self.particles)} particle-steps/s", 5))
        if state.kinetic_ratio is not None:
            fields.append(_Field(f"Ek/Es {compact(state.kinetic_ratio, 1)}", 6))
        if state.unbalanced is not None:
            fields.append(_Field(f"unbalanced {compact(state.unbalanced, 1)}", 4))
        if state.broken is not None:
            of = "" if state.total_bonds is None else f"/{state.total_bonds}"
            fields.append(_Field(f"broken {state.broken}{of}", 3))
        return fields

    def _line(self, width: int) -> RenderableType:
        """Title, bar and as many fields as the width allows, the most telling ones first to stay."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        bar = 0 if self.total_steps is None else _BAR_WIDTH[0] + len(_GAP)
        room = width - 1 - len(self.title) - bar
        kept: set[int] = set()
        fields = self._fields()
        for k in sorted(range(len(fields)), key=lambda k: fields[k].rank):
            room -= len(_GAP) + len(fields[k].text)
            if room < 0:
                room += len(_GAP) + len(fields[k].text)
                break  # a shorter field further down would come and go with the digits of the others
            kept.add(k)
        words = _GAP.join(field.text for k, field in enumerate(fields) if k in kept)
        row: list[RenderableType] = [Text(self.title, style="bold")]
        if bar:
            self._bar = min(_BAR_WIDTH[0] + room, self._bar)  # never longer again, so that the line does not jitter
            row.append(ProgressBar(total=max(self.total_steps or 0, 1), completed=self._state.steps, width=self._bar))
        line = Table.grid(padding=(0, len(_GAP), 0, 0))
        line.add_row(*row, Text(words, no_wrap=True, overflow="ellipsis"))
        return line


@contextmanager
def waiting(what: str, quiet: bool = False) -> Iterator[None]:
    """Say on a terminal what is being waited for, while it lasts; print nothing elsewhere."""
    if quiet or not sys.stdout.isatty():
        yield
        return
    with _standard_console().status(what):
        yield


def _standard_console() -> Console:
    from rich.console import Console

    return Console()


def _can_redraw(console: Console) -> bool:
    if console.is_jupyter:  # rich draws there through ipywidgets, and only warns when they are absent
        return find_spec("ipywidgets") is not None
    return console.is_terminal and not console.is_dumb_terminal
