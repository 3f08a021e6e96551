"""The folder of a run, its JSON files, and the record of what made them."""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from pybondem.errors import InputError

LATEST = "latest"


def result_folder(name: str, root: str | Path = "runs", path: str | Path | None = None) -> Path:
    """Make an empty folder for the results of a run and return it. Nothing that exists is ever overwritten.

    Without ``path`` the folder is ``root/name-YYYYmmdd-HHMMSS`` (local time), with ``-2``, ``-3``, ... when that one
    is taken, and ``root/latest`` is made a link to it where the system has links. With ``path`` it is exactly that
    folder, which may exist if it is empty.

    Raises
    ------
    InputError : ``name`` cannot be a folder name, ``path`` is a file or is not empty, or the place is not writable.
    """
    if path is not None:
        return _given_folder(Path(path))
    if not isinstance(name, str) or not name.strip() or name.strip().startswith(".") or set(name) & set('/\\:*?"<>|\0'):
        raise InputError(f"run name {name!r} cannot be a folder name; take letters, digits, '-' and '_'.")
    stem = f"{'-'.join(name.split())}-{datetime.now():%Y%m%d-%H%M%S}"
    parent = Path(root)
    try:
        parent.mkdir(parents=True, exist_ok=True)
        folder = _first_free(parent, stem)
    except OSError as err:
        raise InputError(f"folder {parent} cannot hold results: {err.strerror}; choose another with -o.") from err
    _point_latest_at(folder)
    return folder


def write_json(path: str | Path, mapping: Mapping[str, Any]) -> None:
    """Write ``mapping`` as JSON so that readers see the old file or the new one, never a part of either.

    The text goes to a temporary file beside ``path``, is forced to the disk, and takes its place by ``os.replace``;
    when anything fails the old file stays and the temporary one is removed. NumPy scalars and arrays become numbers
    and lists, NaN and infinities (which JSON does not have) become null, paths and dates become text.

    Raises
    ------
    InputError : a value that JSON cannot hold; the sentence names its place.
    OSError : the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(_plain(mapping, path.name), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    # Not tempfile.mkstemp: its files are readable by their owner only, and os.replace would keep that.
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def provenance() -> dict[str, Any]:
    """What a result was made with, for ``provenance.json``.

    Keys: ``pybondem``, ``git`` (commit, or None outside a checkout), ``git_changed`` (uncommitted changes, or None),
    ``python``, ``numpy``, ``numba``, ``scipy``, ``h5py`` (versions, None if absent), ``cpu``, ``cores`` (logical, of
    the machine), ``threads`` (that this process may use), ``platform``, ``date`` (UTC, ISO 8601).
    """
    commit, changed = _git_state()
    return {
        "pybondem": _version("pybondem"),
        "git": commit,
        "git_changed": changed,
        "python": platform.python_version(),
        **{name: _version(name) for name in ("numpy", "numba", "scipy", "h5py")},
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "threads": _threads(),
        "platform": platform.platform(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _given_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = next(folder.iterdir(), None)
        if taken is None:
            with tempfile.TemporaryFile(dir=folder):  # asking the system beats reading permission bits
                return folder
    except FileExistsError as err:
        raise InputError(f"folder {folder} cannot be made: a file of that name exists; choose another name.") from err
    except OSError as err:
        raise InputError(f"folder {folder} cannot hold results: {err.strerror}; choose another with -o.") from err
    raise InputError(f"folder {folder} is not empty (it holds {taken.name}); choose a new one, nothing is overwritten.")


def _first_free(parent: Path, stem: str) -> Path:
    for k in count(1):
        folder = parent / (stem if k == 1 else f"{stem}-{k}")
        with suppress(FileExistsError):  # mkdir both asks and takes, so that two runs never share a folder
            folder.mkdir()
            return folder
    raise AssertionError("unreachable: count() does not end")


def _point_latest_at(folder: Path) -> None:
    link = folder.with_name(LATEST)
    if link.exists() and not link.is_symlink():
        return  # a folder or file that somebody made: theirs to keep
    fresh = folder.with_name(f".{LATEST}.{folder.name}")
    with suppress(OSError):  # systems and users without the right to make links do without
        fresh.symlink_to(folder.name, target_is_directory=True)
        os.replace(fresh, link)


def _plain(value: Any, where: str) -> Any:
    """The value in JSON's own types; ``where`` names its place for the error."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist(), where)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{where}: {key}") for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray | memoryview):
        return [_plain(item, f"{where}[{k}]") for k, item in enumerate(value)]
    raise InputError(
        f"{where} is a {type(value).__name__}, which JSON cannot hold; give numbers, text, lists or dicts."
    )


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _git_state() -> tuple[str | None, bool | None]:
    here = Path(__file__).resolve()

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(here.parent), *words], capture_output=True, text=True, timeout=10, check=True
        )
        return done.stdout.strip()

    try:
        # An installed copy may lie inside somebody else's checkout; only a tracked file makes the commit ours.
        git("ls-files", "--error-unmatch", here.name)
        return git("rev-parse", "HEAD"), bool(git("status", "--porcelain", "--untracked-files=no"))
    except (OSError, subprocess.SubprocessError):
        return None, None


def _cpu_model() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return value.strip()
    with suppress(OSError, subprocess.SubprocessError):
        words = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(words, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    return platform.processor() or platform.machine()


def _threads() -> int:
    numba = sys.modules.get("numba")
    if numba is not None:
        return int(numba.get_num_threads())
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only: the cores this process was given
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1
