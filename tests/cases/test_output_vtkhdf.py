"""The ParaView files: read back by VTK's own reader, looked at with plain h5py, and killed while they are written."""

import os
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.output.vtkhdf import VtkSeries

N, M, STEPS = 40, 70, 4


def model():
    rng = np.random.default_rng(7)
    return rng.random((N, 3)) * 30.0, rng.integers(0, N, (M, 2))


def frame(k):
    """Positions and fields of step k: every number differs from step to step and from row to row."""
    x, _ = model()
    x = x + 1e-5 * k * np.sin(x)
    point = {"velocity": x * (k + 1), "temperature": x[:, 0] - k}
    cell = {"force": np.arange(3.0 * M).reshape(M, 3) + k, "damage": np.arange(M) / M + k, "broken": np.arange(M) < k}
    return x, point, cell


def write_bonds(path, **more):
    x, pairs = model()
    series = VtkSeries(
        path,
        x,
        pairs=pairs,
        point_fields={"velocity": 3, "temperature": 1},
        cell_fields={"force": 3, "damage": 1, "broken": 1},
        point_constants={"radius": np.linspace(0.1, 0.2, N)},
        cell_constants={"law": np.arange(M)},
        **more,
    )
    with series:
        for k in range(STEPS):
            now, point, cell = frame(k)
            series.append(0.25 * k, now, point_data=point, cell_data=cell)
    return pairs


def vtk_reader(path):
    try:
        from vtkmodules.vtkIOHDF import vtkHDFReader
    except ImportError:
        if os.environ.get("CI"):
            raise  # it is in the test extra: CI without it checks nothing here
        pytest.skip("vtk is not installed: pip install 'pybondem[test]'")
    reader = vtkHDFReader()
    complaints = []
    for event in ("ErrorEvent", "WarningEvent"):
        reader.AddObserver(event, lambda *_: complaints.append("the VTK reader complained, see its output"))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    assert not complaints, complaints
    return reader, complaints


def read_step(reader, complaints, k):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    reader.SetStep(k)
    reader.Update()
    assert not complaints, complaints
    data = reader.GetOutput()

    def arrays(side):
        return {side.GetArrayName(i): vtk_to_numpy(side.GetArray(i)) for i in range(side.GetNumberOfArrays())}

    points = vtk_to_numpy(data.GetPoints().GetData())
    return data, points, arrays(data.GetPointData()), arrays(data.GetCellData()), vtk_to_numpy


def test_vtk_reads_bonds_at_every_step(tmp_path):
    pairs = write_bonds(tmp_path / "bonds.vtkhdf")
    reader, complaints = vtk_reader(tmp_path / "bonds.vtkhdf")
    assert reader.GetNumberOfSteps() == STEPS
    times = reader.GetOutputInformation(0).Get(reader.GetExecutive().TIME_STEPS())
    assert times == tuple(0.25 * k for k in range(STEPS))
    start = model()[0]
    for k in (2, 0, 3, 1):  # a viewer jumps about
        data, points, point, cell, to_numpy = read_step(reader, complaints, k)
        x, expected_point, expected_cell = frame(k)
        np.testing.assert_array_equal(points, x)
        assert data.GetNumberOfVerts() == 0
        assert data.GetNumberOfLines() == data.GetNumberOfCells() == M
        np.testing.assert_array_equal(to_numpy(data.GetLines().GetConnectivityArray()).reshape(M, 2), pairs)
        np.testing.assert_array_equal(to_numpy(data.GetLines().GetOffsetsArray()), 2 * np.arange(M + 1))
        assert set(point) == {"velocity", "temperature", "radius", "displacement"}
        assert set(cell) == {"force", "damage", "broken", "law"}
        for name, values in expected_point.items():
            np.testing.assert_array_equal(point[name], values.astype(np.float32))
        for name, values in expected_cell.items():
            np.testing.assert_array_equal(cell[name], values.astype(np.float32))
        np.testing.assert_array_equal(point["radius"], np.linspace(0.1, 0.2, N))
        np.testing.assert_array_equal(cell["law"], np.arange(M))
        # 1e-5 m in 30 m: float32 positions would leave errors of 2e-6, a fifth of it
        np.testing.assert_allclose(point["displacement"], 1e-5 * k * np.sin(start), atol=1e-11)


def test_vtk_reads_particles_at_every_step(tmp_path):
    x, _ = model()
    path = tmp_path / "particles.vtkhdf"
    with VtkSeries(path, x, point_fields={"velocity": 3}, cell_fields={"part": 1}, compress=False) as series:
        for k in range(STEPS):
            series.append(k, x + k, point_data={"velocity": x - k}, cell_data={"part": np.arange(N) * k})
    reader, complaints = vtk_reader(path)
    assert reader.GetNumberOfSteps() == STEPS
    for k in range(STEPS):
        data, points, point, cell, to_numpy = read_step(reader, complaints, k)
        assert data.GetNumberOfVerts() == data.GetNumberOfCells() == N
        np.testing.assert_array_equal(to_numpy(data.GetVerts().GetConnectivityArray()), np.arange(N))
        np.testing.assert_array_equal(points, x + k)
        np.testing.assert_array_equal(point["velocity"], (x - k).astype(np.float32))
        np.testing.assert_array_equal(cell["part"], np.arange(N) * k)


def test_vtk_reads_a_model_without_bonds(tmp_path):
    x, _ = model()
    path = tmp_path / "bonds.vtkhdf"
    with VtkSeries(path, x, pairs=np.empty((0, 2), dtype=int), cell_fields={"damage": 1}) as series:
        for k in range(2):
            series.append(k, x + k, cell_data={"damage": np.empty(0)})
    reader, complaints = vtk_reader(path)
    data, points, *_ = read_step(reader, complaints, 1)
    assert data.GetNumberOfCells() == 0
    np.testing.assert_array_equal(points, x + 1)


def test_vtk_reads_a_step_of_several_chunks(tmp_path):
    n = 100_003  # positions of 2.4 MB: three chunks that n does not divide into
    x = np.arange(3.0 * n).reshape(n, 3)
    path = tmp_path / "particles.vtkhdf"
    with VtkSeries(path, x, point_fields={"id": 1}, dtype=np.float64) as series:
        for k in range(2):
            series.append(k, x + k, point_data={"id": np.arange(n) + k})
    with h5py.File(path) as file:
        points = file["VTKHDF/Points"]
        assert 1 < n / points.chunks[0] <= 3
        assert file["VTKHDF/Steps/PointOffsets"][1] % points.chunks[0] == 0
    reader, complaints = vtk_reader(path)
    for k in range(2):
        _, points, point, *_ = read_step(reader, complaints, k)
        np.testing.assert_array_equal(points, x + k)
        np.testing.assert_array_equal(point["id"], np.arange(n) + k)


@pytest.mark.parametrize("compress", [True, False])
def test_layout_follows_the_specification(tmp_path, compress):
    pairs = write_bonds(tmp_path / "b.vtkhdf", compress=compress)
    with h5py.File(tmp_path / "b.vtkhdf") as file:
        root = file["VTKHDF"]
        assert root.attrs["Version"].tolist() == [2, 0]
        assert root.attrs["Type"] == b"PolyData"
        kind = root.attrs.get_id("Type").get_type()
        assert not kind.is_variable_str()
        assert root["Steps"].attrs["NSteps"] == STEPS
        assert root["Steps/Values"][:].tolist() == [0.25 * k for k in range(STEPS)]
        assert root["Steps/NumberOfParts"][:].tolist() == [1] * STEPS
        assert root["Steps/PartOffsets"][:].tolist() == [0] * STEPS
        assert root["NumberOfPoints"][:].tolist() == [N]
        for name, cells in (("Vertices", 0), ("Lines", M), ("Polygons", 0), ("Strips", 0)):
            assert root[name]["NumberOfCells"][:].tolist() == [cells]
            assert root[name]["Offsets"].shape == (cells + 1,)
        # written once, and every step points at its beginning
        np.testing.assert_array_equal(root["Lines/Connectivity"][:].reshape(M, 2), pairs)
        assert root["PointData/radius"].shape == (N,)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            assert root["Steps"][name].shape == (STEPS, 4)
            assert not root["Steps"][name][:].any()
        assert root["Steps/PointDataOffsets/radius"][:].tolist() == [0] * STEPS
        assert root["Points"].dtype == np.float64
        assert root["PointData/velocity"].dtype == np.float32
        assert (root["Points"].compression == "gzip") is compress
        for k in range(STEPS):
            begin = root["Steps/CellDataOffsets/force"][k]
            np.testing.assert_array_equal(root["CellData/force"][begin : begin + M], frame(k)[2]["force"])


LOOK = """
import sys, h5py
with h5py.File(sys.argv[1], "r") as file:
    steps, points = file["VTKHDF/Steps"], file["VTKHDF/Points"]
    print(steps.attrs["NSteps"], points[steps["PointOffsets"][-1], 0])
"""


def test_another_process_can_look_while_the_run_goes_on(tmp_path):
    path = tmp_path / "p.vtkhdf"
    with VtkSeries(path, np.zeros((N, 3))) as series:
        for k in range(1, 3):
            series.append(k, np.full((N, 3), 10.0 * k))
            look = subprocess.run([sys.executable, "-c", LOOK, str(path)], capture_output=True, text=True, check=True)
            assert look.stdout.split() == [str(k), str(10.0 * k)]


WRITER = """
import sys
import numpy as np
from pybondem.output.vtkhdf import VtkSeries

n, m = 300, 900
x = np.arange(3.0 * n).reshape(n, 3)
pairs = np.stack([np.arange(m) % n, (np.arange(m) + 1) % n], axis=1)
series = VtkSeries(sys.argv[1], x, pairs=pairs, point_fields={"v": 3}, cell_fields={"damage": 1})
k = 0
while True:
    series.append(float(k), x + k, point_data={"v": x * k}, cell_data={"damage": np.full(m, k)})
    k += 1
    print(k, flush=True)
"""


@pytest.mark.parametrize("delay", [0.0, 0.13, 0.41])
def test_killed_while_appending_leaves_every_step_that_was_reported(tmp_path, delay):
    path, n, m = tmp_path / "killed.vtkhdf", 300, 900
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
    first = process.stdout.readline()
    time.sleep(delay)
    process.kill()
    reported = int((first + process.stdout.read()).rsplit(b"\n", 2)[-2])
    process.wait()
    process.stdout.close()
    x = np.arange(3.0 * n).reshape(n, 3)
    with h5py.File(path, "r") as file:
        root = file["VTKHDF"]
        steps = int(root["Steps"].attrs["NSteps"])
        assert steps >= reported >= 1
        times = root["Steps/Values"][:].tolist()
        assert times == list(range(len(times)))
        assert reported <= len(times) <= steps <= len(times) + 1  # more than steps would have VTK write past its memory
        for k in range(steps):
            begin = root["Steps/PointOffsets"][k]
            np.testing.assert_array_equal(root["Points"][begin : begin + n], x + k)
            begin = root["Steps/CellDataOffsets/damage"][k]
            assert (root["CellData/damage"][begin : begin + m] == k).all()
    reader, complaints = vtk_reader(path)
    assert reader.GetNumberOfSteps() == steps
    _, points, _, cell, _ = read_step(reader, complaints, steps - 1)
    np.testing.assert_array_equal(points, x + steps - 1)
    assert (cell["damage"] == steps - 1).all()


def test_a_step_is_counted_before_its_time_is_there(tmp_path):
    """HDF5 writes what has changed in the order of its place in the file; the module says why this is the safe one."""
    x, _ = model()
    with VtkSeries(tmp_path / "p.vtkhdf", x) as series:
        series.append(0.0, x)
    with h5py.File(tmp_path / "p.vtkhdf") as file:
        steps = file["VTKHDF/Steps"]
        assert h5py.h5o.get_info(steps.id).addr < h5py.h5o.get_info(steps["Values"].id).addr


def test_a_step_that_failed_half_way_is_written_again_whole(tmp_path, monkeypatch):
    x, _ = model()
    series = VtkSeries(tmp_path / "p.vtkhdf", x, point_fields={"v": 3})
    series.append(0.0, x, point_data={"v": x})
    with monkeypatch.context() as patch:
        patch.setattr(type(series._file), "flush", lambda self: (_ for _ in ()).throw(OSError("no space left")))
        with pytest.raises(OSError, match="no space"):
            series.append(1.0, x + 9.0, point_data={"v": x * 9.0})
    assert series.steps == 1
    series.append(1.0, x + 1.0, point_data={"v": x * 2.0})
    series.close()
    with h5py.File(tmp_path / "p.vtkhdf") as file:
        assert file["VTKHDF/Steps"].attrs["NSteps"] == 2
        np.testing.assert_array_equal(file["VTKHDF/Points"][N:], x + 1.0)
        np.testing.assert_array_equal(file["VTKHDF/Steps/Values"][:], [0.0, 1.0])


BAD_FILES = {
    "points of two columns": ({"points": np.zeros((4, 2))}, r"shape \(4, 2\)"),
    "no points": ({"points": np.zeros((0, 3))}, r"shape \(0, 3\)"),
    "a point at nan": ({"points": [[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]}, "particle 1 is at"),
    "masked points": ({"points": np.ma.masked_array(np.zeros((4, 3)))}, "real numbers"),
    "points of objects": ({"points": np.array([[None, 0, 0]])}, "real numbers"),
    "pairs of real numbers": ({"pairs": np.zeros((5, 2))}, "whole numbers"),
    "a pair beyond the particles": ({"pairs": [[0, 1], [2, 4]]}, r"bond 1 joins particles \[2, 4\].*0 to 3"),
    "a negative pair": ({"pairs": [[0, -1]]}, "bond 0"),
    "a name with a slash": ({"point_fields": {"v [m/s]": 3}}, "without '/'"),
    "no components": ({"point_fields": {"v": 0}}, "0 components"),
    "own displacement": ({"point_fields": {"displacement": 3}}, "is made here"),
    "field and constant": ({"cell_fields": {"a": 1}, "cell_constants": {"a": np.zeros(4)}}, "both a field and"),
    "short constant": ({"point_constants": {"radius": np.zeros(3)}}, r"shape \(3,\); it needs 4 rows"),
    "half precision": ({"dtype": np.float16}, "float32 or float64"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_series_are_refused_and_leave_no_file(tmp_path, case):
    change, words = BAD_FILES[case]
    with pytest.raises(InputError, match=words):
        VtkSeries(tmp_path / "x.vtkhdf", **({"points": np.zeros((4, 3))} | change))
    assert not (tmp_path / "x.vtkhdf").exists()


def test_existing_files_and_missing_folders_are_refused(tmp_path):
    VtkSeries(tmp_path / "x.vtkhdf", np.zeros((1, 3))).close()
    before = (tmp_path / "x.vtkhdf").read_bytes()
    with pytest.raises(InputError, match="exists; nothing is overwritten"):
        VtkSeries(tmp_path / "x.vtkhdf", np.zeros((1, 3)))
    assert (tmp_path / "x.vtkhdf").read_bytes() == before
    with pytest.raises(InputError, match="folder must exist"):
        VtkSeries(tmp_path / "absent" / "x.vtkhdf", np.zeros((1, 3)))


BAD_STEPS = {
    "time that stands still": ({"time": 1.0}, "t = 1.0 s; it must be after 1.0 s"),
    "time that is not a number": ({"time": np.nan}, "must be after"),
    "another number of particles": ({"points": np.zeros((5, 3))}, r"must be \(4, 3\)"),
    "infinite position": ({"points": np.full((4, 3), np.inf)}, "particle 0 is at"),
    "missing field": ({"point_data": {}}, "'v' is missing from the PointData"),
    "unknown field": ({"cell_data": {"f": np.zeros(4)}}, "'f' was not declared"),
    "misshapen field": ({"point_data": {"v": np.zeros((4, 2))}}, r"has shape \(4, 2\); it must be \(4, 3\)"),
    "text": ({"point_data": {"v": np.full((4, 3), "a")}}, "real numbers"),
    "own displacement": ({"point_data": {"v": np.zeros((4, 3)), "displacement": np.zeros((4, 3))}}, "is made here"),
}


@pytest.mark.parametrize("case", BAD_STEPS)
def test_bad_steps_are_refused_and_leave_the_file_as_it_was(tmp_path, case):
    change, words = BAD_STEPS[case]
    good = {"time": 2.0, "points": np.zeros((4, 3)), "point_data": {"v": np.zeros((4, 3))}}
    with VtkSeries(tmp_path / "x.vtkhdf", np.zeros((4, 3)), point_fields={"v": 3}) as series:
        series.append(**(good | {"time": 1.0}))
        with pytest.raises(InputError, match=words):
            series.append(**(good | change))
        assert series.steps == 1
        series.append(**good)
    with h5py.File(tmp_path / "x.vtkhdf") as file:
        assert file["VTKHDF/Steps/Values"][:].tolist() == [1.0, 2.0]


def test_closed_series_refuse_steps(tmp_path):
    series = VtkSeries(tmp_path / "x.vtkhdf", np.zeros((1, 3)))
    series.close()
    series.close()
    with pytest.raises(InputError, match="is closed"):
        series.append(0.0, np.zeros((1, 3)))


LAZY = """
import sys
import pybondem.output, pybondem.output.vtkhdf, pybondem.output.table, pybondem.output.folder
import pybondem.output.figures, pybondem.output.progress, pybondem.output.report
print([name for name in ("matplotlib", "h5py", "rich", "vtkmodules", "numba") if name in sys.modules])
"""


def test_importing_output_imports_none_of_its_libraries():
    done = subprocess.run([sys.executable, "-c", LAZY], capture_output=True, text=True, check=True, cwd=Path.home())
    assert done.stdout.strip() == "[]"
