"""The commands `ortilo scenario list`, `show`, `check`, `keys` and `schema`."""

import json
from typing import Annotated

import typer
import yaml
from rich.padding import Padding
from rich.text import Text

from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SetOption
from ortilo_drake.commands.terminal import DOUBTFUL, out, say, say_warnings
from ortilo_drake.model.input_files import read_text
from ortilo_drake.model.typed_yaml import InputError, nearest
from ortilo_drake.scenario import SCENARIO_FOLDER, load_scenario, scenario_names
from ortilo_drake.scenario.schema import scenario_keys, scenario_schema

LAGGING = "world={kinematics: rigid_body, plant: continuous, rotors: {kind: first_order}}"

scenario_app = typer.Typer(help="List, show and check scenarios and their settings.", no_args_is_help=True)


@scenario_app.command("list")
def list_scenarios() -> None:
    """List the ready-made scenarios with the first line of their description."""
    for name in scenario_names():
        _, first, *_ = read_text(SCENARIO_FOLDER / f"{name}.yaml").splitlines()  # the first line is for editors
        out.print(f"[bold]{name:23}[/bold]{first.removeprefix('#').strip()}", soft_wrap=True)


@scenario_app.command("show")
def show_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Print a scenario in full, every default filled in, as YAML that loads again."""
    chosen = load_scenario(scenario, tuple(settings or ()))
    say(yaml.safe_dump(chosen.model_dump(mode="json"), sort_keys=False), end="")


@scenario_app.command("check")
def check_scenario(scenario: ScenarioArgument = DEFAULT_SCENARIO, settings: SetOption = None) -> None:
    """Check a scenario and say what its vehicle can do: the errors and warnings are those of `ortilo fly`.

    The exit code is 0 if there are none, 2 after an error and 3 after warnings.
    """
    chosen = load_scenario(scenario, tuple(settings or ()))
    from ortilo_drake.flight.flyable import check_flyable
    from ortilo_drake.model.vehicle import M100
    from ortilo_drake.studies.cautions.cautions import cautions
    from ortilo_drake.studies.cautions.lagging import filter_for_lag

    seconds = check_flyable(chosen) * chosen.h
    warnings = cautions(chosen, scenario, settings or ())
    say_warnings(warnings)
    say(f"{chosen.name}: {'doubtful' if warnings else 'valid'}; flies {seconds:.1f} s with {', '.join(chosen.sensors)}")
    vehicle = chosen.vehicle
    hover = vehicle.hover_rotor_speeds.max()
    say(
        f"  vehicle: {vehicle.mass:g} kg, {vehicle.rotor_count} rotors; hovers at {hover:.4g} rad/s, "
        f"{hover / vehicle.rotor_max_speed:.0%} of the largest speed; "
        f"lifts at most {vehicle.largest_thrust / vehicle.hover_thrust:.1f} times its weight"
    )
    up, down = lags = vehicle.rotor_time_constant
    if chosen.world.rotors.kind == "ideal" and lags != M100.rotor_time_constant:
        note = f"ideal: the vehicle's lag of {up:g} and {down:g} s is not simulated; `--set '{LAGGING}'` simulates it"
        say(f"  rotors: {note}")
    if not warnings and (line := filter_for_lag(chosen)):
        say(f"  filter: {line}")
    if warnings:
        raise typer.Exit(DOUBTFUL)


@scenario_app.command("keys")
def list_keys(
    prefix: Annotated[str, typer.Argument(help="Only this group, such as uwb.link, or this setting.")] = "",
) -> None:
    """List every setting with what it allows, its unit, its default and what it means."""
    found = scenario_keys(prefix)
    if not found:
        known = {".".join(key.key.split(".")[:n]) for key in scenario_keys() for n in range(1, 6)}
        raise InputError(f"{prefix}: no such setting{nearest(prefix, sorted(known))}")
    rows = [(k.key, k.allowed, k.unit, k.default, f"{k.kind}: {k.meaning}" if k.kind else k.meaning) for k in found]
    if not out.is_terminal:
        for row in (("key", "allowed", "unit", "default", "meaning"), *rows):
            typer.echo("\t".join(row))  # Rich would replace tabs by spaces
        return
    for key, allowed, unit, default, meaning in rows:  # no table: 80 columns would cut the keys short
        facts = [allowed, f"[{unit}]" if unit else "", "needed" if default == "needed" else f"default {default}"]
        out.print(Text.assemble((key, "cyan"), "  ", ", ".join(filter(None, facts))))
        out.print(Padding(Text(meaning), (0, 0, 0, 4)))


@scenario_app.command("schema")
def print_schema() -> None:
    """Print the JSON schema of a scenario, with which editors complete and check its YAML."""
    typer.echo(json.dumps(scenario_schema(), indent=1))
