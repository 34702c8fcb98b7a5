"""Differences of ranges that a receiver gives, against distances by SciPy and the moments that are asked for."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drake_box import PlayedBox
from scipy.spatial.distance import cdist

from ortilo_drake.loop.element import Values
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A, B
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.sensors.uwb import drawn, errors_drawn
from ortilo_drake.world.drawn_truth import draw_truth, of_seed
from ortilo_drake.world.sensors.fitted_uwb import draw_day
from ortilo_drake.world.sensors.range_differences import differences_box

ROOM = load_scenario("tight_differences").load_room()
N = len(ROOM.anchors)
STATE = np.array([3.0, -1.0, 1.4, 0.0, 0.0, 0.0, 1.0, -2.0, 0.5, 0.0, 0.0, 0.0])
SENT = np.zeros(1)
QUIET = {"uwb.noise": {"kind": "constant", "sd": 0.0}}


def scenario_of(**settings: Any) -> Scenario:
    return load_scenario("tight_differences", QUIET | {key.replace("__", "."): its for key, its in settings.items()})


def played(scenario: Scenario, seed: int = 1) -> PlayedBox:
    draw = of_seed(seed)
    its = draw_truth(scenario.truth, seed, ROOM, {"uwb": 1})
    given = Values().updated(errors_drawn(scenario, ROOM, draw)["uwb"]).updated(drawn(scenario, ROOM, its, {})["uwb"])
    box = differences_box(scenario, ROOM)
    return PlayedBox(replace(box, given=box.given.updated(given)), scenario.h, seed, sent=SENT, state=STATE)


def rows_of(message: np.ndarray) -> np.ndarray:
    return message[PAYLOAD:].reshape(-1, ROW)


def true_values(rows: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """Return what rows should say, by SciPy."""
    d = cdist(STATE[:3] - rows[:, AGE : AGE + 1] * STATE[6:9], anchors)
    at, a, b = np.arange(len(rows)), rows[:, A].astype(int), rows[:, B].astype(int)
    return np.asarray(d[at, b] - d[at, a])


def errors(scenario: Scenario, messages: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows (messages, rows, 5) of a flight and their errors, NaN where a row is not there."""
    plays, found, every = played(scenario, seed), [], scenario.every("uwb")
    for k in range(messages * every):
        if k % every == 0:
            found.append(rows_of(plays.say(k)))
        plays.step()
    rows = np.array(found)
    e = rows[..., VALUE] - true_values(rows.reshape(-1, ROW), ROOM.anchor_positions).reshape(rows.shape[:2])
    return rows, np.where(rows[..., THERE] == 1.0, e, np.nan)


def test_packets_come_in_turn_each_at_its_time() -> None:
    rows, e = errors(scenario_of(uwb__link__rate=10, uwb__packets=100), 3)
    assert rows.shape[1] == 10
    np.testing.assert_array_equal(rows[..., A].ravel(), np.arange(30) % N)  # goes on where the last message ended
    np.testing.assert_array_equal(rows[..., B].ravel(), np.arange(1, 31) % N)
    np.testing.assert_allclose(rows[0, :, AGE], np.arange(9, -1, -1) / 100.0, atol=1e-12)
    np.testing.assert_allclose(e, 0.0, atol=1e-12)
    assert np.ptp(rows[..., VALUE]) > 1.0


def test_white_noise_is_that_of_two_ranges() -> None:
    noise = {"kind": "affine", "sd": 0.03, "fraction": 0.02}
    rows, e = errors(scenario_of(uwb__noise=noise, uwb__packets=360), 600)
    d = cdist(STATE[np.newaxis, :3], ROOM.anchor_positions)[0]
    sds = 0.03 + 0.02 * d
    for j in range(N):  # twelve rows a message: row j has one pair
        a, b = rows[0, j, [A, B]].astype(int)
        assert e[:, j].std() == pytest.approx(np.hypot(sds[a], sds[b]), rel=0.1)
    assert abs(np.mean(e[:, 1:] * e[:, :-1])) < 0.05 * np.mean(e**2)  # rows that share an anchor are independent


def test_what_lasts_belongs_to_anchors() -> None:
    lasts = {"bias_sd": 0.2, "slow_sd": 0.1, "slow_time": 0.1, "bias": 5.0}
    _, e = errors(scenario_of(truth__uwb=lasts, uwb__packets=360), 900)
    its = draw_truth(scenario_of(truth__uwb=lasts).truth, 1, ROOM, {"uwb": 1})["uwb.bias"]
    np.testing.assert_allclose(e.mean(axis=0), np.roll(its, -1) - its, atol=0.04)  # the common 5 m is not seen
    slow = e - e.mean(axis=0)
    assert slow.std() == pytest.approx(np.sqrt(2.0) * 0.1, rel=0.05)
    assert np.mean(slow[1:] * slow[:-1]) / slow.var() == pytest.approx(np.exp(-1 / 3), abs=0.04)
    np.testing.assert_allclose(e.sum(axis=1), 0.0, atol=1e-9)  # around the cycle each anchor counts + and -


def test_true_places_and_a_factor() -> None:
    scenario = scenario_of(truth__survey__anchors_sd=0.1, truth__uwb__factor=1.01)
    rows = rows_of(played(scenario).say(0))
    at = ROOM.anchor_positions + draw_truth(scenario.truth, 1, ROOM, {"uwb": 1})["survey.anchors"]
    np.testing.assert_allclose(rows[:, VALUE], 1.01 * true_values(rows, at), rtol=1e-12)


def test_fitted_errors_are_those_of_the_description() -> None:
    fitted = {"white": 0.1, "missing": 0.2, "differences": True, "constants_sd": 0.3}
    fitted |= {"field": {"length": 1.0, "sd": 0.2}, "outliers": {"share": 0.19, "sd": 5.0}}
    scenario = scenario_of(uwb__errors="fitted", uwb__fitted=fitted, uwb__packets=360)
    rows, e = errors(scenario, 500)
    assert np.isnan(e).mean() == pytest.approx(0.2, abs=0.02)
    day = draw_day(scenario.uwb.fitted.of_single_ranges, N, of_seed(1))
    for j in range(N):
        a, b = rows[0, j, [A, B]].astype(int)
        p = STATE[:3] - np.nanmax(rows[:, j, AGE]) * STATE[6:9]
        c = (day.constants + day.fields_at(p[np.newaxis])[0])[[a, b]]
        assert np.nanmedian(e[:, j]) == pytest.approx(c[1] - c[0], abs=0.04)
        e[:, j] -= c[1] - c[0]
    far = np.abs(e[~np.isnan(e)]) > 0.5
    assert far.mean() == pytest.approx(0.19 * 0.92, abs=0.03)  # 8 % of the outliers err by less
    assert e[np.abs(e) < 0.5].std() == pytest.approx(0.1, rel=0.2)


def test_a_row_needs_both_anchors() -> None:
    for settings in ({"uwb__max_distance": 6.0}, {"uwb__walls": {"kind": "block"}}):
        scenario = scenario_of(uwb__pairs="all", uwb__packets=1980, **settings)
        rows = rows_of(played(scenario).say(0))
        d, reach = cdist(STATE[np.newaxis, :3], ROOM.anchor_positions)[0], scenario.uwb.max_distance
        blocked = [walls_crossed(STATE[:3], anchor, ROOM.wall_boxes) > 0 for anchor in ROOM.anchor_positions]
        heard = (d <= reach) & ~(np.array(blocked) & (scenario.uwb.walls.kind == "block"))
        both = heard[rows[:, A].astype(int)] & heard[rows[:, B].astype(int)]
        assert 0 < both.sum() < len(rows)
        assert np.mean(rows[:, THERE] == both) > 0.9  # older rows are from elsewhere
        assert not rows[rows[:, THERE] == 0.0][:, [VALUE, AGE]].any()


def test_nothing_is_said_where_nothing_is_sent() -> None:
    assert not played(scenario_of()).say(0, sent=np.array([-1.0])).any()


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"estimator": {"kind": "intermittent"}}, r"estimator\.kind: intermittent: must be tight"),
        ({"estimator.ranges.differences": True}, r"estimator\.ranges\.differences: true: must be false"),
        ({"uwb.packets": 100}, r"uwb\.packets: 100: must be a whole number, 1 or more, in each message: 3\.33"),
        ({"uwb.packets": 10}, r"uwb\.packets: 10: "),
        ({"uwb.round": 0.05}, r"uwb\.round: 0\.05: must be 0"),
        ({"uwb.walls": {"kind": "bias"}}, r"uwb\.walls\.kind: bias: must be none or block"),
        ({"uwb.behind_walls": "left_out"}, r"uwb\.behind_walls: left_out"),
        ({"uwb.pairs": "some"}, r"uwb\.pairs"),
        ({"faults": [{"kind": "anchor_moved", "start": 1.0, "anchor": 2}]}, r"faults\.0: anchor_moved"),
    ],
)
def test_what_does_not_go_together_is_one_line(settings: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named) as raised:
        load_scenario("tight_differences", settings)
    assert "\n" not in str(raised.value)
