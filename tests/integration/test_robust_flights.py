"""Flights with the robust form of the paper's filter: the plain ones where all is right, and through faults."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [4, 1.5, 1.5], [5, 1.5, 1.5]]}"
OPEN = "uwb.link.blackouts=[]"
PROJECTED = "camera.kind=projected"
ALL_USED = (
    "estimator.robust={gate: 0.999999999999, weight: {kind: huber, c: 100.0}, adaptation: {tolerates: 100.0}, "
    "drift: 30.0}"
)


@pytest.mark.long
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "imu_uwb", "imu_uwb_yolo"])
def test_where_nothing_is_refused_it_is_the_plain_flight_bit_for_bit(name: str) -> None:
    learns_nothing = ("multilateration={bias_bank: null, noise_scale: null}", "landmark_fix.survey_bank=null")
    settings = (SHORT, PROJECTED, *learns_nothing)
    exclude = "multilateration.exclude={probability: 0.999999999999}"
    plain, robust = fly(load_scenario(name, settings)), fly(load_scenario(name, (*settings, exclude, ALL_USED)))
    for variable in plain.data_vars:
        np.testing.assert_array_equal(robust[variable].values, plain[variable].values, err_msg=str(variable))


def error_of(flight: xr.Dataset, start: float = 6.0) -> float:
    """Return the root mean square of the estimated position's distance from the true one from then on [m]."""
    assert loss_of(flight) is None
    e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    return float(np.sqrt(np.mean(np.sum(e[flight["time"].values >= start] ** 2, axis=1))))


def flown(name: str, fault: dict[str, Any] | None) -> xr.Dataset:
    settings = (SHORT, PROJECTED, OPEN, ("faults", [] if fault is None else [fault]))
    return fly(load_scenario(name, settings, 1))


@cache
def calm_error() -> float:
    return error_of(flown("robust_imu_uwb_yolo", None))


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "plain_fails"),
    [
        ({"kind": "stuck", "sensor": "uwb", "start": 6.0, "end": 10.0}, True),
        ({"kind": "stuck", "sensor": "imu", "start": 6.0, "end": 10.0}, True),
        ({"kind": "nlos_storm", "start": 6.0, "end": 10.0}, False),  # the default filter learns the noise
        ({"kind": "clock_jump", "start": 6.0}, True),
        ({"kind": "gyro_bias", "start": 6.0}, True),
        ({"kind": "yaw_jump", "start": 6.0, "end": 10.0}, False),
    ],
    ids=lambda value: value["kind"] + value.get("sensor", "") if isinstance(value, dict) else "",
)
def test_a_fault_costs_little(fault: dict[str, Any], plain_fails: bool) -> None:
    calm = calm_error()
    assert error_of(flown("robust_imu_uwb_yolo", fault)) < 4.0 * calm
    if plain_fails:
        plain = flown("imu_uwb_yolo", fault)
        assert loss_of(plain) is not None or error_of(plain) > 3.0 * calm


@pytest.mark.long
def test_without_a_camera_ranges_are_still_judged() -> None:
    for fault in ({"kind": "outlier_bursts", "start": 6.0, "end": 10.0}, {"kind": "clock_jump", "start": 6.0}):
        calm = error_of(flown("robust_imu_uwb", None))
        assert error_of(flown("robust_imu_uwb", fault)) < 2.0 * calm


@pytest.mark.long
def test_an_estimate_that_has_gone_astray_is_found_again() -> None:
    """Nothing but ranges that are all off is heard for a while; then right values are far from the estimate."""
    jump = {"kind": "clock_jump", "start": 3.0, "end": 5.5, "by": -0.6}
    blind = {"kind": "camera_blinded", "start": 2.0, "end": 6.0}
    settings = (SHORT, PROJECTED, OPEN, "multilateration.exclude=null", ("faults", [jump, blind]))
    flight = fly(load_scenario("robust_imu_uwb_yolo", settings, 2))
    assert loss_of(flight) is None
    e = np.linalg.norm(flight["estimate"].values[:, :3] - flight["truth"].values[:, :3], axis=1)
    t = flight["time"].values
    assert e[(t > 5.5) & (t < 6.0)].mean() > 0.5
    assert e[t > 7.5].mean() < 0.05


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("estimator.robust.gate=1.0", r"estimator\.robust\.gate: 1\.0: .*below 1"),
        ("estimator.robust.stuck=1", r"estimator\.robust\.stuck: 1: "),
        ("estimator.robust.weight={kind: tukey}", r"estimator\.robust\.weight"),
        ("estimator.robust.weight={kind: huber, dof: 3.0}", r"estimator\.robust\.weight\.(huber\.)?dof"),
        ("estimator.robust.reacquire_after=0.0", r"estimator\.robust\.reacquire_after: 0"),
        ("estimator.robust.adaptation.most=0.5", r"estimator\.robust\.adaptation\.most: 0\.5"),
        ("estimator.robust.opening.angle=-0.1", r"estimator\.robust\.opening\.angle: -0\.1"),
        ("estimator.robust.gates=0.9", r"estimator\.robust\.gates"),
    ],
)
def test_wrong_settings_are_refused(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scenario("imu_uwb", (setting,))
