"""The command line: `barchan run`, `barchan scenes`, `barchan solve`, `barchan bench`, `barchan reproduce`.

Exit codes: 0 done, 2 bad input (one line on standard error, no traceback), 3 not converged, 130 interrupted.
Heavy imports wait until a command needs them, so that `barchan --help` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, cast

import typer

from barchan.errors import InputError

BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 2, 3, 130

# What typer raises for a wrong command line (the class is not exported under its own name).
_UsageError = cast("type[typer.BadParameter]", typer.BadParameter.__bases__[0])

app = typer.Typer(
    add_completion=False,
    help="Granular matter and frictional contact, solved as one discrete problem.",
)

bench = typer.Typer(help="Measure: solvers over many problems, time steps beside another program.")
app.add_typer(bench, name="bench")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line (`arguments` default to those of the process) and return the exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        code = app(args=given or ["--help"], prog_name="barchan", standalone_mode=False)
    except InputError as error:
        return _complain(str(error), BAD_INPUT)
    except _UsageError as error:
        return _complain(error.format_message(), BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        sys.stderr.write("barchan: interrupted\n")
        return INTERRUPTED
    return code if isinstance(code, int) else 0


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="Preset name (see `barchan scenes`) or a .toml file.")],
    out: Annotated[Path | None, typer.Option(help="Run folder; default: a new runs/<scene>-<n>.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a parameter; repeatable.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the run in --out after any kill.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary.")] = False,
) -> None:
    """Simulate a scene and store results, summary and pictures in a run folder."""
    from barchan.cli.run import run_command

    raise typer.Exit(run_command(scene, out, settings or [], resume, quiet))


@app.command()
def scenes() -> None:
    """List the scenes that come with barchan."""
    from barchan.cli.run import list_scenes

    list_scenes()


@app.command()
def solve(
    file: Annotated[Path, typer.Argument(help="A friction problem: FCLIB .hdf5 or .dat.")],
    method: Annotated[str, typer.Option(help="Solver name.")] = "auto",
    tol: Annotated[float, typer.Option(help="Largest certificate accepted.")] = 1e-6,
    existence: Annotated[
        bool, typer.Option("--existence", help="First ask whether there is a solution at all.")
    ] = False,
) -> None:
    """Solve a friction problem from a file and show its certificate."""
    from barchan.cli.solve import solve_command

    raise typer.Exit(solve_command(file, method, tol, existence))


@app.command()
def reproduce(
    name: Annotated[str | None, typer.Argument(help="What to compute again; without it a list.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of runs, tables and pictures; default: runs/reproduce-<name>.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and coarser runs.")] = False,
    processes: Annotated[int, typer.Option(help="How many scenes run at a time.")] = 2,
) -> None:
    """Compute published figures and tables again and show both; goes on where an interrupted call was."""
    from barchan.cli.reproduce import reproduce_command

    raise typer.Exit(reproduce_command(name, out, quick, processes))


@bench.command("solvers")
def bench_solvers(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of problem files; without it a family made by barchan.")
    ] = None,
    methods: Annotated[
        str, typer.Option(help="Methods, separated by commas, or 'all'.")
    ] = "auto,gauss_seidel,aspg",
    tol: Annotated[float, typer.Option(help="Certificate to reach.")] = 1e-6,
    time_limit: Annotated[float, typer.Option(help="Seconds for one solve.")] = 10.0,
    repeats: Annotated[int, typer.Option(help="Solves of which the shortest counts.")] = 3,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default: a new runs/bench-solvers-<n>.")
    ] = None,
    family: Annotated[str, typer.Option(help="Family made by barchan, when there is no folder.")] = "small",
    convexified: Annotated[
        bool, typer.Option("--convexified", help="Compare on the associated laws; no peers then.")
    ] = False,
    no_peers: Annotated[bool, typer.Option("--no-peers", help="Leave the solvers of Siconos out.")] = False,
) -> None:
    """Compare solvers: tables, a performance profile, residual against time."""
    from barchan.bench import Plan
    from barchan.cli.bench import bench_solvers as command

    plan = Plan(tolerance=tol, time_limit=time_limit, repeats=repeats, peers=not no_peers)
    raise typer.Exit(command(folder, family, methods, plan, out, convexified))


@bench.command("siconos")
def bench_siconos(
    files: Annotated[list[Path], typer.Argument(help="FCLIB files (.hdf5), as scenes of bodies write them.")],
    tol: Annotated[float, typer.Option(help="Tolerance of Siconos, in its own measure.")] = 1e-8,
) -> None:
    """Siconos reads FCLIB files, solves them and writes its answers; our certificate judges them."""
    from barchan.cli.bench import bench_siconos as command

    raise typer.Exit(command(files, tol))


@bench.command("mpm")
def bench_mpm(
    newton: Annotated[
        Path | None,
        typer.Option(help="Python that has NVIDIA Newton; default: BARCHAN_NEWTON, usual places."),
    ] = None,
    blocks: Annotated[int, typer.Option(help="Blocks of steps that the programs make in turn.")] = 7,
    steps: Annotated[int, typer.Option(help="Steps in a block.")] = 10,
    tol: Annotated[float, typer.Option(help="Tolerance of both programs.")] = 1e-4,
    threads: Annotated[int, typer.Option(help="Threads of barchan; Newton has one.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default: a new runs/bench-mpm-<n>.")
    ] = None,
    alone: Annotated[bool, typer.Option("--alone", help="Leave Newton out.")] = False,
) -> None:
    """Seconds a step and certificates of a collapsing column, beside NVIDIA Newton's implicit MPM."""
    from barchan.bench.mpm import ColumnPlan
    from barchan.cli.bench import bench_mpm as command

    plan = ColumnPlan(blocks=blocks, steps=steps, tolerance=tol, threads=threads)
    raise typer.Exit(command(plan, newton, alone, out))


def _complain(message: str, code: int) -> int:
    """One line on standard error."""
    sys.stderr.write(f"barchan: error: {' '.join(message.split())}\n")
    return code
