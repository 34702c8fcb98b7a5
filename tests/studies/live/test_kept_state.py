"""A bridge that goes on from the state that a killed one kept: a motion cut in two, without any wall clock."""

import re
from pathlib import Path

import numpy as np
import pytest
from live_messages import IMU, RANGES, START, messages_of, run_live_plainly
from made_up_motion import as_map, made_up, place

from ortilo_drake.commands.hil.going_on import kept_in
from ortilo_drake.studies.live import kept_state, live_filter
from ortilo_drake.studies.live.kept_state import EVERY, Kept, StateKeeper, load_state, why_not
from ortilo_drake.studies.live.live_bridge import LiveBridge
from ortilo_drake.studies.live.stamped_estimate import Limits
from ortilo_drake.studies.recorded.anchor_trust import ASTRAY
from ortilo_drake.studies.recorded.filter_types import State
from ortilo_drake.studies.recorded.imu_watch import RESTS
from ortilo_drake.studies.recorded.passing import HOVERS, STALE

MAP = as_map(RANGES + IMU + START)
ON_THE_FLOOR = as_map(RANGES + IMU + "start: {position: [9, 9, 0], heading: 3}\n")  # which the ranges contradict
DIES, BACK = 1.5, 3.41


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    run_live_plainly(monkeypatch)


def bridge_of(map_, path: Path, lines: list[str], sent: list) -> LiveBridge:
    """Return a bridge that keeps its state in a file, and goes on from the one there."""
    bridge, keeper = LiveBridge(map_, lines.append, rate=25.0), StateKeeper(path, map_, lines.append)
    if (found := load_state(path, map_)) is not None:
        bridge.resume(found, path.name)

    def send(told, wanted, resets):
        sent.append((told, resets))
        keeper.keep(told.t, bridge.kept)

    bridge.add_target("mavlink", send)
    return bridge


def stamp_of(path: Path) -> float:
    """Return the stamp of the state in a file."""
    kept = load_state(path, MAP)
    assert kept is not None
    return kept.origin + kept.state.t


def fed(bridge: LiveBridge, messages) -> None:
    for message in messages:
        bridge.receive(*message)


def test_it_goes_on_as_a_bridge_that_lived_through_a_silence_of_all_sensors(tmp_path) -> None:
    """So long that both go by the ranges of a second then. A start that they contradict is past."""
    motion, path, lines, before, after = made_up(4.8), tmp_path / "state.npz", [], [], []
    messages = messages_of(motion)
    fed(bridge_of(MAP, path, lines, before), [one for one in messages if one[1] < 1e9 * DIES])
    at = stamp_of(path)
    assert at > DIES - EVERY - 0.2  # of the lag, and a period
    fed(bridge_of(ON_THE_FLOOR, path, lines, after), [one for one in messages if one[1] > 1e9 * BACK])
    (later,) = (
        float(found[1]) for line in lines if (found := re.fullmatch(r"goes on from state.npz, (.*) s later", line))
    )
    assert later == pytest.approx(BACK - at, abs=0.1)  # some rows until the stamps are believed
    assert not any("start:" in line for line in lines)
    assert BACK < after[0][0].t < BACK + 0.1
    assert [resets for _, resets in before] == [0] * len(before)
    assert [resets for _, resets in after] == [2] * len(after)  # it is another process, and by the ranges' fix

    lived: list = []
    fed(bridge_of(MAP, tmp_path / "other.npz", [], lived), [m for m in messages if not 1e9 * at < m[1] < 1e9 * BACK])
    same = {round(told.t, 3): told for told, _ in lived}
    for told, _ in after:
        other = same[round(told.t, 3)]
        apart = np.abs(told.estimate[:9] - other.estimate[:9])
        assert (apart < 0.2 * np.sqrt(np.diag(other.covariance)[:9])).all()
        assert told.deviation == pytest.approx(other.deviation, rel=0.05)
        assert told.yaw_deviation == pytest.approx(other.yaw_deviation, rel=0.05)
        off = np.abs(told.estimate[:3] - place(np.array([told.t]))[0])
        assert (off < 3.0 * np.sqrt(np.diag(told.covariance)[:3])).all()


def test_before_a_range_comes_it_claims_what_is_known_of_an_unknown_motion(tmp_path) -> None:
    """Integrals of white noise: of the rates, and of the forces and of gravity by the tilt that the rates make."""
    path, after = tmp_path / "state.npz", []
    messages = messages_of(made_up(DIES + 1.2))
    fed(bridge_of(MAP, path, [], []), [one for one in messages if one[1] < 1e9 * DIES])
    kept, back = load_state(path, MAP), DIES + 0.8
    assert kept is not None
    fed(bridge_of(MAP, path, [], after), [one for one in messages if one[0] == "/imu" and one[1] > 1e9 * back])
    silence, C = back - kept.origin - kept.state.t - STALE, kept.state.C
    told = after[0][0].covariance
    assert told[5, 5] - C[8, 8] == pytest.approx(HOVERS[0] ** 2 * silence, rel=0.1)
    by_tilt = 9.81**2 * (C[6, 6] * silence**2 + HOVERS[0] ** 2 * silence**3 / 3.0)
    assert told[6, 6] - C[3, 3] == pytest.approx(HOVERS[1] ** 2 * silence + by_tilt, rel=0.15)
    assert after[0][0].deviation > ASTRAY


def kept_at(t: float, rests: float = 0.0) -> Kept:
    watched = np.zeros(17)
    watched[RESTS], watched[4:6] = rests, np.inf
    return Kept(100.0, 100.1 + t, round(1e9 * (500.1 + t)), 3, State(t, np.ones(30), np.eye(29), np.ones(6), watched))


def test_what_is_read_is_what_was_written(tmp_path) -> None:
    path, lines = tmp_path / "state.npz", list[str]()
    keeper = StateKeeper(path, MAP, lines.append)
    keeper.keep(107.0, kept_at(7.0, rests=1.0))
    keeper.keep(106.9, kept_at(7.0))
    assert load_state(path, MAP) is None  # it rests, or is of a later stamp than the estimate
    keeper.keep(107.0, kept_at(7.0))
    keeper.keep(107.1, kept_at(7.0 + 0.9 * EVERY))
    found = load_state(path, ON_THE_FLOOR)
    assert found is not None
    np.testing.assert_equal(found, kept_at(7.0))
    assert [one.name for one in tmp_path.iterdir()] == ["state.npz"]
    assert lines == []


@pytest.mark.parametrize(
    ("stamps", "wall", "said"),
    [
        (1.3, 1.3, ""),
        (4.8, 4.8, ""),
        (4.93, 4.93, "it is 5.0 s old"),  # a tenth of a second between the state and the message
        (1.3, 12.0, "it is 12.0 s old"),
        (12.0, 1.3, "its clock is another: the stamps went on by 12.0 s, the wall clock by 1.3 s"),
        (-3.0, 1.0, "its clock is another"),
        (1.0, -3600.0, "its clock is another"),
        (1e9, 2.0, "its clock is another"),
    ],
)
def test_a_state_of_another_time_or_clock_is_refused(stamps: float, wall: float, said: str) -> None:
    kept = kept_at(7.0)
    why = why_not(kept, kept.newest + stamps, kept.received + round(1e9 * wall))
    assert why.startswith(said)
    assert bool(why) == bool(said)


def test_a_bridge_that_cannot_go_on_from_it_says_so_in_a_line_and_begins_as_without(tmp_path) -> None:
    motion, path, lines, sent = made_up(2.5), tmp_path / "state.npz", [], []
    StateKeeper(path, MAP, lines.append).keep(107.0, kept_at(7.0))
    fed(bridge_of(MAP, path, lines, sent), messages_of(motion))
    (told,) = (line for line in lines if "state.npz" in line)
    assert told.startswith("warning  state.npz: is not used: its clock is another: the stamps went on by -107.")
    assert "the filter has begun, by the ranges from 0.0 s after the first on" in lines
    assert {resets for _, resets in sent} == {4}  # another start all the same, for who fuses it


def test_a_file_that_is_damaged_or_of_another_map_is_refused(tmp_path) -> None:
    path = tmp_path / "state.npz"
    StateKeeper(path, MAP, lambda _: None).keep(107.0, kept_at(7.0))
    with pytest.raises(ValueError, match="another map"):
        load_state(path, as_map(RANGES.replace("0.2", "0.3", 1) + IMU + START))
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole.replace(b"\x3f", b"\x3e", 1), b"", b"PK"):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="damaged"):
            load_state(path, MAP)
    for bad in (np.nan, np.inf):
        kept = kept_at(7.0)
        kept.state.C[3, 3] = bad
        path.unlink()
        StateKeeper(path, MAP, lambda _: None).keep(107.0, kept)
        with pytest.raises(ValueError, match="not finite"):
            load_state(path, MAP)


def test_nobody_goes_on_from_the_state_of_a_filter_whose_heading_is_wrong(tmp_path, monkeypatch) -> None:
    motion, path, lines, sent = messages_of(made_up(2.5)), tmp_path / "state.npz", [], []
    bridge = bridge_of(MAP, path, lines, sent)
    target = kept_in(path, MAP, bridge, lambda *_: None, lines.append)
    bridge.add_target("mavlink", target, limits=Limits(1.0, 0.5))
    later = len(motion) // 2
    fed(bridge, motion[:later])
    assert path.exists()
    monkeypatch.setattr(live_filter.LiveFilter, "wrong", "the heading is wrong")
    fed(bridge, motion[later : later + 20])
    assert bridge.kept is None
    assert not path.exists()


def test_a_file_that_cannot_be_written_any_more_is_told_once_and_harms_nothing(tmp_path, monkeypatch) -> None:
    def fails(*_, **__):
        raise kept_state.InputError("state.npz: cannot be written: No space left on device")

    monkeypatch.setattr(kept_state, "keep", fails)
    lines = list[str]()
    keeper = StateKeeper(tmp_path / "state.npz", MAP, lines.append)
    for t in (7.0, 8.0, 9.0):
        keeper.keep(100.0 + t, kept_at(t))
    assert lines == ["warning  state.npz: cannot be written: No space left on device"]
