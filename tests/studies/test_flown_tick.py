"""The closed form against the diagram that flies, and the report of it all."""

import json

import numpy as np
import pytest

from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import InputError, Scenario, load_scenario
from ortilo_drake.studies.linearization.closed_forms import DIFFERENTIATED, differentiate_closed_loop, without_noise
from ortilo_drake.studies.linearization.linearization_report import linearization_report
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop


@pytest.mark.long
@pytest.mark.parametrize("late", [0, 1])  # UWB is there on every third tick
@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("estimator.integrator=estimate",),
        ("estimator.integrator=literal", "servo.form=paper"),
        ("servo.velocities=truth",),
        ("estimator.V.uwb=[0.05, 0.05, 0.05]", "multilateration.method=nearest_three"),
        ("estimator.force=thrust",),
        ("estimator.force=measured",),
        ("estimator.force=measured", "estimator.integrator=estimate", "servo.velocities=truth"),
        ("estimator.force=thrust", "servo.form=paper"),
        ("world.drag=[0.5, 1.5, 0.2]",),
        ("world.drag=[0.5, 1.5, 0.2]", "estimator.force=measured"),
    ],
    ids=[
        "hold",
        "estimate",
        "literal",
        "truth",
        "constant V",
        "thrust",
        "measured",
        "measured, truth",
        "thrust, paper",
        "drag",
        "drag, measured",
    ],
)
def test_the_matrices_are_those_of_the_diagram_that_flies(settings: tuple[str, ...], late: int) -> None:
    # The literal integrator throws the vehicle in the ticks without a fix: a fix far away has another covariance.
    thrown = "estimator.integrator=literal" in settings
    flown_tick = differentiate_closed_loop(load_scenario("nominal_imu_uwb", settings), late + (300 if thrown else 900))
    np.testing.assert_array_equal(flown_tick.delta[:3], [1.0 - late, 0.0, 1.0])
    assert np.max(np.abs(flown_tick.expected)) > 1.0
    assert np.max(np.abs(flown_tick.K)) > 0.1
    walks = any("force" in setting for setting in settings)  # whose covariance takes minutes to settle
    assert flown_tick.gain_change < (1e-2 if thrown or walks else 1e-10)
    assert flown_tick.largest_difference < (1e-9 if thrown else 1e-12)


@pytest.mark.long
@pytest.mark.parametrize("name", ["imu_uwb", "imu_uwb_yolo", "realistic_flow", "robust_imu_uwb", "robust_imu_uwb_yolo"])
def test_so_they_are_with_torque_and_biases_as_states(name: str) -> None:
    tick = differentiate_closed_loop(load_scenario(name), 300)
    loop = hover_loop(without_noise(load_scenario(name)))
    assert set(loop.names) >= {"n_x", "bias_z_uwb"}
    assert len(tick.A) == len(loop.state_names) == 15 + len(loop.names) + 3
    assert tick.largest_difference < 1e-12


@pytest.mark.family("measured")
@pytest.mark.parametrize("force", ["thrust", "measured"])
def test_the_flown_tick_tells_a_wrong_force(force: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", (f"estimator.force={force}",))
    tick, loop = differentiate_closed_loop(scenario, 300), hover_loop(scenario)
    without = loop.L.copy()
    without[:, loop.names.index("d_y")] = 0.0
    assert np.max(np.abs(closed_loop_matrix(loop._replace(L=without), tick.K, tick.delta) - tick.A)) > 1e-3


@pytest.mark.long
def test_the_flown_tick_tells_a_wrong_model() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    tick = differentiate_closed_loop(scenario, 300)
    there = np.array([1.0, 0.0, 1.0])
    wrong_gain = closed_loop_matrix(hover_loop(scenario), 1.001 * tick.K, there)
    assert np.max(np.abs(wrong_gain - tick.A)) > 1e-5
    wrong_integrator = closed_loop_matrix(hover_loop(scenario)._replace(integrator="estimate"), tick.K, there)
    assert np.max(np.abs(wrong_integrator - tick.A)) > 0.9


def test_a_tick_before_a_period_of_the_sensors_is_refused() -> None:
    with pytest.raises(InputError, match="tick: 2: must be at least 3"):
        differentiate_closed_loop(load_scenario("nominal_imu_uwb"), 2)


@pytest.mark.long
def test_a_report_is_json_and_holds_the_must_shows() -> None:
    report = linearization_report(load_scenario("nominal_imu_uwb"))
    json.dumps(as_data(report), allow_nan=False)
    assert set(report.agreement) == {*DIFFERENTIATED, "rotors_and_plant (up)", "rotors_and_plant (down)"} - {
        "rotors_and_plant"
    }
    for part in ("plant", "sampled_plant", "closed_loop"):
        assert max(report.agreement[part].values()) < 1e-10
    assert set(report.flown) == {"uwb+imu", "imu"}
    assert max(report.flown.values()) < 1e-8
    assert {name: len(z) for name, z in report.eigenvalues.items()} == {
        "plant": 12, "sampled_plant": 12, "servo_loop": 15, "filter": 12, "closed_loop": 27,
    }  # fmt: skip
    radius = {name: max(abs(w) for w in z) for name, z in report.eigenvalues.items()}
    assert radius["plant"] == 0.0
    assert radius["closed_loop"] == pytest.approx(max(radius["servo_loop"], radius["filter"]), abs=1e-9)
    assert report.unobservable_states["uwb"] == ["psi", "psi_dot"]
    assert report.gramians.observability["imu"].condition == np.inf
    assert report.uncontrollable_modes == []


def test_a_report_without_sensors_is_refused() -> None:
    with pytest.raises(InputError, match=r"no measurement sees eigenvalue 1 \(12 times\) in x, y, z, phi"):
        linearization_report(Scenario(sensors=()))
