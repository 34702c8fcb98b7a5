"""Flights behind late commands with an onboard half that accounts for them; the filter takes a minute to compile."""

import json
from typing import Any

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.scenario import Scenario, load_scenario

SHORT = ("camera.kind=projected", "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.2, 1.5]]}")
AWARE = "commands={filter: acted, servo: predicted}"


def scenario_of(*settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*SHORT, "uwb.link.blackouts=[]", "estimator.delay=replay", *settings))


def loss_in(flight: xr.Dataset) -> Any:
    return json.loads(flight.attrs["lost"])


@pytest.mark.long
def test_where_nothing_is_late_it_is_the_flight_without() -> None:
    plain, aware = fly(scenario_of()), fly(scenario_of(AWARE))
    for name in ("truth", "estimate", "control"):
        np.testing.assert_allclose(aware[name], plain[name], rtol=0.0, atol=1e-7)  # a mean over a tick rounds


@pytest.mark.long
@pytest.mark.parametrize(
    "servo", ["predicted", "predicted, delay: 0.13333333333333333", "augmented, delay: 0.13333333333333333"]
)
def test_four_ticks_late_it_flies_where_the_other_is_lost(servo: str) -> None:
    late = "command_link.delay=4"
    assert loss_in(fly(scenario_of(late))) is not None
    aware = fly(scenario_of(late, f"commands={{filter: acted, servo: {servo}}}"))
    assert loss_in(aware) is None
    error = aware["truth"].values[:, :3] - aware["reference"].values[:, :3]
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.08
