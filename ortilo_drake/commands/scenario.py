"""The commands `ortilo scenario list`, `show` and `check`."""

import typer
import yaml

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption, quiet_drake
from ortilo_drake.commands.terminal import out
from ortilo_drake.model.input_files import read_text
from ortilo_drake.scenario import SCENARIO_FOLDER, load_scenario, scenario_names

scenario_app = typer.Typer(help="List, show and check scenarios.", no_args_is_help=True)


@scenario_app.command("list")
def list_scenarios() -> None:
    """List the ready-made scenarios with the first line of their description."""
    for name in scenario_names():
        first = read_text(SCENARIO_FOLDER / f"{name}.yaml").splitlines()[0]
        out.print(f"[bold]{name:20}[/bold]{first.removeprefix('#').strip()}", soft_wrap=True)


@scenario_app.command("show")
def show_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Print a scenario in full, every default filled in, as YAML that loads again."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    out.print(yaml.safe_dump(chosen.model_dump(mode="json"), sort_keys=False), end="", markup=False, soft_wrap=True)


@scenario_app.command("check")
def check_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Check a scenario: all that `ortilo fly` would refuse is refused here."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    from ortilo_drake.flight.flyable import check_flyable

    quiet_drake()
    seconds = check_flyable(chosen) * chosen.h
    out.print(f"{chosen.name}: valid; flies {seconds:.1f} s with {', '.join(chosen.sensors)}")
