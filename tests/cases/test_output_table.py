"""The history file: exact numbers, whole lines, and readers that are not ours."""

import csv
import math
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pybondem.errors import InputError
from pybondem.output.table import HistoryWriter, read_history, read_units

COLUMNS = {"t": "s", "load": "N", "Ek/Es": "", "broken": ""}


def test_header_and_rows_as_any_csv_reader_sees_them(tmp_path):
    with HistoryWriter(tmp_path / "h.csv", COLUMNS) as history:
        history.append({"t": 0.0, "load": 1.5e6, "Ek/Es": 1e-4, "broken": 0})
        history.append({"broken": np.int64(7), "t": 1e-3, "load": np.float64(-2.25), "Ek/Es": math.nan})
    with (tmp_path / "h.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t [s]", "load [N]", "Ek/Es []", "broken []"]
    assert [float(cell) for cell in rows[1]] == [0.0, 1.5e6, 1e-4, 0.0]
    assert rows[2][0:2] == ["0.001", "-2.25"]
    assert rows[2][2:] == ["nan", "7"]
    assert len(rows) == 3


@given(st.lists(st.tuples(st.floats(), st.floats(), st.integers(-(2**53), 2**53)), max_size=20))
def test_reading_gives_back_the_same_bits(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("history") / "h.csv"
    with HistoryWriter(path, {"a": "m/s", "b": "", "n": ""}) as history:
        for a, b, n in rows:
            history.append({"a": a, "b": b, "n": n})
    back = read_history(path)
    assert list(back) == ["a", "b", "n"]
    assert read_units(path) == {"a": "m/s", "b": "", "n": ""}
    for c, name in enumerate(back):
        expected = np.array([row[c] for row in rows], dtype=np.float64)
        assert back[name].shape == expected.shape
        np.testing.assert_array_equal(back[name], expected)
        finite = np.isfinite(expected)
        np.testing.assert_array_equal(np.signbit(back[name][finite]), np.signbit(expected[finite]))  # -0.0 stays -0.0


def test_every_row_is_on_disk_when_append_returns(tmp_path):
    with HistoryWriter(tmp_path / "h.csv", {"t": "s"}) as history:
        for k in range(5):
            history.append({"t": k})
            np.testing.assert_array_equal(read_history(tmp_path / "h.csv")["t"], np.arange(k + 1))


WRITER = """
import sys
from pybondem.output.table import HistoryWriter

columns = {f"column {c}": "m" for c in range(400)}
history = HistoryWriter(sys.argv[1], columns)
k = 0
while True:
    history.append({name: k + 1 / 3 for name in columns})  # lines of 8 kB, longer than a usual buffer
    k += 1
    print(k, flush=True)
"""


def test_a_kill_leaves_whole_lines(tmp_path):
    path = tmp_path / "h.csv"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    first = process.stdout.readline()
    time.sleep(0.1)
    process.kill()
    reported = int((first + process.stdout.read()).rsplit(b"\n", 2)[-2])
    process.wait()
    process.stdout.close()
    text = path.read_text()
    assert text.endswith("\n")
    assert {line.count(",") for line in text.splitlines()} == {399}
    history = read_history(path)
    rows = len(history["column 0"])
    assert rows >= reported >= 1
    np.testing.assert_array_equal(history["column 399"], np.arange(rows) + 1 / 3)


def test_a_torn_last_line_is_left_out(tmp_path):
    path = tmp_path / "h.csv"
    path.write_text("t [s],load [N]\n0.0,1.0\n0.1,2.5\n0.2,3.")
    np.testing.assert_array_equal(read_history(path)["load"], [1.0, 2.5])


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"t": 0.0}, "lacks 'load'"),
        ({"t": 0.0, "laod": 1.0}, "no column is named 'laod'; did you mean 'load'"),
        ({"t": 0.0, "load": 1.0, "zzz": 1.0}, "no column is named 'zzz'; the columns are t, load"),
        ({"t": 0.0, "load": "1.0"}, "column 'load' got '1.0'"),
        ({"t": 0.0, "load": np.zeros(3)}, "give a single real number"),
        ({"t": 0.0, "load": 1j}, "give a single real number"),
        ({"t": 0.0, "load": None}, "give a single real number"),
    ],
)
def test_bad_rows_are_refused_and_write_nothing(tmp_path, row, words):
    with HistoryWriter(tmp_path / "h.csv", {"t": "s", "load": "N"}) as history:
        with pytest.raises(InputError, match=words):
            history.append(row)
        history.append({"t": 1.0, "load": np.array(2.0)})
    np.testing.assert_array_equal(read_history(tmp_path / "h.csv")["load"], [2.0])


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({}, "columns is empty"),
        ({"a,b": "m"}, "column name 'a,b'"),
        ({"a [m]": "m"}, "column name"),
        ({" ": "m"}, "column name"),
        ({"a": "m]"}, "unit 'm]'"),
        ({"a": None}, "unit None"),
    ],
)
def test_bad_columns_are_refused_and_leave_no_file(tmp_path, columns, words):
    with pytest.raises(InputError, match=words):
        HistoryWriter(tmp_path / "h.csv", columns)
    assert not (tmp_path / "h.csv").exists()


def test_files_that_are_in_the_way_or_missing_are_named(tmp_path):
    HistoryWriter(tmp_path / "h.csv", {"t": "s"}).close()
    with pytest.raises(InputError, match="cannot be made: File exists"):
        HistoryWriter(tmp_path / "h.csv", {"t": "s"})
    with pytest.raises(InputError, match="cannot be made: No such file"):
        HistoryWriter(tmp_path / "absent" / "h.csv", {"t": "s"})
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_history(tmp_path / "absent.csv")


def test_a_closed_history_refuses_rows(tmp_path):
    history = HistoryWriter(tmp_path / "h.csv", {"t": "s"})
    history.close()
    history.close()
    with pytest.raises(InputError, match="is closed"):
        history.append({"t": 0.0})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not a history file"),
        ("t,load\n0,1\n", "is not a history file"),
        ("t [s],load [N]\n0,1\n0\n", "line 3 has 1 cells, the header has 2"),
        ("t [s],load [N]\n0,one\n", "line 2 holds a cell that is not a number"),
    ],
)
def test_files_that_are_no_history_are_refused(tmp_path, text, words):
    (tmp_path / "h.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_history(tmp_path / "h.csv")
