"""What a servo that accounts for late commands bears: closed forms, flights, and the study's report."""

import json
from pathlib import Path

import numpy as np
import pytest
from delay_ways import delay_ways, stable_delays, ways, with_way
from scipy.linalg import block_diag

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.command_link import command_report as module
from ortilo_drake.studies.command_link.command_loop import commanded_loop
from ortilo_drake.studies.command_link.command_report import critical_delay, delay_growth, delayed_matrices

V = block_diag(np.diag([0.015, 0.018, 0.04]) ** 2, np.eye(3), 1e-4 * np.eye(3))
EACH_TICK = np.array([[1.0, 0.0, 1.0]])
TOLD = 2 / 30


def scenario_of(commands: str = "{}", *more: str) -> Scenario:
    return load_scenario("nominal_imu_uwb", ("estimator.delay=replay", f"commands={commands}", *more))


PREDICTED = "{filter: acted, servo: predicted}"


@pytest.mark.long
@pytest.mark.parametrize("d", [1, 2, 4, 7])
def test_a_measured_delay_leaves_the_eigenvalues_and_adds_zeros(d: int) -> None:
    # Servo and filter separate: those of the servo without delay, those of the filter, and a zero for each number of
    # the commands on the way.
    plain = delayed_matrices(commanded_loop(scenario_of(), V, EACH_TICK), 0)[0]
    aware = delayed_matrices(commanded_loop(scenario_of(PREDICTED), V, EACH_TICK, d), d)[0]
    found = np.linalg.eigvals(aware)
    found = found[np.argsort(-np.abs(found))]
    np.testing.assert_allclose(np.poly(found[:27]), np.poly(np.linalg.eigvals(plain)), atol=1e-6)
    assert np.all(np.abs(found[27:]) < 0.05)


@pytest.mark.long
def test_no_delay_that_is_measured_destabilises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST", 8)
    assert critical_delay(scenario_of(PREDICTED), V) is None
    assert stable_delays(scenario_of(PREDICTED), V, longest=8).high is None


def test_as_sent_the_delays_end_at_the_critical_one() -> None:
    found = stable_delays(scenario_of(), V)
    assert found.low == 0.0
    assert found.high == pytest.approx(critical_delay(scenario_of(), V).ticks, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("servo", ["predicted", "augmented"])
def test_told_the_delay_both_ways_are_one(servo: str) -> None:
    told = scenario_of(f"{{filter: acted, servo: {servo}, delay: {TOLD}}}")
    assert delay_growth(told, V, 2, EACH_TICK) == pytest.approx(delay_growth(scenario_of(), V, 0, EACH_TICK), rel=1e-7)
    bounds = stable_delays(told, V)
    assert bounds.low == (0.0 if servo == "predicted" else pytest.approx(0.2, abs=0.1))
    assert 3.5 < bounds.high < 4.0


@pytest.mark.long
def test_the_force_is_countered_ahead_too() -> None:
    aware = scenario_of(PREDICTED, "estimator.force=thrust")
    assert delay_growth(aware, V, 3) < 1.0 < delay_growth(scenario_of("{}", "estimator.force=thrust"), V, 4)


@pytest.mark.long
def test_a_delay_told_with_which_it_is_unstable_is_refused() -> None:
    with pytest.raises(InputError, match="unstable with the assumed delay, 15 ticks"):
        stable_delays(scenario_of("{servo: predicted, delay: 0.5}"), V)


@pytest.mark.long
def test_hovering_does_what_was_predicted(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb")
    found = delay_ways(scenario, TOLD, (0, 2, 5), range(2), tmp_path, duration=20.0)
    assert [report.way for report in found] == list(ways(TOLD))
    lost = {report.way: [case.lost for case in report.cases] for report in found}
    assert lost == {
        "as sent": [0, 0, 2],
        "predicted, measured": [0, 0, 0],
        "predicted, 67 ms": [0, 0, 2],
        "augmented, 67 ms": [2, 0, 2],
    }
    for report in found:
        assert all(case.agrees for case in report.cases)
        for case in report.cases:
            if case.stable:
                assert case.flown_rms == pytest.approx(case.predicted_rms, rel=0.35)
    assert json.loads(json.dumps(as_data(found), allow_nan=False))


def test_each_way_can_be_flown() -> None:
    for settings in ways(0.077).values():
        assert with_way(load_scenario("nominal_imu_uwb"), settings).estimator.delay == "replay"
