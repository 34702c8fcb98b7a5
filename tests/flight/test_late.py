"""Messages that come too late: not counted as used, and told before the flight."""

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.late import late_messages
from ortilo_drake.flight.metrics import arrival_rates
from ortilo_drake.scenario import load_scenario, scenario_names

HOVER = ("planner={kind: hover, duration: 1.5}", "settle=0", "uwb.link.blackouts=[]")


def flown(name: str, *settings: str) -> xr.Dataset:
    return fly(load_scenario(name, (*HOVER, *settings)))


@pytest.mark.family("imu_uwb-settings2")
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("tight_imu_uwb", ("uwb.link.delay=4", "estimator.horizon=0.1")),
        ("imu_uwb", ("uwb.link.delay=6", "estimator.delay=replay", "estimator.horizon=0.1")),
        ("imu_uwb", ("uwb.link.delay=2", "estimator.delay=drop")),
    ],
)
def test_of_ranges_beyond_the_horizon_none_is_used(name: str, settings: tuple[str, ...]) -> None:
    """Such a flight is that of an estimator that hears no range at all, and says so: it said 70 % once."""
    late, deaf = flown(name, *settings), flown(name, "uwb.link.loss=1.0", *settings[1:])
    np.testing.assert_array_equal(late["estimate"].values, deaf["estimate"].values)
    assert arrival_rates(late)["uwb"] == arrival_rates(deaf)["uwb"] == 0.0
    lines = late_messages(load_scenario(name, settings))
    assert len(lines) == 1
    assert lines[0].startswith("uwb.link.delay: ")
    assert "not one message is used" in lines[0]


@pytest.mark.long
@pytest.mark.parametrize(("name", "delay"), [("tight_imu_uwb", ()), ("imu_uwb", ("estimator.delay=replay",))])
def test_ranges_within_the_horizon_are_used(name: str, delay: tuple[str, ...]) -> None:
    settings = ("uwb.link.delay=4", "estimator.horizon=0.134", *delay)
    n = 45 // 3 + 1
    assert arrival_rates(flown(name, *settings))["uwb"] == (n - 2) / n  # the last two are on their way at the end
    assert late_messages(load_scenario(name, settings)) == []


def test_the_share_that_comes_too_late_is_that_of_the_delays_drawn() -> None:
    """Delays are uniform over 0 to 4 ticks, and one of the five is more than 3 ticks."""
    lines = late_messages(load_scenario("tight_imu_uwb", ("uwb.link.random_delay=4", "estimator.horizon=0.1")))
    assert len(lines) == 1
    assert "20% of the messages are not used; with estimator.horizon=0.134 all are" in lines[0]


@pytest.mark.parametrize("name", scenario_names())
def test_no_ready_made_scenario_throws_late_messages_away(name: str) -> None:
    assert late_messages(load_scenario(name)) == []
