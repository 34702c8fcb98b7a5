"""An onboard half that was away: checkpoints, what is known after a gap, and a killed process."""

import io
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.flight.store import keep
from ortilo_drake.hil.real_time.real_time_onboard import join_flight
from ortilo_drake.hil.restart.checkpoint import (
    MAX_AGE,
    Checkpoint,
    load_checkpoint,
    load_path,
    path_file,
    save_checkpoint,
    save_path,
    session_of,
)
from ortilo_drake.hil.restart.keep_alive import keep_alive
from ortilo_drake.onboard.estimator.resume import ANGLE_SD, RATE_SD, SPEED, VELOCITY_SD, after_gap
from ortilo_drake.onboard.planner.goal_path import brake, join_paths
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import GcsPlanner, Scenario, load_scenario

H = 1.0 / 30.0
SETTINGS = ("planner={kind: hover, duration: 20.0}",)
KEPT = Checkpoint(session=7, tick=100, state=np.arange(240.0))


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario("nominal_imu_uwb", SETTINGS)


def fly(world: WorldHalf, onboard: OnboardHalf, ticks: int) -> np.ndarray:
    for _ in range(ticks):
        onboard.receive(world.sample())
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


def test_a_checkpoint_tells_whose_flight_it_is_of(tmp_path: Path) -> None:
    file = tmp_path / "state.npz"
    assert session_of(file) == 0
    save_checkpoint(file, KEPT)
    assert session_of(file) == KEPT.session
    file.write_bytes(file.read_bytes()[:100])
    assert session_of(file) == 0


def write(path: Path, of: str, **arrays: object) -> None:
    """Write arrays whose digest is right."""
    packed = io.BytesIO()
    np.savez(packed, **arrays)
    keep(path, packed.getvalue(), of)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and no more", b"not an archive"])
def test_a_damaged_checkpoint_is_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "c.npz").write_bytes(content)
    assert load_checkpoint(tmp_path / "c.npz", 7, 110, H, 240) is None
    assert load_checkpoint(tmp_path / "missing.npz", 7, 110, H, 240) is None


def test_a_checkpoint_that_would_unpickle_is_none(tmp_path: Path) -> None:
    write(tmp_path / "c.npz", "checkpoint", session=7, tick=100, state=np.array([object()]))
    assert load_checkpoint(tmp_path / "c.npz", 7, 110, H, 1) is None


def test_a_gap_widens_the_covariance_and_keeps_the_estimate() -> None:
    xbar, P = np.arange(15.0), np.diag(np.arange(1.0, 16.0))
    after, wider = after_gap(xbar, P, 0.5)
    np.testing.assert_array_equal(after, xbar)
    added = np.repeat([(0.5 * SPEED) ** 2, ANGLE_SD**2, VELOCITY_SD**2, RATE_SD**2, 0.0], 3)
    np.testing.assert_allclose(wider - P, np.diag(added), rtol=1e-12, atol=1e-15)


@pytest.mark.family
@pytest.mark.parametrize("delay", ["ignore", "replay"])
def test_but_for_what_a_gap_adds_a_new_half_goes_on_where_the_old_one_stopped(
    delay: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ortilo_drake.flight.stepped_halves.after_gap", lambda xbar, P, seconds: (xbar, P))
    late = ("uwb.link.delay=2",) if delay == "replay" else ()
    scenario = load_scenario("nominal_imu_uwb", (*SETTINGS, f"estimator.delay={delay}", *late))
    world, old = WorldHalf(scenario), OnboardHalf(scenario)
    fly(world, old, 60)
    new = OnboardHalf(scenario)
    new.resume(60, old.state(), 0.0)
    for _ in range(10):
        messages = world.sample()
        for half in (old, new):
            half.receive(messages)
        for name, value in old.outputs().items():
            np.testing.assert_array_equal(new.outputs()[name], value, err_msg=name)
        world.advance(old.answer())
        for half in (old, new):
            half.advance()


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


@pytest.mark.long
def test_a_path_comes_back_for_its_own_session_only(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb")
    path = plan(scenario.planner, scenario.load_room(), scenario.vehicle)
    save_path(tmp_path / "c.npz", 7, path)
    found = load_path(tmp_path / "c.npz", 7)
    assert found is not None
    times = np.linspace(0.0, path.end_time(), 2001)
    np.testing.assert_allclose(found.vector_values(times), path.vector_values(times), rtol=0, atol=1e-12)
    assert load_path(tmp_path / "c.npz", 8) is None
    assert load_path(tmp_path / "other.npz", 7) is None


@pytest.mark.parametrize(
    "knots", [np.zeros((7, 3)), np.zeros((6, 3)), np.zeros(7), np.full((7, 2), np.nan), np.zeros((7, 0)), np.array("x")]
)
def test_a_path_that_cannot_be_flown_is_none(tmp_path: Path, knots: np.ndarray) -> None:
    write(path_file(tmp_path / "c.npz"), "path", session=7, knots=knots)
    assert load_path(tmp_path / "c.npz", 7) is None
    path_file(tmp_path / "c.npz").write_bytes(b"not an archive")
    assert load_path(tmp_path / "c.npz", 7) is None


@pytest.mark.family
@pytest.mark.parametrize("keeps", [True, False])
def test_a_half_that_is_killed_on_its_way_to_a_goal_goes_on_to_it(tmp_path: Path, keeps: bool) -> None:
    scenario = load_scenario("nominal_imu_uwb", ("planner={kind: hover, point: [7.5, 1.0, 1.5], duration: 20.0}",))
    world, old = WorldHalf(scenario), OnboardHalf(scenario)
    fly(world, old, 60)
    settings = GcsPlanner(start=(7.5, 1.0), goal=(9.5, 0.0))
    way = plan(settings, scenario.load_room(), scenario.vehicle)
    path = join_paths(brake(old.path, 2.0, 0.2), way, 2.0)
    old.fly_path(path)
    fly(world, old, 90)
    checkpoint = tmp_path / "c.npz"
    save_path(checkpoint, 7 if keeps else 6, path)
    save_checkpoint(checkpoint, Checkpoint(7, 150, old.state()))
    hover = np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
    for _ in range(4):
        world.advance(hover)
    new = OnboardHalf(scenario)
    join_flight(new, checkpoint, 7, 154, scenario.h)
    expected = path.value(154 * scenario.h)[:, 0] if keeps else [7.5, 1.0, 1.5]
    np.testing.assert_allclose(new.outputs()["reference"][:3], expected, atol=1e-12)
    fly(world, new, 300)
    goal = [9.5, 0.0, 1.5] if keeps else [7.5, 1.0, 1.5]  # without the file the scenario's own path is what it knows
    assert np.linalg.norm(world.state[:3] - goal) < 0.3


@pytest.mark.long
def test_a_killed_process_is_started_again(tmp_path: Path) -> None:
    said: list[str] = []

    def fly_once(killed: int) -> None:
        starts = tmp_path / "starts"
        starts.write_text((starts.read_text() if starts.exists() else "") + "x")
        assert len(starts.read_text()) == killed + 1
        if killed < 2:
            os.kill(os.getpid(), signal.SIGKILL)

    assert keep_alive(fly_once, said.append) == 2
    assert (tmp_path / "starts").read_text() == "xxx"
    assert sum("was killed by SIGKILL" in line for line in said) == 2


def test_a_process_that_fails_is_not_started_again() -> None:
    def fail(killed: int) -> None:
        raise SystemExit(2)

    with pytest.raises(SystemExit) as ended:
        keep_alive(fail, lambda line: None)
    assert ended.value.code == 2
