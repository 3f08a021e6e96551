"""The command line: `pybondem run`, `pybondem paper`, `pybondem examples`, `pybondem info`."""

import runpy
import sys
import traceback
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import typer

from pybondem.check import nearest
from pybondem.errors import BondemError, EngineError, InputError, UnstableError

app = typer.Typer(add_completion=False, no_args_is_help=True, help="Bonded-particle discrete elements in Python.")

STOPPED, BAD_INPUT, UNSTABLE, MACHINE = 130, 2, 3, 4


def example(name: str) -> Callable[..., Any]:
    """Return an example by name; raises InputError with the nearest name where there is none."""
    from pybondem import examples

    if name not in EXAMPLES:
        raise InputError(f"there is no example or file {name!r}{nearest(name, EXAMPLES)}; see: pybondem examples")
    return getattr(examples, name)


EXAMPLES = {
    "cylinder": ("stiffness of a hexagonally packed cylinder, against the exact static answer", "2 300", "5 s"),
    "pullout": ("a fibre pulled out of a matrix through a softening interface, against theory", "13 600", "1 min"),
}

Output = Annotated[Path | None, typer.Option("--output", "-o", help="Result folder; by default a new one in runs/.")]
Engine = Annotated[str, typer.Option(help="cpu, cuda (or cuda:bonds, cuda:half-bonds), reference or interpreted.")]
Threads = Annotated[int | None, typer.Option(help="Threads of the cpu engine; by default the physical cores.")]
Set = Annotated[list[str] | None, typer.Option("--set", "-s", help="Change a value of an example: -s diameter=0.5")]
Quick = Annotated[bool, typer.Option("--quick", help="Coarse and short: to see that it works, not to be quoted.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no closing block.")]


@app.command()
def run(case: str, output: Output = None, engine: Engine = "cpu", threads: Threads = None,
        values: Set = None, quiet: Quiet = False) -> None:  # fmt: skip
    """Run an example by name, or a Python script (my_case.py)."""
    with exit_codes():
        if output is not None and output.is_dir() and any(output.iterdir()):
            taken = next(output.iterdir()).name
            raise InputError(f"folder {output} is not empty (it holds {taken}); choose a new one.")
        if case.endswith(".py"):
            if values:
                raise InputError("--set changes values of examples; a script has its own.")
            run_script(Path(case), output, engine, threads, quiet)
        else:
            make = example(case)
            result = make(**parsed(case, values or [])).run(engine=engine, threads=threads, folder=output, quiet=quiet)
            if quiet:
                typer.echo(result.folder)


@app.command()
def paper(figure: str, output: Output = None, engine: Engine = "cpu", threads: Threads = None, quick: Quick = False,
          quiet: Quiet = False) -> None:  # fmt: skip
    """Make a figure of the paper from our own runs, beside the exact answer: fig1, fig2, fig3, fig4 or all."""
    from pybondem.output.folder import result_folder
    from pybondem.paper import FIGURES, Effort, make

    with exit_codes():
        if figure not in (*FIGURES, "all"):
            there_are = "; ".join(f"{name}: {shows}" for name, (_, shows) in FIGURES.items())
            raise InputError(
                f"there is no figure {figure!r}{nearest(figure, FIGURES)}; {there_are}; or all of them: all."
            )
        folder = result_folder(f"paper-{figure}", path=output)
        for name in FIGURES if figure == "all" else [figure]:
            sheet = make(name, folder / name if figure == "all" else folder, Effort(quick, engine, threads, quiet))
            if not quiet:
                sheet.show()
        if quiet:
            typer.echo(folder)


@app.command()
def examples() -> None:
    """List the examples."""
    from rich.console import Console
    from rich.table import Table

    table = Table("name", "what it shows", "particles", "about", title="pybondem run NAME")
    for name, row in EXAMPLES.items():
        table.add_row(name, *row)
    Console().print(table)


@app.command()
def info() -> None:
    """Say what this machine offers: engines, threads, GPU, versions."""
    from pybondem.engines.choose import usable_engines
    from pybondem.engines.cpu import Cpu, cache_folder
    from pybondem.engines.cuda_device import described
    from pybondem.output.folder import provenance

    facts = {"engines": ", ".join(usable_engines()), "threads": str(Cpu().threads), "GPU": described(),
             "compiled programs": str(cache_folder())} | provenance()  # fmt: skip
    for name, value in facts.items():
        typer.echo(f"{name:20s} {value}")


def run_script(path: Path, output: Path | None, engine: str, threads: int | None, quiet: bool) -> None:
    """Run a Python script; every simulation in it leaves a result folder."""
    from pybondem.results import Results
    from pybondem.simulation import Simulation, session

    if not path.is_file():
        raise InputError(f"there is no file {str(path)!r}.")
    opened: list[Results] = []

    def open_results(sim: Simulation) -> None:
        if not sim.watched:
            folder = output if output is None or not opened else output.with_name(f"{output.name}-{len(opened) + 1}")
            opened.append(Results(sim, path.stem, folder=folder, quiet=quiet))

    session.engine, session.threads, session.quiet, session.started = engine, threads, quiet, open_results
    sys.path.insert(0, str(path.resolve().parent))
    outcome = "failed"
    try:
        runpy.run_path(str(path), run_name="__main__")
        outcome = "done"
    except KeyboardInterrupt:
        outcome = "stopped by hand"
        raise
    except BondemError as error:
        raise type(error)(f"{error} ({path.name}, line {line_of(error, path)})") from error
    except SystemExit as end:
        outcome = "failed" if end.code else "done"
        raise
    finally:
        for results in opened:
            results.close(outcome)


def line_of(error: BaseException, path: Path) -> int:
    """Return the line of a script that an error came from."""
    return [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)][-1] or 0


def parsed(name: str, values: list[str]) -> dict[str, Any]:
    """Return the values given as key=value, as the types of the example's fields."""
    kinds = {f.name: f.type for f in fields(type(example(name)()))}
    result: dict[str, Any] = {}
    for text in values:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set needs key=value, got {text!r}.")
        if key not in kinds:
            raise InputError(f"{name} has no value {key!r}{nearest(key, kinds)}; it has {', '.join(kinds)}.")
        if kinds[key] not in (str, float, float | None):
            raise InputError(f"{key} of {name} is no number; set it in a script: bd.examples.{name}({key}=...).")
        try:
            result[key] = value if kinds[key] is str else float(value)
        except ValueError:
            raise InputError(f"{key}={value!r} of {name} is not a number.") from None
    return result


@contextmanager
def exit_codes() -> Any:
    """Turn errors into one sentence and an exit code: 2 bad input, 3 unstable, 4 machine, 130 stopped by hand."""
    try:
        yield
    except KeyboardInterrupt as stop:
        typer.echo(f"\n{stop}", err=True)
        raise typer.Exit(STOPPED) from None
    except BondemError as error:
        typer.echo(f"error: {error}", err=True)
        codes = {UnstableError: UNSTABLE, EngineError: MACHINE}
        raise typer.Exit(codes.get(type(error), BAD_INPUT)) from None


def main() -> None:
    """Entry point."""
    app()
