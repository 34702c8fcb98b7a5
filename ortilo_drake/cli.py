"""The command `ortilo`."""

import sys
from typing import NoReturn

import typer

from ortilo_drake.commands.analyze import analyze
from ortilo_drake.commands.detector import detector_app
from ortilo_drake.commands.diagram import diagram
from ortilo_drake.commands.fly import fly
from ortilo_drake.commands.hil import hil_app
from ortilo_drake.commands.replay import replay
from ortilo_drake.commands.scenario import scenario_app
from ortilo_drake.commands.tables import tables
from ortilo_drake.commands.terminal import err
from ortilo_drake.commands.tune import tune
from ortilo_drake.model.typed_yaml import InputError

app = typer.Typer(
    help="A laboratory for indoor navigation with sensors that come and go, built on Drake.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command in (fly, tables, diagram, analyze, tune, replay):
    app.command()(command)
app.add_typer(scenario_app, name="scenario")
app.add_typer(detector_app, name="detector")
app.add_typer(hil_app, name="hil")


def main() -> None:
    """Run the command; bad input ends it with one line and exit code 2, Ctrl-C with 130."""
    usage_error = typer.BadParameter.__base__  # Typer's own copy of click's, by whichever name it has it
    assert usage_error is not None
    try:
        code = app(standalone_mode=False)
        if code == 130:  # some versions of Typer turn Ctrl-C into this
            raise KeyboardInterrupt
        sys.exit(code)
    except InputError as error:
        _fail(str(error), 2)
    except usage_error as error:  # type: ignore[misc]  # an exception class, but mypy cannot know
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            sys.exit(2)
        _fail(" ".join(error.format_message().split()), 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted; what is finished is kept", 130)


def _fail(line: str, code: int) -> NoReturn:
    err.print(f"ortilo: {line}", style="red", markup=False, soft_wrap=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
