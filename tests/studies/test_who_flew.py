"""Every study that flies says who flew, and finds the same whoever did."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import run

import ortilo_drake as od
from ortilo_drake.flight.players import flown_by
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.command_link.command_flights import command_cases, command_flights
from ortilo_drake.studies.faults.fault_flights import fault_study
from ortilo_drake.studies.faults.fault_report import fault_text
from ortilo_drake.studies.report.analyze import honesty_section
from ortilo_drake.studies.sensitivity import sensitivity_flights
from ortilo_drake.studies.sensitivity.mismatches import known_mismatches
from ortilo_drake.studies.sensitivity.sensitivity_flights import sensitivity
from ortilo_drake.studies.sensitivity.sensitivity_report import sensitivity_text
from ortilo_drake.studies.tube.tube_flights import fly_point
from ortilo_drake.studies.tuning.search import Search, search_by_flights, search_lines

HOVER = {"planner": {"kind": "hover", "point": [9.0, 0.5, 1.5], "duration": 0.5}, "settle": 0.0}
SWEEP = {"scenario": "nominal_imu_uwb", "settings": HOVER, "axes": {"uwb.link.loss": [0.0, 0.5]}, "flights": 2}
AXES = {"servo.weights.position": {"start": 0.5, "stop": 2.0}, "servo.weights.velocity": {"start": 0.5, "stop": 2.0}}
SEARCH = {"scenario": "nominal_imu_uwb", "settings": HOVER, "axes": AXES, "flights": 2, "judge": 2, "evaluations": 1}
WHY = "camera.kind: rendered: has no compiled form"


def vary(settings: Any) -> Scenario:
    return load_scenario("nominal_imu_uwb", (*HOVER.items(), *settings))


def vary_long(settings: Any) -> Scenario:
    return load_scenario("nominal_imu_uwb", (*(HOVER | {"settle": 12.0}).items(), *settings))


def of_map(player: str, out: Path) -> tuple[Any, str, str]:
    found = od.map(SWEEP, out=out, player=player)
    return found.data["rows"], found.data["flown_by"], found.text


def of_search(player: str, out: Path) -> tuple[Any, str, str]:
    found = search_by_flights(Search.model_validate(SEARCH), "search", out, 1, player=player)
    return replace(found, flown_by=""), found.flown_by, "\n".join(search_lines(found)).replace("flown by", "Flown by")


def of_sensitivity(player: str, out: Path) -> tuple[Any, str, str]:
    found = sensitivity(vary, 2, out, player=player)
    return replace(found, flown_by=""), found.flown_by, sensitivity_text(found)


def of_faults(player: str, out: Path) -> tuple[Any, str, str]:
    found = fault_study([vary_long], ["gust"], 2, out, 1.0, 0.5, player=player)
    return replace(found, flown_by=""), found.flown_by, fault_text(found)


STUDIES = {"map": of_map, "tune --fly": of_search, "sensitivity": of_sensitivity, "faults": of_faults}


@pytest.mark.long
@pytest.mark.parametrize("study", STUDIES.values(), ids=STUDIES)
def test_a_study_says_who_flew_and_finds_the_same_by_any_player(
    study: Callable[[str, Path], tuple[Any, str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensitivity_flights, "_without", lambda *_: None)  # no search: its flights take minutes
    monkeypatch.setattr(sensitivity_flights, "mismatches_of", lambda _: known_mismatches()[:1])
    (figures, by, text), by_drake = (study(player, tmp_path / player) for player in ("engine", "drake"))
    assert (by, by_drake[1]) == ("engine", "drake")
    assert "Flown by engine" in text
    assert text.replace("Flown by engine", "Flown by drake") == by_drake[2]
    assert repr(figures) == repr(by_drake[0])  # not ==: a NaN differs from itself
    assert study("engine", tmp_path / "drake") == by_drake  # kept flights stay, and keep their player


@pytest.mark.long
def test_each_part_of_an_analysis_says_who_flew(tmp_path: Path) -> None:
    scenario, links = vary(()), command_cases((0.3,), ("hold",), ())
    found: dict[str, Any] = {}
    for player in ("engine", "drake"):
        out = tmp_path / player
        honest, _ = honesty_section(scenario, 2, out, 1, lambda *_: None, player)
        flown = command_flights(scenario, links, range(1), out, duration=0.5, player=player)
        points = fly_point(scenario, [4], out, player=player)
        assert (honest.flown_by, flown.flown_by, points[0].player) == (player, player, player)
        found[player] = (honest.nees, flown.cases, points[0].deviation.tolist())
    assert repr(found["engine"]) == repr(found["drake"])


def test_drake_is_named_with_the_reason_where_the_engine_cannot_fly() -> None:
    rendered = load_scenario("nominal_imu_uwb_yolo", tuple(HOVER.items()))
    assert flown_by([vary(())], ["engine", "engine"]) == "engine"
    assert flown_by([vary(()), rendered], ["engine", "drake"]) == f"drake ({WHY}), engine"
    assert flown_by([vary(())], []) == ""
    with pytest.raises(InputError, match=f"^player: engine: nominal_imu_uwb_yolo: {WHY}"):
        od.map(SWEEP | {"scenario": "nominal_imu_uwb_yolo"}, player="engine")


@pytest.mark.parametrize("player", ["drake", "drake-elements"])
def test_rare_flies_by_the_engine_alone(player: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("rare", "nominal_imu_uwb", "--player", player) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line == f"ortilo: --player: {player}: must be fastest or engine, the only player that takes given noise"


def test_fitting_without_a_flight_takes_no_player(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("tune", "flight.nc", "--player", "drake") == 2
    assert "--player: drake: needs --fly or --check" in capsys.readouterr().err


@pytest.mark.long
def test_the_commands_take_a_player_and_name_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(json.dumps(SWEEP))
    file, hover = tmp_path / "found.json", [f"--set={key}={json.dumps(value)}" for key, value in HOVER.items()]
    for words in (("map", str(sweep)), ("rare", "nominal_imu_uwb", *hover, "--paths", "20", "--repetitions", "2")):
        by = "engine" if words[0] == "rare" else "drake"
        assert run(*words, "--workers", "1", "--player", by, "--out", str(tmp_path / by), "--json", str(file)) == 0
        assert json.loads(file.read_text())["flown_by"] == by
        assert f"Flown by {by}.\n" in capsys.readouterr().out
