"""Particles from and to a table: text (.csv, .txt, .tsv) or NumPy (.npy, .npz).

The columns are x, y, z and radius or diameter, all in metres, in any order and no others.

- Text: UTF-8 with or without byte-order mark; the first line names the columns; numbers with a decimal point, separated
  by commas, or by tabs throughout. Blank lines are skipped. Every line must end, the last one too: a file that was cut
  short is refused, not read with its last number shortened.
- .npy: a structured array with these fields, or a plain (n, 4) array of x, y, z, radius.
- .npz: one array (n,) per column.

NumPy files are never unpickled: a table cannot run code.
"""

import csv
import os
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from pybondem.check import SMALLEST, Floats, choice, finite_array, nearest, positive_array
from pybondem.errors import InputError
from pybondem.packing.particles import Particles

COLUMNS = ("x", "y", "z", "radius", "diameter")
WRITTEN = COLUMNS[:4]
TEXT, NUMPY = (".csv", ".txt", ".tsv"), (".npy", ".npz")


def read_table(path: str | os.PathLike[str]) -> Particles:
    """Return the particles of a table, in its order.

    path: ends in .csv, .txt or .tsv (text) or in .npy or .npz (NumPy); the columns are described at the top of this
    module. Raises InputError that names the file and, for text, the line and the column, for: no such file, an
    empty one, a column missing, unknown (with the nearest name) or given twice, both radius and diameter, cells too
    many or too few, a cell that is not a finite number, a decimal comma, a radius that is not positive, a file that was
    cut short, and NumPy files that are damaged or hold objects.
    """
    file = Path(path)
    suffix = choice(f"Ending of {file.name}", file.suffix.lower(), TEXT + NUMPY)
    if not file.is_file():
        raise InputError(f"{file.name} is not there, or is not a file.")
    if file.stat().st_size == 0:
        raise InputError(f"{file.name} is empty; its first line must name the columns x, y, z, radius.")
    return _read_text(file) if suffix in TEXT else _read_numpy(file)


def write_table(path: str | os.PathLike[str], particles: Particles) -> None:
    """Write the columns x, y, z, radius [m] of particles, such that `read_table` returns the same bits.

    path: ends in .csv (text with commas), .npy (structured) or .npz. An existing file is replaced at once when all is
    written, never left half written. Raises InputError for another ending, for a folder that is not there and for what
    is not Particles; OSError where the disk refuses.
    """
    file = Path(path)
    suffix = choice(f"Ending of {file.name}", file.suffix.lower(), (".csv", *NUMPY))
    if not isinstance(particles, Particles):
        raise InputError(f"write_table got {type(particles).__name__}; it writes Particles.")
    if not file.parent.is_dir():
        raise InputError(f"{file.name} cannot be written; its folder {file.parent.name} is not there.")
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as out:
            columns = dict(zip(WRITTEN, [*particles.x.T, particles.radius], strict=True))
            if suffix == ".csv":
                out.writelines(_lines(columns))
            elif suffix == ".npy":
                np.save(out, _records(columns))
            else:
                np.savez(out, **columns)
            out.flush()
            os.fsync(out.fileno())
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def _lines(columns: dict[str, Floats]) -> Iterator[bytes]:
    yield (",".join(columns) + "\n").encode()
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        yield (",".join(map(repr, row)) + "\n").encode()


def _records(columns: dict[str, Floats]) -> np.ndarray:
    records = np.empty(len(columns["x"]), dtype=[(name, "<f8") for name in columns])
    for name, column in columns.items():
        records[name] = column
    return records


def _read_text(file: Path) -> Particles:
    with file.open("rb") as binary:
        binary.seek(-1, os.SEEK_END)
        ended = binary.read() in (b"\n", b"\r")
    try:
        with file.open(newline="", encoding="utf-8-sig") as text:
            first = text.readline()
            delimiter = "\t" if "\t" in first else ","
            names = _header(file.name, first, delimiter)
            values, lines = _cells(file.name, text, delimiter, names)
    except UnicodeDecodeError:
        raise InputError(f"{file.name} is not UTF-8 text; save it as CSV in UTF-8.") from None
    except csv.Error as error:
        raise InputError(f"{file.name} is not a table: {error}.") from None
    if not ended:
        raise InputError(
            f"{file.name} ends within a line; it may have been cut short (if not, add a final line break)."
        )
    if len(values) == 0:
        raise InputError(f"{file.name} has a header but no particles.")
    for k, name in enumerate(names):
        least = -np.inf if name in "xyz" else SMALLEST
        bad = ~(np.isfinite(values[:, k]) & (values[:, k] >= least))
        if np.any(bad):
            row = int(np.argmax(bad))
            must = "finite" if name in "xyz" else "positive and finite"
            raise InputError(f"{file.name}, line {lines[row]}, column {name}: {values[row, k]} must be {must}.")
    return _particles(dict(zip(names, values.T, strict=True)))


def _header(name: str, line: str, delimiter: str) -> list[str]:
    words = [word.strip() for word in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    if len(words) == 1 and ";" in line:
        raise InputError(f"{name}, line 1: columns are separated by ';'; use commas, and a point in numbers.")
    if not any(words) or any(_is_number(word) for word in words):
        raise InputError(f"{name}, line 1: {line.strip()[:60]!r} must name the columns, for example x,y,z,radius.")
    _check_columns(f"{name}, line 1", words)
    return words


def _check_columns(where: str, names: Iterable[str]) -> None:
    names = list(names)
    for name in names:
        if name not in COLUMNS:
            raise InputError(
                f"{where}: column {name!r} is unknown{nearest(name, COLUMNS)}; the columns are x, y, z and radius or "
                "diameter."
            )
        if names.count(name) > 1:
            raise InputError(f"{where}: column {name!r} is given {names.count(name)} times; give it once.")
    missing = [name for name in "xyz" if name not in names]
    if missing or not {"radius", "diameter"} & set(names):
        what = repr(missing[0]) if missing else "'radius' (or 'diameter')"
        raise InputError(f"{where}: column {what} is missing; got {', '.join(names)}.")
    if {"radius", "diameter"} <= set(names):
        raise InputError(f"{where}: both 'radius' and 'diameter' are given; give one of them.")


def _cells(name: str, text: TextIO, delimiter: str, names: Sequence[str]) -> tuple[Floats, Sequence[int]]:
    """Return the numbers (n, columns) below the header, and the line of each row."""
    numbers, lines = array("d"), array("q")
    rows = csv.reader(text, delimiter=delimiter, skipinitialspace=True, strict=True)
    for row in rows:
        if len(row) != len(names):
            if not any(cell.strip() for cell in row):
                continue
            raise InputError(_miscounted(f"{name}, line {1 + rows.line_num}", len(row), len(names), delimiter))
        try:
            numbers.extend([float(cell) for cell in row])
        except ValueError:
            raise InputError(_not_a_number(f"{name}, line {1 + rows.line_num}", row, names)) from None
        lines.append(1 + rows.line_num)
    return np.array(numbers, dtype=np.float64).reshape(-1, len(names)), lines


def _miscounted(where: str, cells: int, columns: int, delimiter: str) -> str:
    if cells < columns:
        hint = "the file may have been cut short, or change its separator"
    else:
        hint = "write numbers with a decimal point, not a comma" if delimiter == "," else "remove what is too much"
    return f"{where}: {cells} cells for {columns} columns; {hint}."


def _not_a_number(where: str, row: Sequence[str], names: Sequence[str]) -> str:
    cell, column = next((cell, column) for cell, column in zip(row, names, strict=True) if not _is_number(cell))
    hint = "; write it with a decimal point" if _is_number(cell.replace(",", ".")) else ""
    return f"{where}, column {column}: {cell[:40]!r} is not a number{hint}."


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _read_numpy(file: Path) -> Particles:
    try:
        with file.open("rb") as binary:
            found = np.load(binary, allow_pickle=False)
            if isinstance(found, np.ndarray):
                columns = _fields(file.name, found)
            else:
                _check_columns(file.name, found.files)
                columns = {name: found[name] for name in found.files}
    except InputError:
        raise
    except Exception as error:  # NumPy and zipfile raise a dozen kinds on bytes that are not what they say
        if "pickle" in str(error):
            raise InputError(
                f"{file.name} is no NumPy file or holds Python objects, which are never loaded; save plain numbers."
            ) from None
        raise InputError(f"{file.name} is damaged or cut short ({type(error).__name__}).") from None
    for name, column in columns.items():
        check = finite_array if name in "xyz" else positive_array
        columns[name] = check(f"{file.name}: {name}", column, (None,))
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputError(f"{file.name}: columns have different lengths ({listed}); give one value per particle.")
    if not lengths["x"]:
        raise InputError(f"{file.name} has no particles.")
    return _particles(columns)


def _fields(name: str, found: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of the array of a .npy file."""
    if found.dtype.names is not None:
        _check_columns(name, found.dtype.names)
        return {field: found[field] for field in found.dtype.names}
    if found.ndim != 2 or found.shape[1] != len(WRITTEN):
        raise InputError(f"{name} has shape {found.shape}; it must be (n, 4) with the columns x, y, z, radius.")
    return dict(zip(WRITTEN, found.T, strict=True))


def _particles(columns: dict[str, np.ndarray]) -> Particles:
    radius = columns["radius"] if "radius" in columns else 0.5 * columns["diameter"]
    return Particles(np.stack([columns[name] for name in "xyz"], axis=1), radius)
