"""The command line: ``tribox run``, ``check``, ``mesh``, ``plot``, ``map``, ``fit``, ..."""

from __future__ import annotations

import difflib
import json
import os
import platform
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

# Typer loads rich, and with it a reader of Markdown, for help texts that this program does not
# have. A tenth of a second is saved where it does not find it; the rest of the program does.
_rich = sys.modules.get("rich")
sys.modules["rich"] = None  # type: ignore[assignment]
import typer  # noqa: E402
from click import UsageError  # noqa: E402
from typer.core import TyperGroup  # noqa: E402

del sys.modules["rich"]
if _rich is not None:
    sys.modules["rich"] = _rich

import tribox  # noqa: E402
from tribox.app.errors import InputError, Interrupted  # noqa: E402
from tribox.app.run.process import lasting_imports, with_sources  # noqa: E402
from tribox.app.run.ranks import end_interrupted, end_with, ensure_cache  # noqa: E402

if TYPE_CHECKING:
    from click import Context


class _Stopped(Exception):
    """A ``KeyboardInterrupt`` out of a command; Typer would end the program with it.

    Attributes:
        together: whether it came on all ranks between two steps.
    """

    def __init__(self, together: bool) -> None:
        super().__init__("interrupted")
        self.together = together


class _Commands(TyperGroup):
    """All commands."""

    def make_context(self, *args: Any, **more: Any) -> Context:
        """Read the words of the command line."""
        try:
            return super().make_context(*args, **more)
        except KeyboardInterrupt:
            raise _Stopped(False) from None

    def resolve_command(self, ctx: Context, args: list[str]) -> Any:
        """Find the command, or say which was probably meant."""
        try:
            return super().resolve_command(ctx, args)
        except UsageError as error:
            if hint := self._meant(args[0]):
                error.message = f"{error.message.rstrip('.')}; did you mean {hint}?"
            raise

    def _meant(self, word: str) -> str:
        """What somebody meant by a word that is no command; "" if there is no telling."""
        if word.endswith(".toml"):
            return f'"tribox run {word}"'
        shown = [name for name, command in self.commands.items() if not command.hidden]
        near = difflib.get_close_matches(word, shown, n=1)
        return f'"{near[0]}"' if near else ""

    def invoke(self, ctx: Context) -> Any:
        """Run one of them."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise _Stopped(isinstance(error, Interrupted)) from None


cli = typer.Typer(
    cls=_Commands,
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Finite-strain frictional contact of an elastomer on aluminium through a lubricating "
    "film. Exit codes: 0 done, 2 wrong input, 3 no solution (the last good state is saved), 4 "
    "results cannot be written, 130 stopped by a signal (the state is saved).",
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import PackageNotFoundError, version

        from tribox import __version__

        print(f"tribox {__version__}")
        for name, package in _BELOW.items():
            try:
                print(f"{name} {version(package)}")
            except PackageNotFoundError:
                print(f"{name}: not found")
        print(f"Python {platform.python_version()}")
        raise typer.Exit


# What results depend on beside the program itself, by the names of the packages.
_BELOW = {
    "DOLFINx": "fenics-dolfinx",
    "FFCx": "fenics-ffcx",
    "petsc4py": "petsc4py",
    "mpi4py": "mpi4py",
    "gmsh": "gmsh",
    "NumPy": "numpy",
}


@cli.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="print versions and exit"
        ),
    ] = False,
) -> None:
    pass


@cli.command()
def init(
    kind: Annotated[
        str, typer.Argument(metavar="[two-blocks|own-mesh|forming]", help="which starter")
    ] = "two-blocks",
    target: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE|DIR]", help="case file (.toml) or directory (default: here)"),
    ] = None,
) -> None:
    """Write a commented starter case that runs at once, with its mesh and a schema for editors."""
    from tribox.app.init import write_starter

    made = write_starter(kind, target)
    for path in made:
        print(f"wrote {path}")
    print(f"next: tribox check {made[0]}, tribox run {made[0]}")


CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="case file (TOML)")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="change a key of the case; may be repeated"),
]


Resume = Annotated[
    bool, typer.Option("--resume", help="go on from the last checkpoint of an unfinished run")
]
Extend = Annotated[
    bool, typer.Option("--extend", help="the same, and past the end of a run that is done")
]
Trust = Annotated[bool, typer.Option("--trust", help="run the code that the case names")]


@cli.command()
def run(
    case_file: CaseFile,
    out: Annotated[
        Path | None, typer.Option(help="results directory (default: results/CASE)")
    ] = None,
    overrides: Overrides = None,
    np: Annotated[int, typer.Option("--np", min=1, help="MPI ranks to run on")] = 1,
    force: Annotated[bool, typer.Option("--force", help="replace results that are there")] = False,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="runs of a sweep at a time (default: cores / ranks)")
    ] = None,
    part: Annotated[
        int | None, typer.Option(min=0, help="run only this value of the sweep, counted from 0")
    ] = None,
    trust: Trust = False,
    resume: Resume = False,
    extend: Extend = False,
    inputs_of: Annotated[Path | None, typer.Option("--inputs-of", hidden=True)] = None,
) -> None:
    """Run a case, or every value of its sweep, and write results and figures."""
    with lasting_imports():
        from tribox.app.run.command import run_command
        from tribox.app.run.ranks import RunOptions

    given = overrides or []
    _end(
        run_command(
            case_file,
            RunOptions(out, given, np, force, jobs, part, trust, resume, extend, inputs_of),
        )
    )


def _end(code: int) -> None:
    """End with an exit code, unless that is 0."""
    if code:
        raise typer.Exit(code)


@cli.command()
def check(
    case_file: CaseFile,
    overrides: Overrides = None,
    law: Annotated[
        bool, typer.Option("--law", help="try the friction laws too: derivatives and dissipation")
    ] = False,
    trust: Trust = False,
) -> None:
    """Check a case file without running it, nor code that it names; every problem is one line."""
    from tribox.app.run.command import run_check

    _end(run_check(case_file, overrides or [], law, trust))


@cli.command()
def mesh(
    case_file: Annotated[
        Path,
        typer.Argument(metavar="CASE|FILE.geo|FILE.step", help="case file (TOML), or a drawing"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="directory of mesh and picture (default: results/CASE-mesh); of a drawing the "
            "mesh file (default: FILE.msh)"
        ),
    ] = None,
    overrides: Overrides = None,
    force: Annotated[bool, typer.Option("--force", help="replace files that are there")] = False,
    trust: Annotated[
        bool, typer.Option("--trust", help="run the script that a drawing is")
    ] = False,
) -> None:
    """Write the mesh of a case or drawing (.msh) and a picture of it with its names."""
    from tribox.app.run.mesh_files import write_case_mesh, write_drawing_mesh
    from tribox.geometry.meshes.drawing import DRAWINGS

    if case_file.suffix.lower() in DRAWINGS:
        if overrides:
            raise InputError(f"--set {overrides[0]}: {case_file} is a drawing, not a case")
        write_drawing_mesh(case_file, out, force, trust)
    else:
        write_case_mesh(case_file, overrides or [], out, force, trust)


# Of commands whose words are another program's.
_PASSED_ON = {"allow_extra_args": True, "ignore_unknown_options": True}


@cli.command()
def plot(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="results directory")],
    field: Annotated[
        str,
        typer.Option(metavar="NAME", help="array of the field files that bodies are coloured by"),
    ] = "von_mises_stress",
    animate: Annotated[bool, typer.Option("--animate", help="write an animation too")] = False,
) -> None:
    """Draw the figures of a results directory again from its files, or those of a sweep's runs."""
    from tribox.app.figures.run_figures import redraw

    redraw(directory, field, animate)


@cli.command()
def report(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="results directory")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="the page (default: DIR/report.html)")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace a file of --out")] = False,
) -> None:
    """Write a results directory as one HTML page that needs nothing else."""
    from tribox.app.report import write_report
    from tribox.app.results import read

    if out is not None and out.exists() and not force:
        raise InputError(f"{out}: exists already; replace it with --force")
    page = write_report(directory, out)
    if unfinished := read(directory).unfinished:
        print(f"note: the run {unfinished}")
    print(f"wrote {page}")


@cli.command(name="map")
def map_(
    case_file: Annotated[
        Path | None, typer.Argument(metavar="[CASE]", help="case file (default: built-in values)")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="results directory (default: results/CASE-map)")
    ] = None,
    overrides: Overrides = None,
    force: Annotated[bool, typer.Option("--force", help="replace results that are there")] = False,
) -> None:
    """Map the friction law of a case at material points: tables and figures, in seconds."""
    from tribox.app.friction_map import run_map

    run_map(case_file, overrides or [], out, force)


FittedLaw = Annotated[
    str | None,
    typer.Option(
        help="friction-map (default), or without a film stribeck or coulomb; with --material "
        "prony, linear, voce or swift (default: by the columns, and what fits best)"
    ),
]
Branches = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="with --material: Prony branches or back stresses (default: as fits)"
    ),
]
Measure = Annotated[
    str | None,
    typer.Option(
        metavar="[shear|tensile|engineering|true]",
        help="with --material: what columns are whose names do not say it",
    ),
]
FittedBody = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="with --material: body that the section is written for"),
]


@cli.command()
def fit(
    data: Annotated[Path, typer.Argument(metavar="DATA.csv", help="measurements")],
    material: Annotated[
        bool,
        typer.Option("--material", help="fit a rubber or metal to its test instead of friction"),
    ] = False,
    parameters: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="what to fit (default: by the columns)")
    ] = None,
    fixed: Annotated[
        list[str] | None,
        typer.Option("--fix", metavar="KEY=VALUE", help="fix a parameter, or give a column"),
    ] = None,
    start: Annotated[
        list[str] | None,
        typer.Option("--start", metavar="KEY=VALUE", help="where the search begins"),
    ] = None,
    law: FittedLaw = None,
    branches: Branches = None,
    measure: Measure = None,
    body: FittedBody = None,
    ignored: Annotated[
        str | None,
        typer.Option("--ignore-columns", metavar="NAME,...", help="columns that are not read"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="results directory (default: results/DATA-fit)")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace results that are there")] = False,
) -> None:
    """Calibrate a friction law to tribometer data, or with --material a rubber or metal."""
    unread = [name.strip() for name in (ignored or "").split(",") if name.strip()]
    if material:
        from tribox.app.fit.material import MaterialOptions
        from tribox.app.fit.material_files import run_material

        _refuse({"--parameters": parameters, "--start": start}, "has no part in --material")
        options = MaterialOptions(law, branches, measure, fixed or [], unread, body)
        run_material(data, options, out, force)
        return
    from tribox.app.fit.run import run_fit

    _refuse(
        {"--branches": branches, "--measure": measure, "--body": body}, "goes with --material only"
    )
    run_fit(data, parameters, fixed or [], start or [], out, force, law or "friction-map", unread)


def _refuse(options: dict[str, object], reason: str) -> None:
    """Refuse options that were given and have no meaning."""
    for option, value in options.items():
        if value not in (None, []):
            raise InputError(f"{option}: {reason}")


@cli.command(context_settings=_PASSED_ON, add_help_option=False)
def bench(context: typer.Context) -> None:
    """Measure where the CPU time of a case goes, or compare two versions, in a checkout."""
    _run_beside("bench", "benchmarks.bench", context.args)


@cli.command(context_settings=_PASSED_ON, add_help_option=False)
def verify(context: typer.Context) -> None:
    """Compute cases and compare them with closed forms, in a checkout; exit code 3 if one fails."""
    _run_beside("verify", "benchmarks.verify", context.args)


def _run_beside(command: str, module: str, words: list[str]) -> None:
    """Become a program of the source tree's benchmarks."""
    root = _checkout(command, "benchmarks")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(root), with_sources(os.environ)["PYTHONPATH"]])
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *words])


@cli.command()
def materials(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME ...]", help="entries (default: list all)")
    ] = None,
) -> None:
    """List the materials library, or print entries with each number and its source."""
    from tribox.app.case.library import description, listing

    lines = [line for name in names or [] for line in description(name)]
    print("\n".join(lines if names else listing()))


@cli.command()
def schema() -> None:
    """Print the JSON schema of case files."""
    from tribox.app.case.schema import json_schema

    print(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@cli.command(context_settings=_PASSED_ON | {"allow_interspersed_args": False})
def python(
    context: typer.Context,
    script: Annotated[Path, typer.Argument(help="file of Python, with its own arguments behind")],
) -> None:
    """Run a script that imports tribox's packages, such as one that reads results."""
    if not script.is_file():
        raise InputError(f"{script}: no such file")
    os.environ |= with_sources(os.environ)
    os.execv(sys.executable, [sys.executable, str(script), *context.args])


@cli.command(context_settings=_PASSED_ON)
def test(
    context: typer.Context,
    every: Annotated[bool, typer.Option("--all", help="the long system tests too")] = False,
) -> None:
    """Run the tests that guard a change, or all there are; further words go to pytest."""
    os.chdir(_checkout("test", "tests"))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"]
    if not every:
        command += ["-m", "not long"]
    if not context.args and find_spec("xdist") is not None:
        command += ["-n", "2", "--dist", "loadfile"]  # all of it: two files at a time
    os.execv(sys.executable, [*command, *context.args])


def _checkout(command: str, part: str) -> Path:
    """The source tree, which alone has the tests and benchmarks."""
    root = Path(tribox.__file__).parents[2]
    if not (root / part).is_dir():
        raise InputError(
            f"{command}: the {part} are in the source tree, not in an installation of tribox"
        )
    return root


@cli.command(hidden=True)
def precompile() -> None:
    """Compile every form into the cache, so that the first run need not."""
    import tribox.app.precompile

    tribox.app.precompile.main()


def main() -> None:
    """Run the command line; errors of ours become one line and an exit code."""
    try:
        ensure_cache()
        cli(prog_name="tribox")
    except _Stopped as stopped:
        end_interrupted(stopped.together)
    except KeyboardInterrupt:
        end_interrupted(False)
    except Exception as error:
        end_with(error)


if __name__ == "__main__":
    main()
