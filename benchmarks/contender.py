"""Contenders: programs that run the job in processes of their own and are timed in turns.

A contender's script connects back to a port of this machine and answers one JSON line to each JSON line: it builds the
job when it starts and says facts about it, then advances so many steps and says wall and process-CPU seconds. One that
runs on several processes (MPI ranks) answers from each.
"""

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SAMPLE = 1000  # particles whose velocities are compared
CALIBRATION = 0.25  # of the time asked for is long enough to tell the number of steps


class Job(Protocol):
    """What a contender's script serves."""

    facts: dict[str, Any]

    def advance(self, steps: int) -> None:
        """Run so many steps."""

    def velocities(self) -> Floats:
        """Return the velocities of every k-th particle, in the order of the packing, k = n // SAMPLE [m/s]."""

    def finish(self) -> dict[str, Any]:
        """Return what is known at the end."""


class Sample(NamedTuple):
    """Wall and process-CPU seconds of one run."""

    wall: float
    cpu: float


def serve(make: Callable[..., Job]) -> None:
    """Build a job with the arguments on the command line (port, JSON) and answer until the other side hangs up."""
    with socket.create_connection(("127.0.0.1", int(sys.argv[1]))) as line, line.makefile("rw") as stream:

        def say(answer: Any) -> None:
            print(json.dumps(answer), file=stream, flush=True)

        try:
            job = make(**json.loads(sys.argv[2]))
            say(job.facts)
            for request in map(json.loads, stream):
                say(_answer(job, request))
        except Exception as error:
            say({"error": f"{type(error).__name__}: {error}"})


def _answer(job: Job, request: dict[str, Any]) -> Any:
    if request["do"] == "advance":
        wall, cpu = perf_counter(), process_time()
        job.advance(request["steps"])
        return Sample(perf_counter() - wall, process_time() - cpu)
    return job.velocities().tolist() if request["do"] == "velocities" else job.finish()


class Contender:
    """A running contender: script, arguments of its job, words before the interpreter, number of processes.

    Raises RuntimeError where the script fails or ends.
    """

    def __init__(self, script: str, arguments: dict[str, Any], launcher: list[str], processes: int = 1) -> None:
        self._script = script
        with socket.create_server(("127.0.0.1", 0)) as server:
            server.settimeout(1.0)
            program = [sys.executable, str(Path(__file__).with_name(script))]
            words = [*launcher, *program, str(server.getsockname()[1]), json.dumps(arguments)]
            self._process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
            self._lines = [self._accept(server) for _ in range(processes)]
        self._streams = [line.makefile("rw") for line in self._lines]
        self.facts: dict[str, Any] = self._answers()[0]

    def _accept(self, server: socket.socket) -> socket.socket:
        while True:
            try:
                line = server.accept()[0]
            except TimeoutError:
                if self._process.poll() is not None:
                    raise RuntimeError(f"{self._script} ended before it began, see above.") from None
            else:
                line.settimeout(None)
                return line

    def _answers(self) -> list[Any]:
        answers = [json.loads(stream.readline() or '{"error": "it ended, see above"}') for stream in self._streams]
        for answer in answers:
            if isinstance(answer, dict) and "error" in answer:
                raise RuntimeError(f"{self._script}: {answer['error']}")
        return answers

    def _ask(self, do: str, **values: int) -> list[Any]:
        for stream in self._streams:
            print(json.dumps({"do": do, **values}), file=stream, flush=True)
        return self._answers()

    def advance(self, steps: int) -> Sample:
        """Run so many steps: the longest wall time and the sum of the CPU times of its processes."""
        samples = [Sample(*answer) for answer in self._ask("advance", steps=steps)]
        return Sample(max(s.wall for s in samples), sum(s.cpu for s in samples))

    def steps_for(self, seconds: float) -> int:
        """Return how many steps take so long, found by running more and more of them."""
        steps = 1
        while (spent := self.advance(steps).wall) < CALIBRATION * seconds:
            steps *= int(np.clip(CALIBRATION * seconds / spent, 2.0, 10.0))
        return max(1, round(1.1 * steps * seconds / spent))

    def velocities(self) -> Floats:
        """Return the velocities of the sampled particles now [m/s]."""
        return np.array(self._ask("velocities")[0])

    def finish(self) -> dict[str, Any]:
        """Return what the job knows at its end."""
        found: dict[str, Any] = self._ask("finish")[0]
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for stream in self._streams:
            stream.close()
        for line in self._lines:
            line.close()
        if error is not None:
            self._process.terminate()
        self._process.wait()
