"""The live line and the closing block: what they say, how often, and that they keep within the width."""

import math
import re
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from pybondem.errors import InputError
from pybondem.output.progress import Progress
from pybondem.output.readable import compact, duration, quantity, si_scale
from pybondem.output.report import closing_block, verdicts

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\x1b\]8;[^\x1b]*\x1b\\")


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def pipe():
    return Console(file=StringIO(), width=80)


def terminal(width=120):
    return Console(file=StringIO(), force_terminal=True, width=width, legacy_windows=False, _environ={"TERM": "xterm"})


def printed(console):
    return [line for line in re.split(r"[\r\n]+", ESCAPES.sub("", console.file.getvalue())) if line.strip()]


def test_off_a_terminal_a_line_every_ten_seconds_and_one_at_the_end():
    clock, console = Clock(), pipe()
    with Progress("pull-out", 3600, 10_000, console=console, clock=clock) as progress:
        for step in range(1, 3601):
            clock.now += 0.01  # 36 s in all, 100 steps a second
            progress.update(step, time=step * 1e-6, unbalanced=3.2e-3, broken=412, total_bonds=60699)
    lines = printed(console)
    assert len(lines) == 4  # after 10, 20 and 30 s, and the end
    assert "\x1b" not in console.file.getvalue()
    words = "pull-out 27% 0:00:26 left t 1 ms 100 steps/s 1e6 particle-steps/s unbalanced 3e-3 broken 412/60699"
    assert " ".join(lines[0].split()) == words
    assert " 55% " in lines[1]
    assert " 83% " in lines[2]
    assert "100%  0:00:00 left  t 3.6 ms" in lines[3]


def test_off_a_terminal_a_line_is_never_wrapped():
    clock, console = Clock(), Console(file=StringIO(), width=40)
    with Progress("a title [of] some length", 10, 1, console=console, clock=clock) as progress:
        progress.update(10, time=1.0, unbalanced=1e-3, broken=1, total_bonds=2, kinetic_ratio=1e-4)
    assert len(console.file.getvalue().splitlines()) == 1
    assert console.file.getvalue().startswith("a title [of] some length  100%")


def test_short_runs_off_a_terminal_print_only_the_end_and_idle_ones_nothing():
    console = pipe()
    with Progress("x", 10, 1, console=console, clock=Clock()) as progress:
        for step in range(11):
            progress.update(step)
    assert len(printed(console)) == 1
    console = pipe()
    with Progress("x", 10, 1, console=console, clock=Clock()):
        pass
    assert printed(console) == []


def test_on_a_terminal_it_draws_at_most_ten_times_a_second():
    clock, console = Clock(), terminal()
    with Progress("pull-out", 1000, 10, console=console, clock=clock) as progress:
        progress.update(0)
        before = len(console.file.getvalue())
        drawn = 0
        for step in range(1, 1001):
            clock.now += 0.002  # 2 s in all
            progress.update(step)
            now = len(console.file.getvalue())
            drawn += now != before
            before = now
    assert 15 <= drawn <= 20
    assert "100%" in printed(console)[-1]


@pytest.mark.parametrize("width", [40, 60, 80, 100, 140])
def test_on_a_terminal_the_line_fits_the_width_and_keeps_what_matters(width):
    clock, console = Clock(), terminal(width)
    with Progress("pull-out", 1000, 10_836, console=console, clock=clock) as progress:
        for step in range(0, 620, 10):
            clock.now += 1.0
            progress.update(step, time=step * 2e-6, unbalanced=3e-3, broken=412, total_bonds=60699, kinetic_ratio=2e-4)
    lines = printed(console)
    assert all(len(line) <= width for line in lines)
    assert re.search(r"^pull-out\s+\S+\s+61%", lines[-1])
    assert ("broken 412/60699" in lines[-1]) == (width >= 80)
    assert ("Ek/Es 2e-4" in lines[-1]) == (width >= 140)


def test_without_a_total_it_counts_steps():
    clock, console = Clock(), pipe()
    with Progress("relax", None, 10, console=console, clock=clock) as progress:
        clock.now += 12.0
        progress.update(2400, time=0.5)
    assert printed(console) == ["relax  2400 steps  t 500 ms  200 steps/s  2000 particle-steps/s"]


def test_time_left_follows_the_speed_of_late_not_the_slow_start():
    clock, console = Clock(), pipe()
    with Progress("x", 10_000, 1, console=console, clock=clock) as progress:
        clock.now += 60.0  # compiling
        progress.update(1)
        for thousands in range(1, 7):
            clock.now += 10.0
            progress.update(1 + 1000 * thousands)
    assert "0:00:40 left" in printed(console)[-1]  # 4000 steps at 100 a second; the whole run made 50 a second
    assert "100 steps/s" in printed(console)[-1]


def test_quiet_prints_nothing_and_is_never_due(capsys):
    with Progress("x", 10, 1, quiet=True) as progress:
        progress.update(10)
        assert not progress.due()
    closing_block("x", wall=1.0, steps=1, particles=1, quiet=True)
    assert capsys.readouterr() == ("", "")


def test_due_says_when_update_would_print():
    clock, console = Clock(), pipe()
    with Progress("x", 10, 1, console=console, clock=clock) as progress:
        for seconds in (0.0, 9.9, 0.2, 5.0, 6.0):
            clock.now += seconds
            due, before = progress.due(), len(printed(console))
            progress.update(1)
            assert due == (len(printed(console)) > before)
    assert len(printed(console)) == 2


def test_an_error_inside_ends_the_live_line_and_passes_on():
    console = terminal()
    with pytest.raises(ZeroDivisionError), Progress("x", 10, 1, console=console, clock=Clock()) as progress:
        progress.update(1 // 0)
    assert console.file.getvalue().count("\x1b[?25l") == console.file.getvalue().count("\x1b[?25h")  # cursor is back


def test_negative_totals_are_refused():
    with pytest.raises(InputError, match="must be >= 0"):
        Progress("x", -1, 1)


FULL = {
    "wall": 21.4,
    "steps": 120_000,
    "particles": 10_836,
    "time": 1.2e-2,
    "shares": {"particles": 3.0, "bonds": 6.0, "output": 1.0},
    "energy_error": 2e-5,
    "kinetic_ratio": 2e-4,
    "broken": 412,
    "total_bonds": 60_699,
    "facts": {"peak load": "16.3 MN at 1.88 mm"},
}


def test_closing_block_off_a_terminal_is_plain_and_unwrapped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    far = Path("/", *["long"] * 30, "report.html").absolute()
    console = pipe()
    closing_block("pull-out", console=console, files={"report": far, "run": tmp_path / "runs" / "a"}, **FULL)
    lines = console.file.getvalue().splitlines()
    assert "\x1b" not in console.file.getvalue()
    assert lines[0] == "pull-out done"
    rows = dict(re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in lines[1:])
    assert rows["wall time"] == "21.4 s"
    assert rows["speed"] == "6.1e7 particle-steps/s  (120000 steps, 10836 particles)"  # 120000 * 10836 / 21.4
    assert rows["time spent"] == "bonds 60 %  particles 30 %  output 10 %"
    assert rows["simulated"] == "12 ms"
    assert rows["broken bonds"] == "412 of 60699"
    assert rows["peak load"] == "16.3 MN at 1.88 mm"
    assert rows["report"] == str(far)
    assert rows["run"] == str(Path("runs", "a"))
    assert any("quasi-static: Ek/Es stayed under 1e-3 (good)" in line for line in lines)
    assert any("energy closes: off by 2e-5" in line for line in lines)


def test_closing_block_on_a_terminal_links_paths_and_colours_verdicts(tmp_path):
    console = terminal(100)
    closing_block("pull-out", console=console, outcome="stopped by hand", files={"run": tmp_path}, **FULL)
    raw = console.file.getvalue()
    assert tmp_path.as_uri() in raw
    assert re.search(r"\x1b\[32mquasi-static", raw)
    assert printed(console)[0].strip() == "pull-out stopped by hand"
    assert any("6.1e7 particle-steps/s" in line for line in printed(console))


def test_closing_block_says_only_what_it_was_told():
    console = pipe()
    closing_block("x", console=console, wall=0.0, steps=0, particles=3)
    assert [line.split()[0] for line in console.file.getvalue().splitlines()] == ["x", "wall", "speed"]


@pytest.mark.parametrize(
    ("check", "grade", "words"),
    [
        ({"kinetic_ratio": 0.0}, "good", "no kinetic energy"),
        ({"kinetic_ratio": 9.9e-4}, "good", "under 1e-3"),
        ({"kinetic_ratio": 3e-7}, "good", "under 1e-6"),
        ({"kinetic_ratio": 1e-3}, "fair", "reached 1e-3"),
        ({"kinetic_ratio": 0.2}, "bad", "not quasi-static: Ek/Es reached 0.2"),
        ({"kinetic_ratio": math.inf}, "bad", "reached inf"),
        ({"kinetic_ratio": math.nan}, "bad", "reached nan"),
        ({"energy_error": -5e-4}, "good", "energy closes"),
        ({"energy_error": 5e-3}, "fair", "nearly"),
        ({"energy_error": 0.1}, "bad", "do not trust"),
        ({"energy_error": math.nan}, "bad", "do not trust"),
        ({"unbalanced": 9e-4}, "good", "in equilibrium"),
        ({"unbalanced": 5e-3}, "fair", "not in equilibrium"),
        ({"unbalanced": math.nan}, "bad", "not in equilibrium"),
    ],
)
def test_verdicts(check, grade, words):
    (verdict,) = verdicts(**check)
    assert verdict.grade == grade
    assert words in verdict.words


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (8.1e7, "8.1e7"),
        (3e-3, "3e-3"),
        (0.0, "0"),
        (412.0, "412"),
        (0.25, "0.25"),
        (9999.7, "1e4"),
        (0.00999, "0.01"),
        (-2.04e-8, "-2e-8"),
        (1.0, "1"),
        (100.0, "100"),
        (99.96, "100"),
        (math.nan, "nan"),
        (-math.inf, "-inf"),
    ],
)
def test_compact(value, text):
    assert compact(value) == text


@given(st.floats(-1e300, 1e300), st.integers(1, 6))
def test_compact_keeps_its_digits(value, digits):
    text = compact(value, digits)
    assert math.isclose(float(text), value, rel_tol=0.5001 * 10.0 ** (1 - digits))
    assert len(text) <= digits + len("-0.00e-308")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.2e-3, "s", "1.2 ms"),
        (0.0, "s", "0 s"),
        (75.0, "s", "75 s"),
        (0.9999, "m", "1 m"),
        (2.6e-3, "m", "2.6 mm"),
        (1.633e7, "N", "16.3 MN"),
        (-3e10, "Pa", "-30 GPa"),
        (2.5e-4, "m^2", "2.5e-4 m^2"),  # a prefix would be squared with the unit
        (2500.0, "kg", "2500 kg"),
        (3e-14, "s", "3e-5 ns"),
        (1e-4, "", "1e-4"),
        (math.nan, "N", "nan N"),
    ],
)
def test_quantity(value, unit, text):
    assert quantity(value, unit) == text


@given(st.floats(1e-12, 1e12), st.sampled_from(["s", "m", "N", "Pa", "J", "m^2", "kg", ""]))
def test_si_scale_is_the_prefix_it_names(value, unit):
    factor, prefixed = si_scale(value, unit)
    meaning = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}[prefixed.removesuffix(unit)]
    assert math.isclose(factor * meaning, 1.0)


@pytest.mark.parametrize(
    ("seconds", "text"), [(21.4, "0:00:21"), (3599.6, "1:00:00"), (90061, "25:01:01"), (math.nan, "-:--:--")]
)
def test_duration(seconds, text):
    assert duration(seconds) == text
