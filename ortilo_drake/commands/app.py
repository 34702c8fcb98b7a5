"""The command line `ortilo`: all its commands, and their exit codes."""

import contextlib
import logging
import subprocess
from pathlib import Path
from typing import Annotated, Any

import typer

from ortilo_drake.commands.analyze import analyze
from ortilo_drake.commands.detector import detector_app
from ortilo_drake.commands.diagram import diagram
from ortilo_drake.commands.doctor import doctor
from ortilo_drake.commands.export import export
from ortilo_drake.commands.faults import faults
from ortilo_drake.commands.fit import fit
from ortilo_drake.commands.fly import fly
from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.commands.hindsight import hindsight
from ortilo_drake.commands.live import live
from ortilo_drake.commands.map import map_
from ortilo_drake.commands.predict import predict
from ortilo_drake.commands.rare import rare
from ortilo_drake.commands.replay import replay
from ortilo_drake.commands.report import report
from ortilo_drake.commands.room.app import room_app
from ortilo_drake.commands.scenario import scenario_app
from ortilo_drake.commands.sensitivity import sensitivity
from ortilo_drake.commands.tables import tables
from ortilo_drake.commands.terminal import out
from ortilo_drake.commands.tune import tune
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.problems import plainly
from ortilo_drake.model.parts import load_plugin
from ortilo_drake.views.pictures import Format, drawn_as
from ortilo_drake.views.themes import Theme, themed

app = typer.Typer(
    help="A laboratory for indoor navigation with intermittent sensors, built on Drake.",
    no_args_is_help=True,
    rich_markup_mode="markdown",  # Rich's own markup would read a unit such as [s] as a style and drop it
    pretty_exceptions_enable=False,
)


def commit(checkout: Path) -> str:
    """Return the commit of a git checkout, with -dirty if files have changed; empty if there is no checkout."""
    if not (checkout / ".git").exists():
        return ""
    command = ("git", "-C", str(checkout), "describe", "--always", "--dirty", "--exclude", "*")
    with contextlib.suppress(OSError):
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return ""


def _say_version(asked: bool) -> None:
    """Print the versions of this program, Drake and Python, and the commit if this is a git checkout; then exit."""
    if asked:
        from ortilo_drake.views.page.shell import versions

        found = commit(Path(__file__).parents[2])
        out.print(versions() + (f", commit {found}" if found else ""), highlight=False)
        raise typer.Exit


@app.callback()
def set_up(
    context: typer.Context,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="Run this Python file, which registers parts of your own (examples/). May be repeated."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Use the workers of this Dask scheduler: tcp:// or tls:// (docs/cluster.md)."
        ),
    ] = None,
    theme: Annotated[
        Theme, typer.Option(metavar="THEME", help="The style of all figures: light, dark, slides or print.")
    ] = Theme.light,
    title: Annotated[str, typer.Option(metavar="TEXT", help="A title for all figures, instead of their own.")] = "",
    figures: Annotated[
        Format, typer.Option(metavar="FORMAT", help="The format of figures in an --out folder: png, svg or pdf.")
    ] = Format.png,
    version: Annotated[
        bool, typer.Option("--version", callback=_say_version, is_eager=True, help="Print the versions and exit.")
    ] = False,
) -> None:
    """Run the files that register parts, before the command reads a scenario that names them; join a cluster."""
    # Drake, imported later, sets the level to INFO.
    logging.getLogger("drake").addFilter(lambda record: record.levelno >= logging.WARNING)
    context.with_resource(themed(theme, title))
    context.with_resource(drawn_as(figures))
    for file in plugin or ():
        load_plugin(file)
    if scheduler is not None:
        from ortilo_drake.flight.processes.scheduler import on_scheduler

        context.with_resource(on_scheduler(scheduler))


for command in (
    fly,
    live,
    tables,
    diagram,
    export,
    analyze,
    tune,
    replay,
    fit,
    predict,
    report,
    sensitivity,
    faults,
    hindsight,
    rare,
    doctor,
):
    app.command()(command)
app.command("map")(map_)
app.add_typer(scenario_app, name="scenario")
app.add_typer(detector_app, name="detector")
app.add_typer(hil_app, name="hil")
app.add_typer(room_app, name="room")


def _plain_usage(error: Any) -> str:
    """Return the error in the arguments as one line."""
    option, context = getattr(error, "option_name", None), error.ctx
    if context is not None and option in ("--plugin", "--scheduler", "--theme", "--title", "--figures"):
        command = context.info_name
        while (context := context.parent).parent is not None:
            command = f"{context.info_name} {command}"
        return f"{option}: must stand before the command: ortilo {option} ... {command} ..."
    what, colon, rest = " ".join(error.format_message().split()).partition("': ")
    return what + colon + (plainly(rest) if colon else "")


def run() -> int:
    """Run the command that the command line names; return its exit code.

    InputError if the arguments, or the files that they name, are wrong; KeyboardInterrupt on Ctrl-C.
    """
    usage_error = typer.BadParameter.__base__  # click's UsageError; some versions of Typer have a copy of it
    assert usage_error is not None
    try:
        code = app(standalone_mode=False)
    except usage_error as error:  # type: ignore[misc]  # an exception class, but mypy cannot know
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return 2
        raise InputError(_plain_usage(error)) from None
    except typer.Abort:
        raise KeyboardInterrupt from None
    if code == 130:  # some versions of Typer turn Ctrl-C into this
        raise KeyboardInterrupt
    return int(code or 0)
