"""The history of a run as a CSV file: one row per record, readable at any moment, by anything."""

from __future__ import annotations

import csv
import math
import numbers
import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from pybondem.errors import InputError

_HEADER_CELL = re.compile(r"(?P<name>[^\[\]]*\S)\s*\[(?P<unit>[^\[\]]*)\]")
_FORBIDDEN = set('[]",\n\r')


class HistoryWriter:
    """Appends rows of numbers to a CSV file whose header cells read ``name [unit]``.

    Every row goes to the system in one write, so a run that is killed leaves whole lines only. Numbers are written
    with all their digits: reading gives back the same bits.

    Parameters
    ----------
    path : the file to make; its folder must exist, the file must not.
    columns : unit of each column by name, in the order of the file; ``""`` for a number without a unit.

    Raises
    ------
    InputError : no columns, a name or unit that CSV cannot hold, a file that is already there, no such folder.
    """

    def __init__(self, path: str | Path, columns: Mapping[str, str]) -> None:
        self.path = Path(path)
        self.columns = dict(columns)
        if not self.columns:
            raise InputError(f"history {self.path}: columns is empty; give at least one, such as {{'t': 's'}}.")
        for name, unit in self.columns.items():
            _check_header(self.path, name, unit)
        try:
            self._file = self.path.open("xb", buffering=0)
        except OSError as err:
            raise InputError(f"history {self.path} cannot be made: {err.strerror}; choose another folder.") from err
        self._write(",".join(f"{name} [{unit}]" for name, unit in self.columns.items()))

    def append(self, row: Mapping[str, float]) -> None:
        """Write one row: a number for every column, in SI units. NaN is allowed and means "not known here".

        Raises
        ------
        InputError : a column is missing or unknown, a value is not a single real number, or the writer is closed.
        """
        if self._file.closed:
            raise InputError(f"history {self.path} is closed; append before close().")
        if row.keys() != self.columns.keys():
            self._refuse_names(row)
        self._write(",".join(_cell(self.path, name, row[name]) for name in self.columns))

    def close(self) -> None:
        """Close the file. Closing twice is harmless."""
        self._file.close()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, line: str) -> None:
        rest = memoryview(f"{line}\n".encode())
        while rest:  # a raw write may take only part of the line, on a full disk for instance
            rest = rest[self._file.write(rest) :]

    def _refuse_names(self, row: Mapping[str, float]) -> None:
        for name in row:
            if name not in self.columns:
                near = get_close_matches(str(name), self.columns, n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"the columns are {', '.join(self.columns)}."
                raise InputError(f"history {self.path.name}: no column is named {name!r}; {hint}")
        missing = ", ".join(repr(name) for name in self.columns if name not in row)
        raise InputError(f"history {self.path.name}: the row lacks {missing}; give NaN where a value is not known.")


def read_history(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Columns of a history file by name (units stripped), each a float64 array of shape (rows,).

    A last line without its line end, left by a machine that lost power, is ignored.

    Raises
    ------
    InputError : there is no such file, its header is not ``name [unit], ...``, or a cell is not a number.
    """
    path = Path(path)
    names = list(read_units(path))
    text = path.read_text(encoding="utf-8")
    lines = text[: text.rfind("\n") + 1].splitlines()[1:]
    rows = np.empty((len(lines), len(names)))
    for k, line in enumerate(lines):
        cells = line.split(",")
        if len(cells) != len(names):
            raise InputError(f"history {path}: line {k + 2} has {len(cells)} cells, the header has {len(names)}.")
        try:
            rows[k] = [float(cell) for cell in cells]
        except ValueError as err:
            raise InputError(f"history {path}: line {k + 2} holds a cell that is not a number ({err}).") from err
    return {name: rows[:, c].copy() for c, name in enumerate(names)}


def read_units(path: str | Path) -> dict[str, str]:
    """Unit of each column of a history file by name, in the order of the file; ``""`` for a number without a unit.

    Raises
    ------
    InputError : there is no such file, or its first line is not ``name [unit], ...``.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header = next(csv.reader(file), [])
    except OSError as err:
        raise InputError(f"history {path} cannot be read: {err.strerror}.") from err
    cells = [_HEADER_CELL.fullmatch(cell.strip()) for cell in header]
    if not cells or None in cells:
        raise InputError(f"{path} is not a history file: its first line must read 'name [unit],name [unit],...'.")
    return {cell["name"]: cell["unit"] for cell in cells if cell is not None}


def _check_header(path: Path, name: str, unit: str) -> None:
    if not isinstance(name, str) or not name.strip() or name != name.strip() or _FORBIDDEN & set(name):
        raise InputError(
            f"history {path.name}: column name {name!r} cannot be used; take letters, digits, spaces and '_', "
            "without brackets, commas or quotes."
        )
    if not isinstance(unit, str) or _FORBIDDEN & set(unit):
        raise InputError(f"history {path.name}: unit {unit!r} of column {name!r} must be text such as 'N' or ''.")


def _cell(path: Path, name: str, value: float) -> str:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, np.bool_ | bool | numbers.Integral):
        return str(int(value))
    if not isinstance(value, numbers.Real):
        raise InputError(f"history {path.name}: column {name!r} got {value!r}; give a single real number in SI units.")
    number = float(value)
    return repr(number) if math.isfinite(number) else str(number)
