"""Every ready-made scenario, and three with a part of one's own, through every command that takes one.

However a command ends, it ends with what was asked for, or with exit code 2 and one line; never with a traceback, which
in this process is an exception that reaches the test.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import run

import ortilo_drake as od
from ortilo_drake.commands.fly import LOST
from ortilo_drake.commands.terminal import DOUBTFUL
from ortilo_drake.hil.live.controls import Controls
from ortilo_drake.model.parts import load_plugin
from ortilo_drake.scenario import scenario_names
from ortilo_drake.studies.command_link.command_report import CommandReport, LinkFigures
from ortilo_drake.studies.linearization.linearize import PARTS
from ortilo_drake.studies.report import analyze
from ortilo_drake.studies.sensitivity import sensitivity_flights
from ortilo_drake.studies.sensitivity.mismatches import mismatches_of

pytestmark = pytest.mark.usefixtures("cut_short", "own_register")
PLUGIN = str(Path(__file__).parents[1] / "registered_parts.py")
OWN = {
    "own_servo": {"base": "nominal_imu_uwb", "servo": {"kind": "own_servo"}},
    "own_estimator": {"base": "nominal_imu_uwb_yolo", "estimator": {"kind": "own_estimator"}},
    "own_planner": {"base": "nominal_imu_uwb", "planner": {"kind": "own_planner"}},
}
SCENARIOS = [*scenario_names(), *OWN]
SETTINGS = {"camera.kind": "projected", "settle": 0.0}
HOVER = {"planner": {"kind": "hover", "point": [8.0, 1.0, 1.5]}}
SHORT = 0.6  # of a flight [s]
HIL = ("--url", "URL", "--wait", "1", "--insecure")


def changes(scenario: str, duration: float = SHORT) -> dict[str, object]:
    """A hovering flight of that long; a planner of one's own flies its own path."""
    planner = {} if scenario == "own_planner" else HOVER
    return SETTINGS | planner | {"planner.duration": duration}


def settings(scenario: str, duration: float) -> list[str]:
    return [word for key, value in changes(scenario, duration).items() for word in ("--set", f"{key}={value}")]


def file_of(scenario: str, folder: Path) -> str:
    if scenario not in OWN:
        return scenario
    (file := folder / f"{scenario}.yaml").write_text(yaml.safe_dump(OWN[scenario]))
    return str(file)


def ortilo(*what: object, scenario: str) -> int:
    return run(*(("--plugin", PLUGIN) if scenario in OWN else ()), *map(str, what))


Command = Callable[[str, Path, str], int]  # a scenario's name, a folder and a bus, to the exit code


def filled(what: tuple[object, ...], **places: object) -> list[str]:
    """Return a command's words with what stands in place of S (scenario), F (folder) and URL (bus)."""
    return [str(places.get(str(word), str(word).replace("F/", f"{places['F']}/"))) for word in what]


def with_settings(*what: object, duration: float = SHORT) -> Command:
    """A command that takes a scenario and --set."""

    def command(scenario: str, folder: Path, url: str) -> int:
        words = filled(what, S=file_of(scenario, folder), F=folder, URL=url)
        return ortilo(*words, *settings(scenario, duration), scenario=scenario)

    return command


def of_a_flight(*what: object, duration: float = SHORT) -> Command:
    """A command on what `ortilo fly` wrote."""

    def command(scenario: str, folder: Path, url: str) -> int:
        fly = with_settings("fly", "S", "--out", "F/flight.nc", "--log", "F/log", duration=duration)
        flown = fly(scenario, folder, url)
        return ortilo(*filled(what, F=folder), scenario=scenario) if flown in (0, LOST) else flown

    return command


def of_a_file(content: dict[str, object], *what: object) -> Command:
    """A command on a file that names a scenario."""

    def command(scenario: str, folder: Path, url: str) -> int:
        data = content | {"scenario": file_of(scenario, folder), "settings": changes(scenario)}
        (folder / "study.yaml").write_text(yaml.safe_dump(data))
        return ortilo(*filled(what, F=folder), scenario=scenario)

    return command


def linearized(scenario: str, folder: Path, url: str) -> int:
    """Not a command: `linearize` of Python, each part."""
    if scenario in OWN:
        load_plugin(Path(PLUGIN))
    chosen = od.load_scenario(file_of(scenario, folder), changes(scenario))
    refused: dict[str, str] = {}
    for part in PARTS:
        try:
            assert np.isfinite(od.linearize(chosen, part).D).all()
        except od.InputError as error:
            refused[part] = str(error)
    assert not {"plant", "rotors_and_plant", "sampled_plant"} & set(refused)  # whatever flies onboard
    print(*(f"ortilo: {line}" for line in set(refused.values())), sep="\n", file=sys.stderr)
    return 2 if refused else 0


LINKS = {"uwb.link.loss": [0.2, 0.5]}
RANGE = {"start": 0.5, "stop": 2.0}
SEARCH = {
    "axes": {"servo.weights.position": RANGE, "servo.weights.angle": RANGE},
    "flights": 2,
    "judge": 2,
    "evaluations": 5,
}
ONE = ("--flights", 1, "--workers", 1)
COMMANDS: dict[str, Command] = {
    "scenario show": with_settings("scenario", "show", "S"),
    "scenario check": with_settings("scenario", "check", "S"),
    "fly": with_settings("fly", "S", "--json", "F/fly.json", "--html", "F/fly.html", "--png", "F/fly.png"),
    "live": with_settings("live", "S", "--no-wait"),
    "diagram": with_settings("diagram", "S", "--svg", "F/diagram.svg"),
    "export": with_settings("export", "S", "--target", "x86-64", "--ticks", 3, "--out", "F/half"),
    "analyze": with_settings("analyze", "S", "--flights", 0, "--out", "F/analyze"),
    "hindsight": with_settings("hindsight", "S", *ONE),
    "sensitivity": with_settings("sensitivity", "S", *ONE, "--out", "F/sensitivity"),
    "faults": with_settings(
        "faults", "S", *ONE, "--faults", "gust,yaw_jump", "--start", 0.5, "--length", 0.5, "--out", "F/faults",
        duration=11.5,
    ),
    "rare": with_settings("rare", "S", "--paths", 20, "--repetitions", 2, "--workers", 1, "--out", "F/rare"),
    "tables": with_settings("tables", "--beside", "S", *ONE, "--out", "F/tables"),
    "map": of_a_file({"axes": LINKS, "flights": 1}, "map", "F/study.yaml", "--workers", 1, "--out", "F/map"),
    "tune": of_a_flight("tune", "F/flight.nc", duration=12.0),
    "tune --fly": of_a_file(SEARCH, "tune", "F/study.yaml", "--fly", "--workers", 1, "--kept", "F/tune"),
    "report": of_a_flight("report", "F/flight.nc"),
    "replay": of_a_flight("replay", "F/log"),
    "hindsight of a log": of_a_flight("hindsight", "F/log"),
    "hil world": with_settings("hil", "world", "S", *HIL),
    "hil onboard": with_settings("hil", "onboard", "S", *HIL),
    "hil bridge": with_settings("hil", "bridge", "S", *HIL, "--mavlink", "udpout:127.0.0.1:14599"),
    "hil goal": with_settings("hil", "goal", 8, 1, "S", *HIL),
    "room coverage": with_settings("room", "coverage", "S"),
    "room place": with_settings("room", "place", "S", 4, "--spacing", 4),
    "linearize": linearized,
}  # fmt: skip


@pytest.fixture
def cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what costs minutes and has tests of its own, and what waits for a user."""
    no_commands = CommandReport("", 1, 0.5, {"hold": {"independent": 0.5}}, {}, 1.0, {}, None, LinkFigures(0.5, None))
    monkeypatch.setattr(analyze, "command_report", lambda scenario, V: no_commands)
    monkeypatch.setattr(sensitivity_flights, "mismatches_of", lambda scenario: mismatches_of(scenario)[::6])
    ends = iter([False] * 3 + [True] * 10)
    wishes = Controls.wishes
    monkeypatch.setattr(Controls, "wishes", lambda controls: wishes(controls)._replace(ends=next(ends)))


@pytest.mark.family("analyze-tight_imu_uwb")
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("command", COMMANDS)
def test_every_one_ends_with_an_answer_or_with_one_line(
    command: str, scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], bus: str
) -> None:
    code = COMMANDS[command](scenario, tmp_path, bus)
    said = capsys.readouterr().err.strip().splitlines()
    assert code in (0, 2) or (code == DOUBTFUL and command == "scenario check")
    refused = [line for line in said if line.startswith("ortilo: ")]
    assert refused == (said[-1:] if code == 2 else [])
