"""Tables of particles: what is written comes back to the bit, and a faulty file is refused where it is at fault."""

import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.packing import Particles, Sphere, hcp, read_table, write_table

ENDINGS = (".csv", ".npy", ".npz")
GOOD = "x,y,z,radius\n0,0,0,0.5\n1,0,0,0.5\n"


@pytest.fixture
def grains() -> Particles:
    """Spheres whose numbers need all digits, among them extremes."""
    rng = np.random.default_rng(5)
    x = rng.normal(size=(40, 3)) * 10.0 ** rng.integers(-12, 12, size=(40, 3))
    x[0] = 0.0, -0.0, 5e-324
    x[1] = 1.7976931348623157e308, 0.1, -1.0 / 3.0
    return Particles(x, 10.0 ** rng.uniform(-9.0, 3.0, 40))


def text(folder: Path, content: str, name: str = "grains.csv", encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_bytes(content.encode(encoding))
    return path


# ------------------------------------------------------------------------------------------------- there and back again
@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_written_comes_back_to_the_bit(tmp_path: Path, grains: Particles, ending: str) -> None:
    path = tmp_path / f"grains{ending}"
    write_table(path, grains)
    again = read_table(str(path))
    assert again.x.tobytes() == grains.x.tobytes()
    assert again.radius.tobytes() == grains.radius.tobytes()
    first = path.read_bytes()
    write_table(str(path), again)
    assert path.read_bytes() == first
    assert list(tmp_path.iterdir()) == [path]


def test_the_text_is_plain(tmp_path: Path) -> None:
    write_table(tmp_path / "a.csv", Particles([[0, 1.5, -2e-7]], 0.1))
    assert (tmp_path / "a.csv").read_bytes() == b"x,y,z,radius\n0.0,1.5,-2e-07,0.1\n"


@pytest.mark.parametrize(
    "content",
    [
        "x,y,z,radius\n1,2,3,0.5\n-4,5e-1,.6,25e-2\n",
        "\ufeffx,y,z,radius\n1,2,3,0.5\n-4,5e-1,.6,25e-2\n",  # byte-order mark
        "x,y,z,radius\r\n1,2,3,0.5\r\n-4,5e-1,.6,25e-2\r\n",
        "x,y,z,radius\r1,2,3,0.5\r-4,5e-1,.6,25e-2\r",
        "diameter,z,y,x\n1,3,2,1\n0.5,.6,5e-1,-4\n",
        "x\ty\tz\tradius\n1\t2\t3\t0.5\n-4\t5e-1\t.6\t25e-2\n",
        ' x , "y",z, radius\n"1",2 , "3",0.5\n\n-4,5e-1,+.6,25e-2\n  \n\n',  # blanks, quotes, blank lines
    ],
)
def test_text_in_its_dialects(tmp_path: Path, content: str) -> None:
    found = read_table(text(tmp_path, content))
    np.testing.assert_array_equal(found.x, [[1.0, 2.0, 3.0], [-4.0, 0.5, 0.6]])
    np.testing.assert_array_equal(found.radius, [0.5, 0.25])


@pytest.mark.parametrize("ending", [".npy", ".npz", ".NPY"])
def test_arrays_with_names_in_any_order(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"grains{ending}"
    columns = {"diameter": np.float32([1, 0.5]), "z": np.array([3, 6]), "x": np.array([1.0, -4.0]), "y": [2.0, 0.5]}
    with path.open("wb") as file:
        if ending == ".npz":
            np.savez_compressed(file, **columns)
        else:
            names, values = zip(*columns.items(), strict=True)
            np.save(file, np.rec.fromarrays(values, names=list(names)))
    found = read_table(path)
    np.testing.assert_array_equal(found.x, [[1.0, 2.0, 3.0], [-4.0, 0.5, 6.0]])
    np.testing.assert_array_equal(found.radius, [0.5, 0.25])


def test_a_plain_array_has_the_columns_x_y_z_radius(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asfortranarray([[1, 2, 3, 4], [5, 6, 7, 8]]))
    found = read_table(tmp_path / "a.npy")
    np.testing.assert_array_equal(found.x, [[1, 2, 3], [5, 6, 7]])
    np.testing.assert_array_equal(found.radius, [4, 8])


# ---------------------------------------------------------------------------------------------------------- faulty text
@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", r"^grains.csv is empty; its first line must name the columns x, y, z, radius\.$"),
        ("\n", r"^grains.csv, line 1: '' must name the columns, for example x,y,z,radius\.$"),
        ("x,y,z,radius\n", r"^grains.csv has a header but no particles\.$"),
        ("1,2,3,0.5\n", r"^grains.csv, line 1: '1,2,3,0.5' must name the columns"),
        ("x,y,radius\n0,0,1\n", r"^grains.csv, line 1: column 'z' is missing; got x, y, radius\.$"),
        ("x,y,z\n0,0,0\n", r"^grains.csv, line 1: column 'radius' \(or 'diameter'\) is missing; got x, y, z\.$"),
        ("x,y,z,radus\n0,0,0,1\n", r"^grains.csv, line 1: column 'radus' is unknown \(did you mean 'radius'\?\)"),
        ("X,y,z,radius\n0,0,0,1\n", r"^grains.csv, line 1: column 'X' is unknown \(did you mean 'x'\?\)"),
        ("x,y,z,radius,colour\n0,0,0,1,7\n", r"^grains.csv, line 1: column 'colour' is unknown; the columns are x, y"),
        ("x,y,z,radius,x\n0,0,0,1,0\n", r"^grains.csv, line 1: column 'x' is given 2 times; give it once\.$"),
        ("x,y,z,radius,\n0,0,0,1,\n", r"^grains.csv, line 1: column '' is unknown"),
        (
            "x,y,z,radius,diameter\n0,0,0,1,2\n",
            r"^grains.csv, line 1: both 'radius' and 'diameter' are given; give one",
        ),
        ("x;y;z;radius\n0;0;0;1\n", r"^grains.csv, line 1: columns are separated by ';'; use commas, and a point"),
        (GOOD + "2,0,0\n", r"^grains.csv, line 4: 3 cells for 4 columns; the file may have been cut short"),
        (
            GOOD + "0,5,0,0,0,5\n",
            r"^grains.csv, line 4: 6 cells for 4 columns; write numbers with a decimal point, not",
        ),
        (GOOD + "2\t0\t0\t1\n", r"^grains.csv, line 4: 1 cells for 4 columns; .* or change its separator\.$"),
        (
            GOOD + '2,0,"0,5",1\n',
            r"^grains.csv, line 4, column z: '0,5' is not a number; write it with a decimal point",
        ),
        (
            "x\ty\tz\tradius\n0\t0,5\t0\t1\n",
            r"^grains.csv, line 2, column y: '0,5' is not a number; write it with a dec",
        ),
        ("x\ty\tz\tradius\n0\t0\t0\t1\t7\n", r"^grains.csv, line 2: 5 cells for 4 columns; remove what is too much\.$"),
        (GOOD + "2,zero,0,1\n", r"^grains.csv, line 4, column y: 'zero' is not a number\.$"),
        (GOOD + "2,,0,1\n", r"^grains.csv, line 4, column y: '' is not a number\.$"),
        (GOOD + "# a remark, or two, in, four\n", r"^grains.csv, line 4, column x: '# a remark' is not a number\.$"),
        (GOOD + "\n\n2,0,nan,1\n", r"^grains.csv, line 6, column z: nan must be finite\.$"),
        (GOOD + "2,0,0,inf\n", r"^grains.csv, line 4, column radius: inf must be positive and finite\.$"),
        (GOOD + "2,1e999,0,1\n", r"^grains.csv, line 4, column y: inf must be finite\.$"),
        (GOOD + "2,0,0,0\n", r"^grains.csv, line 4, column radius: 0.0 must be positive and finite\.$"),
        (GOOD + "2,0,0,-1\n", r"^grains.csv, line 4, column radius: -1.0 must be positive and finite\.$"),
        (GOOD + "2,0,0,5e-324\n", r"^grains.csv, line 4, column radius: 5e-324 must be positive and finite\.$"),
        (GOOD + '2,0,0,"1\n', r"^grains.csv is not a table: unexpected end of data\.$"),
        (GOOD + "2,0,0,1.25", r"^grains.csv ends within a line; it may have been cut short"),
    ],
)
def test_a_fault_in_text_is_named_with_its_line_and_column(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_table(text(tmp_path, content))


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_text_that_is_not_utf_8_is_refused(tmp_path: Path, encoding: str) -> None:
    with pytest.raises(InputError, match=r"^grains.csv is not UTF-8 text; save it as CSV in UTF-8\.$"):
        read_table(text(tmp_path, GOOD.replace("0.5", "½"), encoding=encoding))


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_that_was_cut_anywhere_is_refused(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"grains{ending}"
    write_table(path, hcp(1.0, Sphere(1.0)))
    content = path.read_bytes()
    for length in range(len(content)):
        path.write_bytes(content[:length])
        if ending == ".csv" and content[:length].count(b"\n") > 1 and content[:length].endswith(b"\n"):
            continue  # whole lines are a shorter table
        with pytest.raises(InputError, match=rf"^grains\{ending}\b.*\.$"):
            read_table(path)


# -------------------------------------------------------------------------------------------------------- faulty arrays
def structured(**columns: object) -> np.ndarray:
    return np.rec.fromarrays(list(columns.values()), names=list(columns)).view(np.ndarray)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((2, 3)), r"^grains.npy has shape \(2, 3\); it must be \(n, 4\) with the columns x, y, z, radius\.$"),
        (np.zeros(4), r"^grains.npy has shape \(4,\); it must be \(n, 4\)"),
        (np.zeros((2, 4)), r"^grains.npy: radius\[0\] is 0.0; it must be positive \(2 such values in all\)\.$"),
        (np.empty((0, 4)), r"^grains.npy has no particles\.$"),
        (np.array([[0, 0, 0, 1], [0, np.nan, 0, 1]]), r"^grains.npy: y\[1\] is nan, not finite\.$"),
        (np.array([["0", "0", "0", "1"]]), r"^grains.npy: x has dtype <U1; it must hold real numbers"),
        (
            structured(x=[0.0], y=[0.0], z=[0.0], radus=[1.0]),
            r"^grains.npy: column 'radus' is unknown \(did you mean 'ra",
        ),
        (structured(x=[0.0], y=[0.0], radius=[1.0]), r"^grains.npy: column 'z' is missing; got x, y, radius\.$"),
    ],
)
def test_a_fault_in_an_array_is_named(tmp_path: Path, array: np.ndarray, message: str) -> None:
    np.save(tmp_path / "grains.npy", array)
    with pytest.raises(InputError, match=message):
        read_table(tmp_path / "grains.npy")


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"x": [0, 1], "y": [0, 1], "z": [0, 1], "radius": [1]},
            r"^a.npz: columns have different lengths \(x 2, y 2, z 2",
        ),
        (
            {"x": np.zeros((2, 3)), "y": [0], "z": [0], "radius": [1]},
            r"^a.npz: x has shape \(2, 3\); it must be \(n,\)\.$",
        ),
        ({"x": [0], "y": [0], "z": [0], "diameter": [-1.0]}, r"^a.npz: diameter\[0\] is -1.0; it must be positive\.$"),
        ({"x": [0], "y": [0], "z": [0], "r": [1]}, r"^a.npz: column 'r' is unknown; the columns are x, y, z"),
        ({"x": [0], "y": [0], "z": [0], "radius": [1], "diameter": [2]}, r"^a.npz: both 'radius' and 'diameter'"),
    ],
)
def test_a_fault_in_an_archive_is_named(tmp_path: Path, columns: dict, message: str) -> None:
    np.savez(tmp_path / "a.npz", **columns)
    with pytest.raises(InputError, match=message):
        read_table(tmp_path / "a.npz")


class Trap:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Callable, tuple]:
        return Path.touch, (self.mark,)


@pytest.mark.parametrize("kind", ["pickle", "array", "archive"])
def test_a_table_runs_no_code(tmp_path: Path, kind: str) -> None:
    path, mark = tmp_path / ("a.npz" if kind == "archive" else "a.npy"), tmp_path / "mark"
    objects = np.array([Trap(mark)], dtype=object)
    if kind == "pickle":
        path.write_bytes(pickle.dumps(Trap(mark)))
    elif kind == "array":
        np.save(path, objects, allow_pickle=True)
    else:
        np.savez(path, x=objects, y=[0.0], z=[0.0], radius=[1.0])
    with pytest.raises(InputError, match=r"^a.np[yz] is no NumPy file or holds Python objects, which are never loaded"):
        read_table(path)
    assert not mark.exists()


def test_a_damaged_archive_is_refused(tmp_path: Path, grains: Particles) -> None:
    path = tmp_path / "a.npz"
    write_table(path, grains)
    content = bytearray(path.read_bytes())
    content[content.index(np.float64(grains.radius[3]).tobytes())] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"^a.npz is damaged or cut short \(BadZipFile\)\.$"):
        read_table(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", b"nothing of the kind")
    with pytest.raises(InputError, match=r"^a.npz"):
        read_table(path)


# --------------------------------------------------------------------------------------------------------- faulty paths
def test_a_path_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for name in ("nowhere.csv", "folder.csv"):
        with pytest.raises(InputError, match=rf"^{name} is not there, or is not a file\.$"):
            read_table(tmp_path / name)
    with pytest.raises(InputError, match=r"^Ending of grains.cvs is '.cvs'; .* \(did you mean '.csv'\?\)\.$"):
        read_table(text(tmp_path, GOOD, "grains.cvs"))


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path, grains: Particles) -> None:
    with pytest.raises(InputError, match=r"^Ending of a.txt is '.txt'; it must be one of '.csv', '.npy', '.npz'"):
        write_table(tmp_path / "a.txt", grains)
    with pytest.raises(InputError, match=r"^a.csv cannot be written; its folder missing is not there\.$"):
        write_table(tmp_path / "missing" / "a.csv", grains)
    with pytest.raises(InputError, match=r"^write_table got ndarray; it writes Particles\.$"):
        write_table(tmp_path / "a.csv", grains.x)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_write_that_fails_leaves_the_old_table(
    tmp_path: Path, grains: Particles, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = text(tmp_path, "the old one", f"a{ending}")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_table(path, grains)
    assert path.read_text() == "the old one"
    assert list(tmp_path.iterdir()) == [path]
