"""Install PyBONDEM into .venv beside this file, once, and run it from there. Needs only Python 3.11 to 3.14.

python3 go.py run pullout                  the same as: pybondem run pullout
python3 go.py test [pytest arguments]      ruff, mypy and pytest; stops at the first that fails
python3 go.py --extra cuda run pullout     with an optional part named in pyproject.toml
"""

import hashlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
BIN, EXE = (VENV / "Scripts", ".exe") if os.name == "nt" else (VENV / "bin", "")
PYTHON = str(BIN / ("python" + EXE))


def install(extras):
    """Bring .venv up to date with pyproject.toml and these extras; do nothing where its stamp says that it is."""
    stamp, uv = VENV / "pybondem-installed", shutil.which("uv")
    key = hashlib.sha256((ROOT / "pyproject.toml").read_bytes() + bytes(ROOT)).hexdigest()
    installed, *present = stamp.read_text().split() if stamp.exists() else [""]
    if installed == key and extras <= set(present) and os.path.exists(PYTHON):
        return
    if not uv and not importlib.util.find_spec("ensurepip"):
        sys.exit("This Python cannot make virtual environments. On Debian or Ubuntu: sudo apt install python3-venv")
    print(f"Installing PyBONDEM into {VENV}: once, a minute or less ...", file=sys.stderr, flush=True)
    wanted = sorted(extras.union(present))  # what was asked for before stays
    steps = [] if os.path.exists(PYTHON) else [[sys.executable, "-m", "venv", "--clear", "--without-pip", str(VENV)]]
    steps += [] if uv else [[PYTHON, "-m", "ensurepip"]]
    steps += [[uv, "pip", "install", "-qp", PYTHON] if uv else [PYTHON, "-m", "pip", "install", "-q"]]
    steps[-1] += ["-e", f".[{','.join(wanted)}]" if wanted else "."]
    if any(subprocess.call(step, cwd=ROOT, stdout=subprocess.DEVNULL) for step in steps):
        sys.exit("PyBONDEM is not installed: see above. The first call needs a network (or PIP_FIND_LINKS=wheels).")
    stamp.write_text("\n".join([key, *wanted]))


def main(words):
    """Take the extras off the words, install, run. The last command takes our place: its signals, its exit code."""
    if not (3, 11) <= sys.version_info < (3, 15):
        sys.exit(f"PyBONDEM needs Python 3.11 to 3.14, but this is {sys.version.split()[0]}: try python3.12 go.py")
    extras = set()
    while words[:1] == ["--extra"]:
        extras, words = extras.union(words[1:2]), words[2:]
    commands = [[str(BIN / ("pybondem" + EXE)), *words]]
    if words[:1] == ["test"]:
        extras.add("test")
        os.chdir(ROOT)
        tools = ["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"], ["pytest", *words[1:]]
        commands = [[PYTHON, "-m", *tool] for tool in tools]
    install(extras)
    failure = next(filter(None, map(subprocess.call, commands[:-1])), 0)  # the first exit code that is not 0
    if os.name == "posix" and not failure:
        os.execv(commands[-1][0], commands[-1])
    signal.signal(signal.SIGINT, lambda *_: None)  # Windows has no such exec: leave Ctrl-C to the command
    sys.exit(failure or subprocess.call(commands[-1]))


if __name__ == "__main__":
    main(sys.argv[1:])
