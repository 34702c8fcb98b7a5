"""An onboard half that was away: checkpoints, what is known after a gap, and a killed process."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from ortilo_drake.hil.checkpoint import MAX_AGE, Checkpoint, load_checkpoint, save_checkpoint
from ortilo_drake.hil.halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.keep_alive import keep_alive
from ortilo_drake.hil.resume import ANGLE_SD, RATE_SD, SPEED, VELOCITY_SD, after_gap
from ortilo_drake.scenario import Scenario, load_scenario

H = 1.0 / 30.0
KEPT = Checkpoint(session=7, tick=100, state=np.arange(240.0))


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("imu_uwb", ("planner={kind: hover, duration: 20.0}",))


def fly(world: WorldHalf, onboard: OnboardHalf, ticks: int) -> np.ndarray:
    for _ in range(ticks):
        onboard.take(world.sample())
        u = onboard.answer()
        onboard.advance()
        world.advance(u)
    return onboard.outputs()["estimate"][:3] - world.state[:3]


def test_a_checkpoint_comes_back_as_it_was(tmp_path: Path) -> None:
    save_checkpoint(tmp_path / "c.npz", KEPT)
    found = load_checkpoint(tmp_path / "c.npz", session=7, tick=110, h=H, size=240)
    assert found is not None
    assert found[:2] == KEPT[:2]
    np.testing.assert_array_equal(found.state, KEPT.state)
    assert [file.name for file in tmp_path.iterdir()] == ["c.npz"]


@pytest.mark.parametrize(
    ("session", "tick", "size"), [(8, 110, 240), (7, 99, 240), (7, 101 + round(MAX_AGE / H), 240), (7, 110, 241)]
)
def test_a_checkpoint_that_does_not_fit_is_not_used(tmp_path: Path, session: int, tick: int, size: int) -> None:
    save_checkpoint(tmp_path / "c.npz", KEPT)
    assert load_checkpoint(tmp_path / "c.npz", session, tick, H, size) is None


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"not an archive"])
def test_a_damaged_checkpoint_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "c.npz").write_bytes(content)
    assert load_checkpoint(tmp_path / "c.npz", 7, 110, H, 240) is None
    assert load_checkpoint(tmp_path / "missing.npz", 7, 110, H, 240) is None


def test_a_checkpoint_that_would_unpickle_is_none(tmp_path: Path) -> None:
    np.savez(tmp_path / "c.npz", session=7, tick=100, state=np.array([object()]))
    assert load_checkpoint(tmp_path / "c.npz", 7, 110, H, 1) is None


def test_a_gap_widens_the_covariance_and_keeps_the_estimate() -> None:
    xbar, P = np.arange(15.0), np.diag(np.arange(1.0, 16.0))
    after, wider = after_gap(xbar, P, 0.5)
    np.testing.assert_array_equal(after, xbar)
    added = np.repeat([(0.5 * SPEED) ** 2, ANGLE_SD**2, VELOCITY_SD**2, RATE_SD**2, 0.0], 3)
    np.testing.assert_allclose(wider - P, np.diag(added), rtol=1e-12, atol=1e-15)


def test_without_a_gap_a_new_half_goes_on_where_the_old_one_stopped(scenario: Scenario) -> None:
    world, old = WorldHalf(scenario), OnboardHalf(scenario)
    fly(world, old, 60)
    new = OnboardHalf(scenario)
    new.resume(60, old.state(), 0.0)
    np.testing.assert_array_equal(new.outputs()["estimate"], old.outputs()["estimate"])
    np.testing.assert_array_equal(new.outputs()["reference"], old.outputs()["reference"])


@pytest.mark.parametrize("remembers", [True, False])
def test_a_half_that_was_away_finds_the_vehicle_again(scenario: Scenario, remembers: bool) -> None:
    world, old = WorldHalf(scenario), OnboardHalf(scenario)
    fly(world, old, 60)
    state, hover = old.state(), np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
    for _ in range(6):
        world.advance(hover)
    new = OnboardHalf(scenario)
    new.resume(66, state if remembers else None, 6 * H if remembers else np.inf)
    assert np.linalg.norm(fly(world, new, 120)) < 0.15  # UWB fixes err by up to a decimetre
    assert np.linalg.norm(world.state[:3] - new.outputs()["reference"][:3]) < 0.3


def test_a_killed_process_is_started_again(tmp_path: Path) -> None:
    said: list[str] = []

    def fly_once() -> None:
        starts = tmp_path / "starts"
        starts.write_text((starts.read_text() if starts.exists() else "") + "x")
        if len(starts.read_text()) < 3:
            os.kill(os.getpid(), signal.SIGKILL)

    assert keep_alive(fly_once, said.append) == 2
    assert (tmp_path / "starts").read_text() == "xxx"
    assert sum("was killed by SIGKILL" in line for line in said) == 2


def test_a_process_that_fails_is_not_started_again() -> None:
    def fail() -> None:
        raise SystemExit(2)

    with pytest.raises(SystemExit) as ended:
        keep_alive(fail, lambda line: None)
    assert ended.value.code == 2
