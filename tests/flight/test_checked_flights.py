"""No element of the package reads or writes beyond its arrays: flights whose elements all check their indices."""

from functools import partial

import numpy as np
import pytest
from test_compiled_faults import SETTINGS
from test_players import CASES, MOVING, PROJECTED

from ortilo_drake.flight.engine import Engine
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import load_scenario, scenario_names

WRONG = [{"kind": kind, "start": 1.0 + 0.3 * i} | its for i, (kind, its) in enumerate(SETTINGS.items())]
FAULTS = [("faults", [its if its["kind"] == "load_dropped" else its | {"end": its["start"] + 0.5} for its in WRONG])]
FLIGHTS = [*((name, ()) for name in scenario_names()), *CASES, ("imu_uwb_yolo", FAULTS)]


@pytest.mark.long
@pytest.mark.parametrize(("name", "changes"), FLIGHTS)
def test_elements_that_check_their_indices_fly_the_same_bits(
    name: str, changes: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario(name, (*MOVING, PROJECTED, *changes))
    usual = Engine(scenario)
    monkeypatch.setattr("ortilo_drake.flight.engine.Wiring", partial(Wiring, checked=True))
    checked = Engine(scenario)
    assert checked.text != usual.text
    np.testing.assert_array_equal(checked.trace(0)[0], usual.trace(0)[0])
    figures = dict(zip(checked.columns, checked.figures([0])[0], strict=True))
    assert figures["ticks"] * checked.h > 3.0
    dropped = "estimator.delay=drop" in changes  # what is late never arrives
    assert dropped or min(figures[f"arrived_{sensor}"] for sensor in scenario.sensors) > 0
