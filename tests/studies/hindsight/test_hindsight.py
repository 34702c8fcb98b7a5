"""The study and its command: rows, why one is not there, scenarios and logs."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.hindsight import hindsight as study
from ortilo_drake.studies.hindsight.hindsight import FlightInHindsight, Judged, hindsight_text, judged, study_of

SHORT = ("settle=0", "planner={kind: waypoints, points: [[0, 0, 1.5], [0.6, 0.2, 1.5]]}")
SET = [word for setting in SHORT for word in ("--set", setting)]


@pytest.fixture
def no_gtsam(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where GTSAM is not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *of: None if name == "gtsam" else find(name, *of))


def test_errors_are_judged_by_their_covariance() -> None:
    """Ellipses of one standard deviation: a squared error of 1 in each direction."""
    root = np.array([[0.1, 0.0, 0.0], [0.05, 0.2, 0.0], [0.0, 0.1, 0.3]])
    x = np.array([root[:, i] for i in range(3)])
    its = judged(x, np.tile(root @ root.T, (3, 1, 1)), np.zeros((3, 3)))
    assert its.nees == pytest.approx(1.0)
    assert its.mse == pytest.approx(tuple(np.mean(root**2, axis=1)))


def test_rows_are_over_all_flights() -> None:
    def flight(seed: int, lost: float | None, *mse: float) -> FlightInHindsight:
        ways = {way: Judged((its, 0.0, 0.0), 3.0 * its) for way, its in zip(("flown", "rts"), mse, strict=True)}
        return FlightInHindsight(seed, lost, ways | {"floor": Judged((mse[0] / 2.0, 0.0, 0.0), None)})

    found = study_of(load_scenario("nominal_imu_uwb"), [flight(0, None, 9.0, 1.0), flight(1, 7.5, 7.0, 0.0)])
    assert found.lost == 1
    assert [(row.way, row.rms[0]) for row in found.rows] == [
        ("flown", pytest.approx(8.0**0.5)),
        ("rts", pytest.approx(0.5**0.5)),
        ("floor", pytest.approx(2.0)),
    ]
    assert [row.nees for row in found.rows] == [24.0, 1.5, None]
    text = hindsight_text(found)
    assert "2 flights (seeds 0, 1), 1 of them lost." in text
    assert "| RTS, in hindsight | 707.1 | 0.0 | 0.0 | 707.1 | 0.25 | 1.50 |" in text


@pytest.mark.usefixtures("no_gtsam")
def test_without_the_extra_it_says_what_to_install(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert (
        run("hindsight", "nominal_imu_uwb", "--flights", "2", "--workers", "1", "--json", str(tmp_path / "h"), *SET)
        == 0
    )
    said = " ".join(capsys.readouterr().out.split())
    assert "pip install 'ortilo-drake[smoother]'" in said
    assert "graph, in hindsight" not in said
    found = json.loads((tmp_path / "h").read_text())
    assert [row["way"] for row in found["rows"]] == ["flown", "rts", "floor"]
    assert [flight["seed"] for flight in found["flights"]] == [0, 1]
    assert len(found["missing"]) == 1


@pytest.mark.family("imu_uwb-runs again where a measurement comes late")
@pytest.mark.usefixtures("no_gtsam")
@pytest.mark.parametrize(
    ("name", "why"),
    [("tight_imu_uwb", "is not linear"), ("imu_uwb", "runs again where a measurement comes late")],
)
def test_why_there_is_no_smoother_of_a_filter(name: str, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    late = ["--set", "estimator.delay=replay"] if name == "imu_uwb" else []
    assert run("hindsight", name, "--flights", "1", *late, *SET) == 0
    assert f"No row: RTS: the filter that flew {why}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.long
def test_tight_stands_beside_the_graph() -> None:
    pytest.importorskip("gtsam", reason="needs the extra 'smoother'")
    found = study.fly_in_hindsight(load_scenario("tight_imu_uwb", SHORT), [0, 1])
    assert [row.way for row in found.rows] == ["flown", "graph", "floor"]
    assert found.estimator == "tight"
    assert "| tight, as it flew |" in hindsight_text(found)


@pytest.mark.long
@pytest.mark.usefixtures("no_gtsam")
def test_a_log_gives_what_its_flight_gives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = load_scenario("nominal_imu_uwb", SHORT, seed=0)
    fly_logged(scenario, tmp_path / "log")
    for flown in (str(tmp_path / "log"), str(tmp_path / "log" / "log.mcap")):
        assert run("hindsight", flown) == 0
        assert "1 flight (seed 0)." in (of_log := capsys.readouterr().out)
    assert run("hindsight", "nominal_imu_uwb", "--flights", "1", *SET) == 0
    assert capsys.readouterr().out == of_log


def test_bad_input_ends_with_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("hindsight", str(tmp_path), "--flights", "2") == 2
    assert "is a log: --flights" in capsys.readouterr().err
    assert run("hindsight", str(tmp_path)) == 2
    assert "not a log: holds 0 .mcap files" in capsys.readouterr().err
    assert run("hindsight", "nothing_of_this_name") == 2
    assert "nothing_of_this_name" in capsys.readouterr().err
