"""Rare events of flights: the engine's branches, plain counting, what is kept, the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.flight.compiled.engine import Engine
from ortilo_drake.flight.flight import fly
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed
from ortilo_drake.studies.rare.rare_flights import Rare, danger, rare_flights
from ortilo_drake.studies.rare.rare_report import rare_text
from ortilo_drake.studies.rare.splitting import Split

SHORT = ("world.disturbance.force_sd=0.2",)
SCENARIO = load_scenario("nominal_imu_uwb", SHORT)


def test_distances_are_those_of_drakes_flight() -> None:
    engine, flight = Engine(SCENARIO), fly(with_seed(SCENARIO, 5))
    found = engine.distances(np.full((1, engine.ticks), 5))[0][0]
    away = flight["truth"].values[:, :3] - flight["reference"].values[:, :3]
    np.testing.assert_allclose(found[: len(away)], np.linalg.norm(away, axis=1), atol=1e-9)


def test_a_branch_is_the_same_flight_until_it_leaves_and_another_after() -> None:
    engine = Engine(SCENARIO)
    seeds = np.full((2, engine.ticks), 5)
    seeds[1, 100:] = 6
    (one, other), _ = engine.distances(seeds)
    assert np.array_equal(one[:101], other[:101])  # what stands at a tick is of the noise before it
    assert not np.any(one[101:] == other[101:])


@given(
    st.lists(st.tuples(st.floats(0.0, 1e3), st.floats(0.0, 1e3)), min_size=2, max_size=20),
    st.one_of(st.floats(0.01, 100.0), st.just(np.inf)),
)
def test_danger_reaches_the_goal_where_it_happens_alone(pairs: list[tuple[float, float]], goal: float) -> None:
    distances, errors = np.array(pairs).T
    distances[0] = errors[0] = np.inf  # lost
    found = danger(distances, errors, goal)
    assert np.array_equal(found >= goal, distances >= goal)
    larger, below = np.maximum(distances, errors), distances < goal
    order = np.argsort(larger[below], kind="stable")
    assert np.all(np.diff(found[below][order]) >= 0.0)


def test_splitting_agrees_with_counting_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    corridor = 1.5
    found = rare_flights(SCENARIO, corridor, 40, 4, tmp_path, 1, count=200)
    assert found.counted is not None
    assert 0.0 < found.probability < 1.0
    assert found.low < found.counted.high
    assert found.counted.low < found.high
    files = sorted(tmp_path.rglob("*.json"))
    assert len(files) == 5
    before = files[2].stat().st_mtime_ns
    files[0].write_text("{", encoding="utf-8")  # damaged: flown again
    files[1].unlink()
    calls: list[int] = []
    assert rare_flights(SCENARIO, corridor, 40, 4, tmp_path, 2, 200, calls.append) == found
    assert calls[0] == 2
    assert files[2].stat().st_mtime_ns == before


def test_what_is_not_compiled_is_refused_before_anything_is_kept(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"camera\.kind: rendered"):
        rare_flights(load_scenario("imu_uwb_yolo", ("camera.kind=rendered",)), None, 20, 2, tmp_path, 1)
    assert not list(tmp_path.iterdir())


def test_the_command_says_how_often(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, file = tmp_path / "out", tmp_path / "rare.json"
    options = ("--corridor", "0.8", "--paths", "20", "--repetitions", "2", "--count", "20", "--workers", "1")
    assert run("rare", "nominal_imu_uwb", "--set", SHORT[0], *options, "--out", str(out), "--json", str(file)) == 0
    found = json.loads(file.read_text(encoding="utf-8"))
    assert found["corridor"] == 0.8
    assert len(found["repetitions"]) == 2
    assert found["counted"]["flights"] == 20
    printed = capsys.readouterr().out
    assert "strays 0.8 m or more from its reference" in printed
    assert "strays 0.8 m" in (out / "rare.md").read_text(encoding="utf-8")


def test_where_no_repetition_came_to_it_no_interval_is_claimed() -> None:
    text = rare_text(SCENARIO, Rare(None, 0.0, 0.0, 0.0, [Split(0.0, 3, 40)] * 2, 80, None))
    assert "no repetition came to a flight that loses its vehicle" in text
    assert "interval" not in text
