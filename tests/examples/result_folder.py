"""Reading a result folder the way its user does: JSON, a spreadsheet, a picture viewer, ParaView."""

import csv
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Series(NamedTuple):
    """A VTKHDF time series: times [s], and points (n, 3), lines (m, 2), point and cell fields of the step asked for."""

    times: tuple[float, ...]
    points: Floats
    lines: NDArray[np.int64]
    point: dict[str, Any]
    cell: dict[str, Any]


def read_summary(folder: Path) -> dict[str, Any]:
    """Return summary.json."""
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return summary


def read_columns(path: Path) -> tuple[dict[str, Floats], dict[str, str]]:
    """Return the columns of a CSV file by name, and their units."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    names, units = zip(*(cell.removesuffix("]").split(" [") for cell in header), strict=True)
    values = np.array(rows, float)
    return dict(zip(names, values.T, strict=True)), dict(zip(names, units, strict=True))


def read_series(path: Path, step: int = -1) -> Series:
    """Return a time series at one of its steps, by VTK's own reader (ParaView's)."""
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOHDF import vtkHDFReader
    except ImportError:
        if os.environ.get("CI"):
            raise  # it is in the test extra: CI without it checks nothing here
        pytest.skip("vtk is not installed: pip install 'pybondem[test]'")
    reader: Any = vtkHDFReader()
    complaints: list[str] = []
    for event in ("ErrorEvent", "WarningEvent"):
        reader.AddObserver(event, lambda *_: complaints.append(path.name))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    reader.SetStep(step % reader.GetNumberOfSteps())
    reader.Update()
    assert not complaints, "the VTK reader complained, see its output"
    data, times = reader.GetOutput(), reader.GetOutputInformation(0).Get(reader.GetExecutive().TIME_STEPS())

    def fields(side: Any) -> dict[str, Any]:
        return {side.GetArrayName(k): vtk_to_numpy(side.GetArray(k)).copy() for k in range(side.GetNumberOfArrays())}

    lines = vtk_to_numpy(data.GetLines().GetConnectivityArray()).reshape(-1, 2).copy()
    points = vtk_to_numpy(data.GetPoints().GetData()).copy()
    return Series(times, points, lines, fields(data.GetPointData()), fields(data.GetCellData()))


def pictures(folder: Path) -> set[str]:
    """Return the names of the PNG files; fails where one cannot be read or is blank."""
    from matplotlib.image import imread

    found = sorted(folder.glob("*.png"))
    for path in found:
        image = imread(path)
        assert min(image.shape[:2]) > 200, path.name
        assert image[..., :3].std() > 0.01, f"{path.name} is blank"
    return {path.name for path in found}
