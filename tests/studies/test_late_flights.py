"""Late flights: the links are as asked, the comparison is SciPy's, and replay's filter is the consistent one."""

import json
from pathlib import Path

import numpy as np
import pytest
from bench_late import late_table
from made_up_summaries import made_up_summary
from scipy.stats import binomtest

from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.late.late_flights import (
    AT_30_HZ,
    MODES,
    LateLinks,
    Pairs,
    late_flights,
    late_scenario,
    paired,
)

SHORT = ("planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}", "uwb.link.blackouts=[]")


def test_links_are_late_and_the_rest_stays() -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",))
    late = late_scenario(scenario, LateLinks(0.3, 2, 4, 0.1, 3), "replay")
    for sensor in ("uwb", "camera", "imu"):
        link, before = late.link_of(sensor), scenario.link_of(sensor)
        assert (link.loss.probability, link.delay, link.random_delay) == (0.3, 2, 4)
        assert (link.rate, link.blackouts) == (before.rate, before.blackouts)
    assert (late.command_link.loss.probability, late.command_link.delay) == (0.1, 3)
    assert late.estimator.delay == "replay"
    with pytest.raises(InputError, match="delay"):
        late_scenario(scenario, AT_30_HZ, "later")
    with pytest.raises(InputError, match=r"1\.5"):
        late_scenario(scenario, LateLinks(loss=1.5), "drop")


@pytest.mark.long
def test_the_same_seeds_in_every_mode(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", (*SHORT, "world.kinematics=linear"))
    told: list[str] = []
    report = late_flights(scenario, range(5), tmp_path, progress=lambda mode: told.append(mode.mode))
    data = json.loads(json.dumps(as_data(report), allow_nan=False))
    assert (data["seeds"], data["flown_by"]) == (list(range(5)), "engine")
    assert told == list(MODES)
    modes = report.modes
    assert all(modes[mode].flights == 5 and modes[mode].lost == 0 for mode in MODES)
    # Flights start without error, so the NEES of a consistent filter is a little below 3.
    assert 1.8 < modes["replay"].nees < 3.6
    assert modes["ignore"].nees > 1.5 * modes["replay"].nees
    assert report.against["ignore"]["estimation_mse"].better >= 4
    lines = late_table([report])
    assert len(lines) == 6
    assert "sensors only, flown by engine" in lines[2]
    assert " of 5, p = " in lines[2]
    assert lines[4].endswith("|  |")


def test_pairs_are_compared_seed_by_seed() -> None:
    def summaries(path: list[float | None]) -> list[Summary]:
        return [made_up_summary((1.0, 2.0, 3.0 + k), path=p, path_distance_mse=1.0 + k) for k, p in enumerate(path)]

    ours = summaries([1.0, 1.0, 1.0, 1.0, 1.0, None])
    found = paired(ours, summaries([2.0, 4.0, 8.0, 16.0, 32.0, 1.0]))
    assert found["path_mse"].better == found["path_mse"].pairs == 5
    assert found["path_mse"].ratio == pytest.approx(1.0 / 8.0)
    assert found["path_mse"].p == pytest.approx(binomtest(5, 5, alternative="greater").pvalue)  # all signs one way
    assert found["estimation_mse"] == Pairs(better=0, pairs=6, ratio=1.0, p=1.0)
    assert np.isfinite(found["path_distance_mse"].ratio)
