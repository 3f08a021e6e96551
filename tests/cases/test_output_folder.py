"""Result folders that overwrite nothing, JSON that is never half a file, and where results say they come from."""

import importlib.metadata
import json
import os
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from pybondem.errors import InputError
from pybondem.output.folder import provenance, result_folder, write_json


def links_work(folder):
    try:
        (folder / "probe").symlink_to("nothing")
    except OSError:
        return False
    (folder / "probe").unlink()
    return True


def test_folder_is_named_after_run_and_time(tmp_path):
    folder = result_folder("pull-out of a fibre", root=tmp_path / "deep" / "runs")
    assert folder.is_dir()
    assert not list(folder.iterdir())
    assert folder.parent == tmp_path / "deep" / "runs"
    stamp = re.fullmatch(r"pull-out-of-a-fibre-(\d{8}-\d{6})", folder.name)
    age = datetime.now() - datetime.strptime(stamp[1], "%Y%m%d-%H%M%S")
    assert timedelta(0) <= age < timedelta(seconds=30)


def test_many_runs_in_one_second_get_folders_of_their_own(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        folders = list(pool.map(lambda _: result_folder("run", root=tmp_path), range(40)))
    assert len(set(folders)) == 40
    assert all(folder.is_dir() for folder in folders)
    left_over = {path.name for path in tmp_path.iterdir()} - {folder.name for folder in folders}
    assert left_over <= {"latest"}


def test_latest_points_at_the_newest(tmp_path):
    if not links_work(tmp_path):
        pytest.skip("this system lets no links be made here")
    for _ in range(3):
        folder = result_folder("run", root=tmp_path)
        assert (tmp_path / "latest").resolve() == folder.resolve()
    assert not Path(os.readlink(tmp_path / "latest")).is_absolute()  # the runs can be moved together


def test_a_system_without_links_still_gets_its_folder(tmp_path, monkeypatch):
    def refuse(*_args, **_kwargs):
        raise OSError("privilege not held")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    folder = result_folder("run", root=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


def test_a_folder_that_somebody_called_latest_is_left_alone(tmp_path):
    (tmp_path / "latest").mkdir()
    (tmp_path / "latest" / "notes.txt").write_text("mine")
    result_folder("run", root=tmp_path)
    assert not (tmp_path / "latest").is_symlink()
    assert (tmp_path / "latest" / "notes.txt").read_text() == "mine"


def test_a_given_path_is_used_as_it_is(tmp_path):
    assert result_folder("run", path=tmp_path / "a" / "b") == tmp_path / "a" / "b"
    assert result_folder("run", path=tmp_path / "a" / "b") == tmp_path / "a" / "b"  # still empty
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "b"]


def test_a_given_path_that_is_taken_is_refused(tmp_path):
    (tmp_path / "old.csv").write_text("1")
    with pytest.raises(InputError, match=r"is not empty \(it holds old\.csv\)"):
        result_folder("run", path=tmp_path)
    with pytest.raises(InputError, match="a file of that name exists"):
        result_folder("run", path=tmp_path / "old.csv")
    assert (tmp_path / "old.csv").read_text() == "1"


@pytest.mark.parametrize("name", ["", "  ", "a/b", "..", "c:\\x", "what?", None])
def test_names_that_are_no_folder_names_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="cannot be a folder name"):
        result_folder(name, root=tmp_path)
    assert not list(tmp_path.iterdir())


def test_places_that_cannot_be_written_are_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot hold results"):
        result_folder("run", root=tmp_path / "file")
    with pytest.raises(InputError, match="cannot hold results"):
        result_folder("run", path=tmp_path / "file" / "inner")

    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)  # an empty folder of somebody else; root may write anywhere
    with pytest.raises(InputError, match=r"cannot hold results: Permission denied; choose another"):
        result_folder("run", path=tmp_path / "fine")
    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        result_folder("run", root=tmp_path / "runs")


def test_json_holds_what_was_given_in_its_own_types(tmp_path):
    write_json(
        tmp_path / "s.json",
        {
            "f": np.float64(1.5),
            "f32": np.float32(0.5),
            "i": np.int32(-3),
            "yes": np.bool_(True),
            "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
            "nan": float("nan"),
            "tuple": (1, "µ", None),
            "path": Path("a") / "b",
            "when": datetime(2026, 1, 2, tzinfo=UTC),
            "inner": {3: np.arange(2)},
        },
    )
    raw = (tmp_path / "s.json").read_text(encoding="utf-8")
    assert json.loads(raw, parse_constant=lambda word: pytest.fail(f"{word} is not JSON")) == {
        "f": 1.5,
        "f32": 0.5,
        "i": -3,
        "yes": True,
        "array": [[1.0, None], [None, 2.0]],
        "nan": None,
        "tuple": [1, "µ", None],
        "path": str(Path("a") / "b"),
        "when": "2026-01-02T00:00:00+00:00",
        "inner": {"3": [0, 1]},
    }
    assert raw.endswith("}\n")


@pytest.mark.parametrize("fails", ["replace", "fsync"])
def test_a_failure_keeps_the_old_json_and_leaves_nothing_behind(tmp_path, monkeypatch, fails):
    write_json(tmp_path / "s.json", {"step": 1})

    def refuse(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, fails, refuse)
        with pytest.raises(OSError, match="No space left"):
            write_json(tmp_path / "s.json", {"step": 2})
    assert json.loads((tmp_path / "s.json").read_text()) == {"step": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["s.json"]
    write_json(tmp_path / "s.json", {"step": 3})
    assert json.loads((tmp_path / "s.json").read_text()) == {"step": 3}


def test_json_is_on_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    calls = []
    real_fsync, real_replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (calls.append("fsync"), real_fsync(fd))[1])

    def replace(source, target):
        assert json.loads(Path(source).read_text()) == {"step": 1}
        assert Path(source).parent == Path(target).parent  # across file systems it would not be atomic
        calls.append("replace")
        real_replace(source, target)

    monkeypatch.setattr(os, "replace", replace)
    write_json(tmp_path / "s.json", {"step": 1})
    assert calls == ["fsync", "replace"]


def test_values_that_json_cannot_hold_are_named_by_place(tmp_path):
    with pytest.raises(InputError, match=r"s\.json: load: steps\[1\] is a complex"):
        write_json(tmp_path / "s.json", {"load": {"steps": [1, 2j]}})
    assert not list(tmp_path.iterdir())


def test_provenance_tells_what_and_where():
    told = provenance()
    assert json.loads(json.dumps(told)) == told
    assert told["numpy"] == np.__version__
    assert told["pybondem"] == importlib.metadata.version("pybondem")
    assert told["python"] == ".".join(map(str, os.sys.version_info[:3]))
    assert told["cores"] == os.cpu_count()
    assert 1 <= told["threads"] <= told["cores"]
    assert told["cpu"]
    assert abs(datetime.now(UTC) - datetime.fromisoformat(told["date"])) < timedelta(seconds=30)


def test_provenance_names_the_commit_of_this_checkout_and_of_no_other(tmp_path, monkeypatch):
    import pybondem.output.folder as folder

    def git(*words):
        return subprocess.run(["git", "-C", str(tmp_path), *words], capture_output=True, text=True, check=True).stdout

    try:
        git("init", "-q")
    except FileNotFoundError:
        pytest.skip("git is not installed")
    copy = tmp_path / "site-packages" / "folder.py"
    copy.parent.mkdir()
    copy.write_text("x = 1\n")
    (tmp_path / "theirs.txt").write_text("a project that has pybondem installed inside it\n")
    git("add", "theirs.txt")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "-m", "theirs")
    monkeypatch.setattr(folder, "__file__", str(copy))
    assert (provenance()["git"], provenance()["git_changed"]) == (None, None)
    git("add", "site-packages")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "-m", "ours")
    assert (provenance()["git"], provenance()["git_changed"]) == (git("rev-parse", "HEAD").strip(), False)
    copy.write_text("x = 2\n")
    assert provenance()["git_changed"] is True


def test_a_machine_without_git_says_nothing_of_commits(monkeypatch):
    def absent(*_args, **_kwargs):
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", absent)
    assert provenance()["git"] is None
