"""What a flight's messages hold: flown here or read from its log, and of pictures the boxes found in them."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.interop.ros.ros_messages import SENT
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight, fly_recorded, read_recorded

SHORT = ("settle=0", "planner={kind: waypoints, points: [[0, 0, 1.5], [0.6, 0.2, 1.5]]}")


def same(a: RecordedFlight, b: RecordedFlight) -> None:
    """Hold two records of a flight to each other."""
    assert len(a.messages) == len(b.messages) == a.flight.sizes["tick"]
    for one, other in zip(a.messages, b.messages, strict=True):
        assert sorted(one) == sorted(other)
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name])
    for name in ("truth", "estimate", "control"):
        np.testing.assert_array_equal(a.flight[name], b.flight[name])


@pytest.mark.long
def test_it_is_the_flight_and_its_log(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", (*SHORT, "imu.link.rate=240"), seed=3)
    recorded = fly_recorded(scenario, 3)
    np.testing.assert_array_equal(recorded.flight["estimate"], fly(scenario)["estimate"])
    fly_logged(scenario, tmp_path / "log")
    same(recorded, read_recorded(tmp_path / "log"))
    assert all("imu" in messages for messages in recorded.messages)
    assert "uwb" in recorded.messages[3]


def boxes_make_the_flight(recorded: RecordedFlight) -> None:
    """Fly an onboard half that takes the boxes found, in place of the pictures: it must estimate the same."""
    half = OnboardHalf(recorded.scenario, detects=False)
    for k, messages in enumerate(recorded.messages):
        half.receive({name: value for name, value in messages.items() if name != "shutter"})
        np.testing.assert_array_equal(half.outputs()["estimate"], recorded.flight["estimate"].values[k])
        half.advance()


@pytest.mark.long
@pytest.mark.egl
def test_of_pictures_the_boxes_are_kept_that_the_detector_found(tmp_path: Path) -> None:
    scenario = load_scenario("imu_uwb_yolo", (*SHORT, "uwb.link.blackouts=[]"))
    recorded = fly_recorded(scenario, 0)
    assert sum("detections" in messages for messages in recorded.messages) >= 10
    assert not any("image" in messages for messages in recorded.messages)
    boxes_make_the_flight(recorded)
    fly_logged(scenario.model_copy(update={"seed": 0}), tmp_path / "log")
    same(recorded, read_recorded(tmp_path / "log"))


def test_a_flight_that_diverged_ends_before(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = load_scenario("nominal_imu_uwb", SHORT)
    flight = fly(scenario)

    def diverged(_: Scenario, log: Path | None, also: object = None) -> xr.Dataset:
        its = flight.copy(deep=True)
        for k in range(flight.sizes["tick"]):
            also(k, None, {}, {})  # type: ignore[operator]
        its["estimate"][20:] = np.nan
        return its

    monkeypatch.setattr("ortilo_drake.studies.hindsight.recorded_flight.fly_logged", diverged)
    assert fly_recorded(scenario, 0).flight.sizes["tick"] == 20


def test_logs_that_cannot_be_judged_are_refused(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", SHORT)
    with pytest.raises(InputError, match="no such log"):
        read_recorded(tmp_path / "nothing")
    half = OnboardHalf(scenario)
    with LogWriter(tmp_path / "blind", scenario) as writer:
        for k in range(3):
            writer.write_tick(k, None, {}, half.outputs())
    with pytest.raises(InputError, match=r"blind.*: holds no true states"):
        read_recorded(tmp_path / "blind")
    with LogWriter(tmp_path / "sent", scenario, SENT) as writer:
        writer.write_tick(0, None, {}, half.outputs())
    with pytest.raises(InputError, match=r"sent.*: is the log of a world in real time"):
        read_recorded(tmp_path / "sent")
