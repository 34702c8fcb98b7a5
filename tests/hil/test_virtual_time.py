"""A flight behind a relay in virtual time, against the flight without one and against what the faults must do."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.hil.relay.relay import Faults
from ortilo_drake.hil.relay.virtual_time import fly_in_virtual_time, summary_in_virtual_time
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, with_seed

SHORT = ("camera.kind=projected", "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.2, 1.5]]}")
BAD = Faults(loss=0.2, delay=0.04, spread=0.02, duplicate=0.1)


def scenario_of(*settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*SHORT, "uwb.link.blackouts=[]", *settings))


@pytest.mark.long
def test_without_faults_it_is_the_flight_but_for_the_commands_millisecond() -> None:
    # A command acts a millisecond after its tick here, and at its tick in `fly`.
    plain = fly(scenario_of("world.plant=continuous"))
    flight = fly_in_virtual_time(scenario_of())
    assert flight.sizes == plain.sizes
    np.testing.assert_array_equal(flight["arrival"], plain["arrival"])
    np.testing.assert_allclose(flight["truth"][:, :3], plain["truth"][:, :3], atol=0.02)


@pytest.mark.long
@pytest.mark.parametrize("settings", [(), ("estimator.delay=replay", "commands={filter: acted, servo: predicted}")])
def test_a_seed_flies_the_same_bits_and_another_others(settings: tuple[str, ...]) -> None:
    one, two, other = (fly_in_virtual_time(scenario_of(*settings), BAD, BAD, seed) for seed in (1, 1, 2))
    xr.testing.assert_identical(one, two)
    assert not one["truth"].equals(other["truth"])


@pytest.mark.long
def test_packets_are_lost_and_late_and_replay_uses_what_is_late() -> None:
    found = {}
    for mode in ("ignore", "drop", "replay"):
        flight = fly_in_virtual_time(scenario_of(f"estimator.delay={mode}"), BAD)
        assert np.isfinite(flight["estimate"].values).all(axis=1).mean() > 0.98  # all but what it had not joined for
        found[mode] = summary(flight)
    assert 0.6 < found["replay"].arrivals["camera"] < 0.95  # a fifth of the packets is lost
    assert found["drop"].arrivals["camera"] < found["replay"].arrivals["camera"]


@pytest.mark.long
def test_what_comes_twice_is_taken_once() -> None:
    twice = Faults(duplicate=1.0, spread=0.05)  # the second copy up to a tick and a half behind the first
    once = fly_in_virtual_time(scenario_of())
    xr.testing.assert_identical(fly_in_virtual_time(scenario_of(), Faults(duplicate=1.0), Faults(duplicate=1.0)), once)
    flight = fly_in_virtual_time(scenario_of("estimator.delay=replay"), twice)
    due, used = flight["due"].sel(sensor="camera"), flight["arrival"].sel(sensor="camera")
    assert int(used.sum()) <= int(due.sum())


def test_pictures_are_refused() -> None:
    with pytest.raises(InputError, match="camera"):
        fly_in_virtual_time(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=rendered",)))


@pytest.mark.long
def test_a_flight_that_is_there_already_is_not_flown_again(tmp_path: Path) -> None:
    file, ways = tmp_path / "3.json", (BAD.model_dump_json(), Faults().model_dump_json())
    found = summary_in_virtual_time(scenario_of().model_dump_json(), *ways, 3, str(file))
    assert found.seed == 3
    assert found.mse == summary(fly_in_virtual_time(with_seed(scenario_of(), 3), BAD, seed=4)).mse
    again = summary_in_virtual_time("no scenario", *ways, 3, str(file))
    assert (again.seed, again.mse, again.nees) == (found.seed, found.mse, found.nees)
