"""A rare event with and without faults: the ratio's interval, which faults are flown, the command."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import run
from gauss_markov import TICKS, answer, goal_of, highest
from scipy.stats import binom
from scipy.stats.contingency import relative_risk

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.rare.estimate import counted_of
from ortilo_drake.studies.rare.rare_flights import Event
from ortilo_drake.studies.rare.subset import climb, plan_climb
from ortilo_drake.studies.rare.under_faults import faults_of, faults_verdict, times_as_often

GUST = "{kind: gust, start: 5.0, end: 10.0, force: [0.0, 2.0, 0.0]}"


def counted(events: int, flights: int) -> Any:
    it = counted_of(flights, events)
    return SimpleNamespace(probability=events / flights or None, low=it.low, high=it.high, independent=it)


@pytest.mark.parametrize(("events", "without"), [(400, 100), (5000, 200), (150, 150)])
def test_of_many_events_the_ratio_has_the_interval_of_a_relative_risk(events: int, without: int) -> None:
    """Of Katz's, which SciPy has, Wilson's ends differ little where events are many."""
    found = times_as_often(counted(events, 10_000), counted(without, 10_000))
    risk = relative_risk(events, 10_000, without, 10_000)
    ends = risk.confidence_interval(0.95)
    assert found.times == pytest.approx(risk.relative_risk)
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=0.02)


def test_of_what_never_happened_the_ratio_has_a_bound() -> None:
    seen, never = counted(20, 100), counted(0, 400)
    more, less, unknown = times_as_often(seen, never), times_as_often(never, seen), times_as_often(never, never)
    assert (more.times, more.high) == (None, None)
    assert more.low == pytest.approx(seen.low / never.high)
    assert (less.times, less.low) == (None, 0.0)
    assert less.high == pytest.approx(never.high / seen.low)
    assert (unknown.times, unknown.low, unknown.high) == (None, 0.0, None)


def test_of_a_wide_ratio_only_its_known_end_is_told() -> None:
    event = Event(0.15)
    rare: Any = SimpleNamespace(event=event, probability=1.7e-7, low=4.5e-10, high=6.2e-5)
    often: Any = SimpleNamespace(event=event, probability=0.39, low=0.34, high=0.45)
    rare.independent = often.independent = counted_of(400, 0)
    line, own = faults_verdict(load_scenario("imu_uwb"), rare, {"gust": often}), "imu_uwb: fewer than one flight in "
    assert line.startswith(own + "16,000 strays 0.15 m or more from its reference (95 %); with gust 39% of flights, at")
    assert line.endswith(" times as often; more --paths and --repetitions are needed to say more")
    assert line.split("at least ")[1].startswith("6,300 ")
    same = faults_verdict(load_scenario("imu_uwb"), rare, {"gust": rare})
    assert "with gust fewer than one flight in 16,000 (95 %), how much more often is not known; more" in same


def studied(probability: float, seed: int, repetitions: int) -> Any:
    """A study of the Gauss-Markov process by 100 paths."""
    goal = goal_of(probability)
    plan = plan_climb(highest, TICKS, goal, 100, seed)
    found = [climb(highest, TICKS, goal, plan, 100, seed, i) for i in range(repetitions if plan.reached else 0)]
    it = answer(plan, found, 100)
    met = plan.met + sum(one.met for one in found)
    count = counted_of(100 * (1 + len(found)), met)
    return SimpleNamespace(probability=it.probability, low=it.low, high=it.high, independent=count)


@pytest.mark.long
@pytest.mark.parametrize("apart", [0, 1000], ids=["same noise", "noise of their own"])
@pytest.mark.parametrize(("probability", "without"), [(0.3, 1e-2), (2e-2, 1e-3)])
def test_the_ratio_is_in_its_interval_as_often_as_it_says(probability: float, without: float, apart: int) -> None:
    """100 intervals; were they to hold it in 0.93, one in a thousand such counts would be below."""
    held = 0
    for seed in range(100):
        found = times_as_often(studied(probability, seed, 3), studied(without, seed + apart, 3))
        held += found.low <= probability / without <= (np.inf if found.high is None else found.high)
    assert held >= binom.ppf(1e-3 / 4, 100, 0.93)


def test_faults_are_given_in_yaml_by_name_and_as_the_scenarios_own() -> None:
    own = load_scenario("imu_uwb", (("faults", [{"kind": "clock_jump", "start": 3.0, "by": 0.5}]),))
    found = faults_of([GUST, "uwb_stuck", "own"], own)
    assert list(found) == ["gust", "uwb_stuck", "own faults"]
    assert found["gust"][0]["force"] == [0.0, 2.0, 0.0]
    assert (found["uwb_stuck"][0]["sensor"], found["uwb_stuck"][0]["start"]) == ("uwb", 22.0)
    assert found["own faults"][0]["by"] == 0.5
    other = GUST.replace("2.0", "1.0")
    assert list(faults_of([GUST, other], own)) == [GUST, other]
    assert list(faults_of(["own", "{kind: clock_jump, start: 1.0, by: 0.1}"], own)) == ["own faults", "clock_jump"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gast", "must be a fault such as .*gust"),
        ("own", "has no faults of its own"),
        ("{start: 5.0}", "must be a fault such as"),
        ("camera_stuck", "concerns a sensor that imu_uwb does not fly"),
        ("{kind: gust", "--fault"),
    ],
)
def test_what_is_no_fault_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        faults_of([text], load_scenario("imu_uwb"))


@pytest.mark.long
def test_the_command_sets_flights_with_and_without_a_fault_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hover = ("nominal_imu_uwb", "--set", "planner={kind: hover, duration: 0.3}", "--workers", "1", "--paths", "20")
    file, fault = tmp_path / "rare.json", "{kind: gust, start: 0.05, force: [0.0, 9.0, 0.0]}"
    options = ("--repetitions", "2", "--corridor", "0.04", "--out", str(tmp_path), "--json", str(file))
    assert run("rare", *hover, *options, "--fault", fault) == 0
    said, found = capsys.readouterr().out, json.loads(file.read_text(encoding="utf-8"))
    (row,) = found["under_faults"]
    assert (row["fault"], found["event"]["corridor"]) == ("gust", 0.04)
    assert row["probability"] > 0.9
    ratio, low, high = (row["times_as_often"][key] for key in ("times", "low", "high"))
    assert ratio == pytest.approx(row["probability"] / found["probability"])
    assert f"{ratio:.2g} times as often ({low:.2g} to {high:.2g}" in said.splitlines()[0]
    assert "| gust | 1" in said
    assert "## no fault" in said
    assert run("report", str(tmp_path)) == run("report", str(file)) == 0
    assert run("rare", *hover, *options, "--fault", "gust") == 2
    assert (
        "begins at 22 s, must be before the flight's end at 2.3 s (its plan and 2 s to settle)"
        in capsys.readouterr().err
    )
    assert run("rare", *hover, *options, "--fault", "{kind: stuck, sensor: camera, start: 0.1}") == 2
    assert "--fault stuck: nominal_imu_uwb: faults.0: stuck: concerns camera" in capsys.readouterr().err
