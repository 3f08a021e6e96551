"""Time series of particles and bonds that ParaView opens: temporal VTKHDF 2.0 PolyData, written through h5py.

Format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html
Every step has one part. Topology and constant fields lie in the file once, at offset 0, for all steps; positions and
changing fields are appended, and the ``Steps`` group says at which row each step begins.

Crash safety rests on three choices. The file format is HDF5's earliest, which keeps no "open for writing" mark that a
killed process would leave behind. A chunk belongs to one step and is written once. ``NSteps`` is raised only after the
step it counts has been handed to the system, so readers never see a part of a step. Its time alone goes to the system
together with ``NSteps``, and after it: VTK reads all of ``Values`` into memory for ``NSteps`` numbers, and a file with
one time more makes it write beyond them.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from pybondem.errors import InputError

if TYPE_CHECKING:
    import h5py

Array = NDArray[Any]

DISPLACEMENT = "displacement"
_TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")  # in the order of the columns of CellOffsets
_CHUNK_BYTES = 1 << 20  # a step of a large field is cut into chunks of about this size
_STEPS_PER_CHUNK = 1024  # of the small arrays that hold one row a step


class VtkSeries:
    """One ``.vtkhdf`` file that grows by a step at each :meth:`append`.

    Without ``pairs`` every particle is a vertex; with ``pairs`` every bond is a line between two particle positions,
    and the cells are the bonds. Positions are kept in float64: in float32 a displacement of 1e-5 of the model's size
    would come back with an error of a percent. The point field ``displacement`` is added by itself: position less
    reference position, taken in float64, for ParaView's *Warp By Vector* to magnify.

    The file is not locked, so ParaView can open it while the run goes on (*Reload Files* shows new steps).

    Parameters
    ----------
    path : the file to make (``.vtkhdf``); its folder must exist, the file must not.
    points : (n, 3) reference positions, m: those that ``displacement`` is measured from.
    pairs : (m, 2) int, particles at the two ends of each bond; None for a series of particles.
    point_fields, cell_fields : components of each field by name, such as ``{"velocity": 3}``.
    point_constants, cell_constants : fields that never change, written once, with their own type: (n,) or (n, c) per
        particle, (m,) or (m, c) per cell.
    dtype : type that changing fields are kept in, float32 or float64.
    compress : lossless gzip (level 1, shuffled): smaller, and slower to write.

    Raises
    ------
    InputError : the file exists or cannot be made, or an argument has a wrong shape, type, index or name.
    """

    def __init__(
        self,
        path: str | Path,
        points: ArrayLike,
        *,
        pairs: ArrayLike | None = None,
        point_fields: Mapping[str, int] | None = None,
        cell_fields: Mapping[str, int] | None = None,
        point_constants: Mapping[str, ArrayLike] | None = None,
        cell_constants: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float32,
        compress: bool = True,
    ) -> None:
        self.path = Path(path)
        self.steps = 0  #: steps written so far
        self._where = self.path.name
        self._last_time = -np.inf
        self._dtype = np.dtype(dtype)
        if self._dtype not in (np.float32, np.float64):
            raise InputError(f"{self._where}: dtype {self._dtype} cannot be used; take float32 or float64.")
        self._reference = _checked_points(points, None, self._where).copy()
        particles = len(self._reference)
        lines = None if pairs is None else _checked_pairs(pairs, particles, self._where)
        self._counts = {"PointData": particles, "CellData": particles if lines is None else len(lines)}
        self._components = {"PointData": dict(point_fields or {}), "CellData": dict(cell_fields or {})}
        constants = {
            "PointData": self._checked_constants("PointData", point_constants or {}),
            "CellData": self._checked_constants("CellData", cell_constants or {}),
        }
        for kind, fields in self._components.items():
            self._check_names(kind, fields, constants[kind])
        self._components["PointData"][DISPLACEMENT] = 3
        self._compress = compress
        self._file = _new_file(self.path)
        self._lay_out(lines, constants)
        self._file.flush()

    def append(
        self,
        time: float,
        points: ArrayLike,
        *,
        point_data: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Add a step and hand it to the system: a process killed after this call loses nothing of it.

        Parameters
        ----------
        time : s, later than that of the step before.
        points : (n, 3) positions, m.
        point_data : every field of ``point_fields``: (n,), or (n, c) with c components. NaN is allowed.
        cell_data : every field of ``cell_fields``: (m,) or (m, c). NaN is allowed.

        Raises
        ------
        InputError : time that does not advance, positions that are not finite, or missing, unknown or misshapen fields.
        """
        if not self._file:
            raise InputError(f"{self._where} is closed; append before close().")
        if not np.isfinite(time) or time <= self._last_time:
            raise InputError(
                f"{self._where}: step {self.steps} has t = {time} s; it must be after {self._last_time} s."
            )
        x = _checked_points(points, len(self._reference), f"{self._where}: step {self.steps}")
        if DISPLACEMENT in (point_data or {}):
            raise InputError(f"{self._where}: the field {DISPLACEMENT!r} is made here; leave it out of point_data.")
        rows = {"Points": x}
        rows |= self._checked_data("PointData", {**(point_data or {}), DISPLACEMENT: x - self._reference})
        rows |= self._checked_data("CellData", cell_data or {})
        self._write_step(float(time), rows)

    def close(self) -> None:
        """Close the file. Closing twice is harmless."""
        self._file.close()

    def __enter__(self) -> VtkSeries:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _lay_out(self, lines: Array | None, constants: Mapping[str, Mapping[str, Array]]) -> None:
        """Write what all steps share; make empty what grows: ``_rows`` (data) and ``_per_step`` (a row a step)."""
        particles = len(self._reference)
        root = self._file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        root.attrs["Type"] = np.bytes_(b"PolyData")
        root["NumberOfPoints"] = np.array([particles], dtype=np.int64)
        _write_topology(root, np.arange(particles)[:, None] if lines is None else lines)
        self._rows: dict[str, h5py.Dataset] = {"Points": self._growing(root, "Points", particles, (3,), np.float64)}
        self._steps_group = root.create_group("Steps")
        self._steps_group.attrs["NSteps"] = np.int64(0)
        self._per_step: dict[str, h5py.Dataset] = {}
        self._one_row_a_step("Values", dtype=np.float64)
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            self._one_row_a_step(name)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            self._one_row_a_step(name, columns=(len(_TOPOLOGIES),))
        for kind, count in self._counts.items():
            group = root.create_group(kind)
            for name, values in constants[kind].items():
                group[name] = values
                self._one_row_a_step(f"{kind}Offsets/{name}")
            for name, components in self._components[kind].items():
                shape = (components,) if components > 1 else ()
                self._rows[f"{kind}/{name}"] = self._growing(group, name, count, shape, self._dtype)
                self._one_row_a_step(f"{kind}Offsets/{name}")

    def _growing(
        self, group: h5py.Group, name: str, count: int, shape: tuple[int, ...], dtype: DTypeLike
    ) -> h5py.Dataset:
        """An empty dataset for the rows of all steps, in chunks that never straddle two steps."""
        rows = max(count, 1)
        pieces = ceil(rows * np.dtype(dtype).itemsize * int(np.prod(shape)) / _CHUNK_BYTES)
        packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if self._compress else {}
        chunks = (ceil(rows / pieces), *shape)
        return group.create_dataset(
            name, shape=(0, *shape), maxshape=(None, *shape), chunks=chunks, dtype=dtype, **packing
        )

    def _one_row_a_step(self, name: str, columns: tuple[int, ...] = (), dtype: DTypeLike = np.int64) -> None:
        self._per_step[name] = self._steps_group.create_dataset(
            name, shape=(0, *columns), maxshape=(None, *columns), chunks=(_STEPS_PER_CHUNK, *columns), dtype=dtype
        )

    def _write_step(self, time: float, rows: Mapping[str, Array]) -> None:
        entry = dict.fromkeys(self._per_step, 0) | {"NumberOfParts": 1}
        for name, values in rows.items():
            begin = _write_at_step(self._rows[name], self.steps, values)
            entry["PointOffsets" if name == "Points" else name.replace("Data/", "DataOffsets/", 1)] = begin
        times = self._per_step["Values"]
        for name, dataset in self._per_step.items():
            if dataset is not times:
                _write_row(dataset, self.steps, entry[name])
        self._file.flush()
        self._steps_group.attrs.modify("NSteps", np.int64(self.steps + 1))
        _write_row(times, self.steps, time)
        self._file.flush()
        self.steps += 1
        self._last_time = time

    def _check_names(self, kind: str, fields: Mapping[str, int], constants: Mapping[str, Array]) -> None:
        for name in [*fields, *constants]:
            if not isinstance(name, str) or not name or "/" in name or name == ".":
                raise InputError(f"{self._where}: field name {name!r} cannot be used; it must be text without '/'.")
            if kind == "PointData" and name == DISPLACEMENT:
                raise InputError(f"{self._where}: the field {name!r} is made here; give yours another name.")
            if name in fields and name in constants:
                raise InputError(f"{self._where}: {name!r} is both a field and a constant; name it once.")
        for name, components in fields.items():
            if isinstance(components, bool) or not isinstance(components, int) or components < 1:
                raise InputError(
                    f"{self._where}: field {name!r} has {components!r} components; give 1 for a scalar, 3 for a "
                    "vector, 9 for a tensor."
                )

    def _checked_constants(self, kind: str, constants: Mapping[str, ArrayLike]) -> dict[str, Array]:
        checked = {}
        for name, given in constants.items():
            values = _plain_array(given, f"{self._where}: constant {name!r}")
            if values.ndim not in (1, 2) or len(values) != self._counts[kind]:
                raise InputError(
                    f"{self._where}: constant {name!r} has shape {values.shape}; it needs {self._counts[kind]} rows."
                )
            checked[name] = values.astype(np.uint8) if values.dtype == bool else values
        return checked

    def _checked_data(self, kind: str, data: Mapping[str, ArrayLike]) -> dict[str, Array]:
        fields = self._components[kind]
        if data.keys() != fields.keys():
            odd = sorted(data.keys() ^ fields.keys())[0]
            trouble = "is missing from" if odd in fields else "was not declared, but is in"
            raise InputError(f"{self._where}: field {odd!r} {trouble} the {kind} of step {self.steps}.")
        rows = {}
        for name, given in data.items():
            values = _plain_array(given, f"{self._where}: field {name!r} of step {self.steps}")
            shape = (self._counts[kind], fields[name]) if fields[name] > 1 else (self._counts[kind],)
            if values.shape != shape and values.shape != (*shape, 1):
                raise InputError(
                    f"{self._where}: field {name!r} of step {self.steps} has shape {values.shape}; it must be {shape}."
                )
            with np.errstate(over="ignore"):  # beyond float32 is shown as infinite
                rows[f"{kind}/{name}"] = values.reshape(shape).astype(self._dtype)
        return rows


def _new_file(path: Path) -> h5py.File:
    import h5py

    try:
        # No lock: file systems of clusters often refuse it, and ParaView may look while the run goes on.
        return h5py.File(path, "x", libver="earliest", locking=False)
    except FileExistsError as err:
        raise InputError(f"{path} exists; nothing is overwritten, choose another name.") from err
    except OSError as err:
        raise InputError(f"{path} cannot be made; its folder must exist and be writable.") from err


def _write_topology(root: h5py.Group, cells: Array) -> None:
    """Write the four kinds of cells of a PolyData, all empty but one: vertices (n, 1) or lines (m, 2)."""
    per_cell = cells.shape[1]
    own = "Vertices" if per_cell == 1 else "Lines"
    for name in _TOPOLOGIES:
        ends = cells if name == own else cells[:0]
        group = root.create_group(name)
        group["NumberOfCells"] = np.array([len(ends)], dtype=np.int64)
        group["NumberOfConnectivityIds"] = np.array([ends.size], dtype=np.int64)
        group["Offsets"] = np.arange(0, ends.size + 1, per_cell, dtype=np.int64)
        group["Connectivity"] = ends.reshape(-1).astype(np.int64)


def _write_at_step(dataset: h5py.Dataset, step: int, values: Array) -> int:
    """Write the rows of a step from a chunk border on, and return the row where they begin."""
    chunk: int = dataset.chunks[0]
    begin = step * chunk * ceil(len(values) / chunk)
    dataset.resize(begin + len(values), axis=0)
    dataset[begin:] = values
    return begin


def _write_row(dataset: h5py.Dataset, step: int, value: float) -> None:
    """Write what a dataset with one row a step has to say of a step."""
    dataset.resize(step + 1, axis=0)
    dataset[step] = value


def _plain_array(given: ArrayLike, where: str) -> Array:
    """The values as an array of real numbers or truth values."""
    values = np.asanyarray(given)
    if isinstance(values, np.ma.MaskedArray) or values.dtype.kind not in "fiub":
        raise InputError(f"{where} must be real numbers, not {type(given).__name__} of {values.dtype}.")
    return np.asarray(values)


def _checked_points(given: ArrayLike, count: int | None, where: str) -> NDArray[np.float64]:
    x = _plain_array(given, f"{where}: points").astype(np.float64)
    if x.ndim != 2 or x.shape[1] != 3 or len(x) == 0 or (count is not None and len(x) != count):
        raise InputError(f"{where}: points has shape {x.shape}; it must be ({count or 'n'}, 3).")
    bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if bad.size:
        raise InputError(f"{where}: particle {bad[0]} is at {x[bad[0]].tolist()}; positions must be finite numbers.")
    return x


def _checked_pairs(given: ArrayLike, particles: int, where: str) -> Array:
    pairs = _plain_array(given, f"{where}: pairs")
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise InputError(f"{where}: pairs is {pairs.dtype} of shape {pairs.shape}; it must be whole numbers, (m, 2).")
    bad = np.flatnonzero(((pairs < 0) | (pairs >= particles)).any(axis=1))
    if bad.size:
        raise InputError(
            f"{where}: bond {bad[0]} joins particles {pairs[bad[0]].tolist()}; indices run from 0 to {particles - 1}."
        )
    return pairs
