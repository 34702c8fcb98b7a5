"""The command `ortilo analyze`: theory without flights, and what it refuses."""

import json
from contextlib import redirect_stderr
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run

import ortilo_drake as od

PARTS = {"plant", "sampled_plant", "closed_loop"}


@pytest.fixture(scope="module")
def analyzed(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str, str]:
    folder = tmp_path_factory.mktemp("analyze")
    file = folder / "new" / "analysis.json"
    with redirect_stderr(StringIO()) as said:
        code = run("analyze", "nominal_imu_uwb", "--flights", "0", "--out", str(folder / "out"), "--json", str(file))
    assert code == 0
    return json.loads(file.read_text()), (folder / "out" / "nominal_imu_uwb.md").read_text(), said.getvalue()


@pytest.mark.long
def test_drake_and_the_closed_forms_agree(analyzed: tuple[dict[str, Any], str, str]) -> None:
    agreement = analyzed[0]["linearization"]["agreement"]
    assert set(agreement) >= PARTS
    assert max(agreement[part][M] for part in PARTS for M in "ABCD") < 1e-10


@pytest.mark.long
def test_every_solver_solves_the_servos_equation(analyzed: tuple[dict[str, Any], str, str]) -> None:
    assert {solver: s["residual"] < 1e-10 for solver, s in analyzed[0]["riccati"]["servo"].items()} == dict.fromkeys(
        ("drake", "scipy", "doubling", "recursion"), True
    )


@pytest.mark.long
def test_a_map_of_one_sensor_has_that_sensors_rates_alone(analyzed: tuple[dict[str, Any], str, str]) -> None:
    arrivals = analyzed[0]["arrivals"]
    assert arrivals["rates_camera"] == [0.0]
    assert arrivals["critical_rate"]["rate"] == 0.0  # every eigenvalue of Phi is 1 (THEORY: A is nilpotent)
    x = [row[0][0] for row in arrivals["upper"]]
    assert x[0] is None  # never a position
    assert np.all(np.diff(x[1:]) < 0.0)  # more arrivals, less error


@pytest.mark.long
def test_the_report_is_readable(analyzed: tuple[dict[str, Any], str, str]) -> None:
    text = analyzed[1]
    for title in ("Linearisation", "Riccati equations", "Margins", "Arrival rates", "Lost and late commands"):
        assert f"## {title}" in text
    assert "| acknowledged, best gain |" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    for above, row in pairwise(rows):
        if set(row) <= set("|- "):
            assert above.count("|") == row.count("|")


@pytest.mark.long
def test_the_report_begins_with_what_it_found(analyzed: tuple[dict[str, Any], str, str]) -> None:
    data, text, _ = analyzed
    short = text.partition("## In short")[2].partition("## ")[0]
    lines = [line for line in short.splitlines() if line]
    assert 2 < len(lines) <= 5
    assert all(line.startswith("- ") and line.endswith(".") for line in lines)
    torque = data["margins"]["nominal"]["channels"]["tau_y"]
    assert f"{torque['gain_down']:.2f} to {torque['gain_up']:.2f}" in lines[1]
    assert f"{1e3 * torque['delay']:.0f} ms" in lines[1]
    commands = data["commands"]
    assert f"{commands['largest_loss']['hold']['independent']:.0%} may be lost" in lines[2]


@pytest.mark.long
def test_each_part_says_on_stderr_that_it_begins(analyzed: tuple[dict[str, Any], str, str]) -> None:
    parts = ("linearization", "riccati", "margins", "arrivals", "commands")
    assert analyzed[2].splitlines() == [f"{part} ..." for part in parts]


@pytest.mark.parametrize(
    ("sensors", "named"),
    [("[]", "x, y, z"), ("[imu]", "x, y, z, x_dot, y_dot, z_dot"), ("[uwb]", "psi, psi_dot")],
    ids=["none", "imu", "uwb"],
)
def test_modes_that_no_sensor_sees_are_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, sensors: str, named: str
) -> None:
    code = run("analyze", "nominal_imu_uwb", "--set", f"sensors={sensors}", "--out", str(tmp_path / "out"))
    assert code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "eigenvalue 1" in lines[0]
    assert named in lines[0]
    assert list(tmp_path.iterdir()) == []


def test_flights_must_be_a_number_of_flights() -> None:
    assert run("analyze", "--flights", "-1") == 2


@pytest.mark.long
def test_without_linear_theory_flights_are_judged_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("analyze", "tight_imu_uwb", "--out", str(tmp_path / "out"), "--workers", "1")
    assert run(*words, "--flights", "0") == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("ortilo: estimator.kind: tight: must be intermittent")
    short = ("--set", "planner={kind: hover, duration: 1.0}", "--set", "settle=0.0", "--json", str(tmp_path / "a.json"))
    assert run(*words, *short, "--flights", "1") == 0
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["no_theory"].startswith("estimator.kind: tight")
    assert set(found) == {"scenario", "no_theory", "flights", "honesty", "no_tube"}
    (flight,) = od.fly_many("tight_imu_uwb", [0], [word for word in short if "=" in word])
    position = found["honesty"]["nees"]["position"]["all"]["mean"]
    assert position == pytest.approx(flight.summary()["nees"], rel=1e-9)
