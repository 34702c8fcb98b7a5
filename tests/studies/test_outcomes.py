"""Outcomes of flights: the figures of their summaries, whatever the number of workers, flown once."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.figures import NEES
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.scenario import Scenario, load_scenario, with_seed
from ortilo_drake.studies.maps.chunks import drake_figures, trace_of
from ortilo_drake.studies.sensitivity.sensitivity_flights import Outcome, fly_outcomes, outcome

HOVER = ("planner={kind: hover, point: [9.0, 0.5, 1.5], duration: 1.0}", "settle=0.0")
CALM = load_scenario("nominal_imu_uwb", HOVER)
HEAVY = load_scenario("nominal_imu_uwb", (*HOVER, "truth.vehicle.mass_factor=1.1"))


def outcome_of(flight: xr.Dataset) -> Outcome:
    return outcome(int(flight.attrs["seed"]), drake_figures(flight))


def test_an_outcome_is_part_of_the_summary() -> None:
    flight = fly(CALM)
    found, whole = outcome_of(flight), summary(flight)
    assert (found.seed, found.lost) == (whole.seed, False)
    assert found.mse == pytest.approx(whole.mse, rel=1e-12)
    assert found.nees == pytest.approx(whole.nees, rel=1e-12)


@pytest.mark.family
@pytest.mark.parametrize("scenario", [CALM, HEAVY], ids=["calm", "heavy"])
def test_the_engines_outcomes_are_drakes(scenario: Scenario, tmp_path: Path) -> None:
    ((found,),) = fly_outcomes([(scenario, [2])], tmp_path)
    expected = outcome_of(fly(with_seed(scenario, 2)))
    assert (found.seed, found.lost) == (expected.seed, expected.lost)
    assert found.mse == pytest.approx(expected.mse, rel=1e-9)
    assert found.nees == pytest.approx(expected.nees, rel=1e-9)


def test_a_flight_that_diverged_is_lost_and_its_errors_end_before() -> None:
    flight = fly(CALM)
    spoilt = flight.assign(truth=flight["truth"].where(flight["time"] < 0.5))
    spoilt.attrs["lost"] = '{"time": 0.5, "cause": "diverged"}'
    found = outcome_of(spoilt)
    until = flight["time"].values < 0.5
    error = (flight["estimate"].values[:, :3] - flight["truth"].values[:, :3])[until]
    assert found.lost
    np.testing.assert_allclose(list(found.mse.values()), np.mean(error**2, axis=0), rtol=1e-12)


@pytest.mark.long
def test_they_are_the_same_on_two_workers_and_flown_once(tmp_path: Path) -> None:
    came: list[int] = []
    alone = fly_outcomes([(CALM, range(3)), (HEAVY, range(2, 4))], tmp_path / "one")
    assert [[flown.seed for flown in row] for row in alone] == [[0, 1, 2], [2, 3]]
    assert alone[0][2].mse["z"] < alone[1][0].mse["z"]  # of seed 2: 1 m/s^2 that the filter does not know of
    assert fly_outcomes([(CALM, range(3)), (HEAVY, range(2, 4))], tmp_path / "two", workers=2) == alone
    files = {file.name: file.read_text() for file in (tmp_path / "one").iterdir()}
    assert files == {file.name: file.read_text() for file in (tmp_path / "two").iterdir()}
    more = fly_outcomes([(CALM, range(4))], tmp_path / "one", progress=came.append)
    assert more[0][:3] == alone[0]
    assert came == [3, 1]


def test_a_damaged_file_is_flown_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (before,) = fly_outcomes([(CALM, [1])], tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_text()
    file.write_text(whole[:-20])
    assert fly_outcomes([(CALM, [1])], tmp_path) == [before]
    assert "flown again" in caplog.text
    assert file.read_text() == whole


def test_a_tick_whose_covariance_is_singular_does_not_end_the_study() -> None:
    """A flight of Drake's whose P lost its rank raised LinAlgError; the engine's NEES of such a tick is not known."""
    flight = fly(CALM)
    spoilt = flight.assign(covariance=flight["covariance"].where(flight["time"] < 0.5, 0.0))
    assert np.isnan(trace_of(spoilt)[-1, NEES])
    found = outcome_of(spoilt)
    assert not found.lost
    assert found.mse == outcome_of(flight).mse
