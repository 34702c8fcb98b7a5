"""A live flight: what the controls change, what they do not, and goals; the page's own controls."""

import json
import math
import re
from collections.abc import Callable
from itertools import chain, repeat
from typing import Any

import msgpack
import numpy as np
import pytest
from command_line import run
from planning_at_once import AtOnce
from pydrake.geometry import Meshcat

from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.hil.live import session as session_module
from ortilo_drake.hil.live.controls import (
    GO,
    GOAL,
    HEAVIER,
    LOST,
    MOST_HEAVIER,
    MOST_STEPS,
    PAUSE,
    PUSH,
    RESTART,
    SLOWEST,
    SPEED,
    STEP,
    STRONGEST_PUSH,
    Controls,
)
from ortilo_drake.hil.live.live_flight import LiveFlight, ShownTick, Wishes, with_a_force
from ortilo_drake.hil.live.scene import Scene
from ortilo_drake.hil.live.session import Shares, Status, fly_live, wait_for_page
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.views.guarded.panel import Panel

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 5}", "camera.kind=projected")
HOVERING = load_scenario("nominal_imu_uwb_yolo", HOVER)
NOTHING = Wishes()


def flight(scenario: Scenario = HOVERING) -> LiveFlight:
    return LiveFlight(scenario, AtOnce(scenario))


def fly(live: LiveFlight, ticks: int, wishes: Wishes = NOTHING) -> list[ShownTick]:
    return [live.step(wishes) for _ in range(ticks)]


def test_left_alone_it_is_the_flight_that_is_flown_anyway() -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", (*HOVER, "planner.duration=2", "settle=0"))
    seen = fly(flight(scenario), 61)
    data = fly_lockstep(scenario, in_this_process(scenario))
    np.testing.assert_array_equal([s.x for s in seen], data["truth"].values)
    np.testing.assert_array_equal([s.xhat for s in seen], data["estimate"].values)
    assert [s.time for s in seen] == pytest.approx(data["time"].values)


@pytest.mark.long
def test_arrivals_follow_the_loss_of_their_own_sensor() -> None:
    live = flight()
    for loss in (0.0, 0.7, 1.0):
        seen = fly(live, 300, Wishes(lost={"uwb": loss}))
        sent = [s for s in seen if "uwb" in s.sent]
        share = np.mean(["uwb" in s.arrived for s in sent])
        assert share == pytest.approx(1.0 - loss, abs=3.5 * np.sqrt(loss * (1.0 - loss) / len(sent)))
        pictures = [s for s in seen if "camera" in s.sent]
        assert np.mean(["camera" in s.arrived for s in pictures]) > 0.8


@pytest.mark.long
def test_a_push_is_the_force_that_the_filter_finds_and_the_vehicle_stays_where_it_is() -> None:
    live = flight(load_scenario("imu_uwb_yolo", HOVER))
    fly(live, 150)
    seen = fly(live, 600, Wishes(push=(0.6, -0.4)))
    tilt = np.mean([s.x[3:5] for s in seen[300:]], axis=0)  # against the push: m g tan(theta) = -F_x
    weight = HOVERING.vehicle.mass * 9.81
    np.testing.assert_allclose(tilt, [-0.4 / weight, -0.6 / weight], rtol=0.15)
    assert np.abs(np.mean([s.x[:3] for s in seen[300:]], axis=0) - [8.0, 1.0, 1.5]).max() < 0.1


def test_a_heavier_vehicle_first_sinks_as_gravity_says() -> None:
    light, heavy = flight(), flight()
    fly(light, 60), fly(heavy, 60)
    n, m = 6, 1.1
    fall = fly(light, n)[-1].x[2] - fly(heavy, n, Wishes(heavier=m - 1.0))[-1].x[2]
    t = (n - 1) * HOVERING.h
    assert fall == pytest.approx((1.0 - 1.0 / m) * 9.81 * t**2 / 2.0, rel=0.25)  # before the servo answers
    assert flight().step(Wishes(heavier=0.1)).lost is None


@pytest.mark.long
def test_a_world_of_its_own_truth_keeps_it() -> None:
    scenario = load_scenario("realistic", HOVER)
    assert with_a_force(scenario) is scenario
    one, other = flight(scenario), flight(scenario)
    fly(one, 10)
    fly(other, 5)
    fly(other, 4, Wishes(push=(0.0, 0.0), heavier=0.0))
    np.testing.assert_array_equal(one.step(NOTHING).x, fly(other, 2)[-1].x)


@pytest.mark.long
def test_a_goal_is_flown_and_one_in_a_wall_is_refused() -> None:
    live = flight()
    fly(live, 30)
    refused = fly(live, 2, Wishes(goal=(5.5, -1.5), goes=True))
    assert any("wall" in answer for s in refused for answer in s.answers)
    seen = [live.step(Wishes(goal=(9.5, 1.8), goes=True)), *fly(live, 450)]
    assert any(s.path is not None for s in seen)
    assert any("on the way" in answer for s in seen for answer in s.answers)
    np.testing.assert_allclose(seen[-1].x[:2], [9.5, 1.8], atol=0.25)


class Clock:
    """Time that passes only by sleeping."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def session(wishes: list[Wishes], scenario: Scenario = HOVERING) -> tuple[Status, Clock, list[Status]]:
    clock, shown = Clock(), list[Status]()
    show: Callable[[Status], None] = lambda status: shown.append(Status(**vars(status)))  # noqa: E731
    says = chain(wishes, repeat(Wishes(ends=True))).__next__
    last = fly_live(scenario, AtOnce(scenario), says, None, show, clock)
    return last, clock, shown


def test_pause_holds_the_time_and_single_ticks_go_on() -> None:
    flown = [NOTHING] * 10
    last, _, _ = session(flown + [Wishes(pauses=True)] * 50)
    assert last.time == pytest.approx(9 * HOVERING.h)
    assert last.is_paused
    last, _, _ = session([*flown, Wishes(pauses=True), Wishes(pauses=True, steps=3), Wishes(pauses=True)])
    assert last.time == pytest.approx(12 * HOVERING.h)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_it_is_as_fast_as_asked(speed: float) -> None:
    last, clock, _ = session([Wishes(speed=speed)] * 91)
    assert last.time == pytest.approx(3.0)
    assert clock.now == pytest.approx(91 * HOVERING.h / speed)


@pytest.mark.long
def test_a_lost_flight_stands_still_until_it_is_flown_anew() -> None:
    fast = load_scenario("nominal_imu_uwb", HOVER[:1])
    dropped = [Wishes(heavier=0.3, push=(2.0, 2.0), lost={"uwb": 1.0})] * 1200
    last, _, shown = session(dropped, fast)
    assert re.match(rf"lost at {last.time:.1f} s: (tumbled|left the room|hit a wall|diverged)$", last.note)
    assert last.time > 1.0  # it cannot fall out of the room in less
    assert shown[-1].time == last.time
    assert last.time < 1199 * fast.h
    last, _, _ = session([*dropped, Wishes(restarts=True), NOTHING, NOTHING], fast)
    assert last.time == pytest.approx(2 * fast.h)
    assert last.note == ""


def test_a_page_can_read_of_a_flight_that_diverged() -> None:
    def no_number(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    status = Status(error=math.nan, by_axis=[(math.nan, math.inf)] * 3, is_lost=True)
    found = json.loads(status.json(), parse_constant=no_number)
    assert found == vars(status) | {"error": None, "by_axis": [[None, None]] * 3}


def test_it_waits_until_a_page_is_open() -> None:
    open_pages, clock = iter([0, 0, 0, 1]), Clock()
    wait_for_page(lambda: next(open_pages), clock)
    assert clock.now > 0.0
    assert next(open_pages, None) is None


@pytest.mark.long
def test_the_command_takes_off_when_a_page_is_open_or_at_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def never(*_: object) -> None:
        raise KeyboardInterrupt

    def fly_for_a_second(*arguments: Any) -> None:
        arguments[-1](Status(time=1.0))

    def lose_the_page(*_: object) -> None:
        raise RuntimeError("Meshcat's internal websocket thread exited\nunexpectedly")

    monkeypatch.setattr(session_module, "wait_for_page", never)
    monkeypatch.setattr(session_module, "fly_live", fly_for_a_second)
    words = ("live", "nominal_imu_uwb", "--set", HOVER[0])
    assert run(*words) == 0
    address, waiting, ended = capsys.readouterr().out.splitlines()
    assert re.match(r"open http://127\.0\.0\.1:\d+/[-\w]{20,}/ \(readings on the left, controls", address)
    assert waiting == "the vehicle takes off when the page is opened; --no-wait takes off at once"
    assert ended == "not flown"
    assert run(*words, "--no-wait") == 0
    said = capsys.readouterr().out
    assert "waiting" not in said
    assert said.splitlines()[-1].startswith("   1.0 s  error")
    monkeypatch.setattr(session_module, "fly_live", lose_the_page)
    assert run(*words, "--no-wait") == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("ortilo: the flight ended: Meshcat's internal websocket")


def test_shares_count_what_was_due_of_late_though_it_came_a_tick_later() -> None:
    shares = Shares({"uwb": 2, "camera": 3, "imu": 1}, 8)
    assert shares.now() == {"uwb": None, "camera": None, "imu": None}
    nothing = flight().step(NOTHING)
    for k in range(40):
        uwb, camera = k % 2 == 0 and k < 36, k % 3 == 1
        shares.count(nothing._replace(arrived=("imu", *["uwb"] * uwb, *["camera"] * camera)))
    assert shares.now() == {"uwb": 0.5, "camera": 1.0, "imu": 1.0}


def controls() -> tuple[Controls, Meshcat, Callable[..., object]]:
    meshcat, panel = Meshcat(), Panel()
    made = Controls(meshcat, panel, HOVERING.load_room(), HOVERING.sensors, (1.0, 2.0))
    return made, meshcat, lambda **said: panel.receive(msgpack.packb(said))


def test_the_pages_sliders_and_buttons_are_the_wishes() -> None:
    its, meshcat, say = controls()
    assert its.wishes() == Wishes(lost={"uwb": 0.0, "camera": 0.0}, goal=(1.0, 2.0), speed=1.0)
    sets = {LOST.format("uwb"): 70, PUSH[1]: 0.5, HEAVIER: 10.0, SPEED: 2.0, GOAL[0]: 4.0}
    for name, value in sets.items():
        say(type="slider", name=name, value=value)
    for name in (GO, PAUSE, STEP, STEP):
        say(type="button", name=name)
    wanted = Wishes(
        {"uwb": 0.7, "camera": 0.0}, (0.0, 0.5), 0.1, 2.0, (4.0, 2.0), goes=True, pauses=True, steps=2
    )  # fmt: skip
    assert its.wishes() == wanted
    assert its.wishes() == wanted._replace(goes=False, steps=0)
    assert meshcat.GetSliderValue(SPEED) == pytest.approx(2.0)  # for pages that are opened later
    assert set(sets) < set(meshcat.GetSliderNames())


def test_a_slider_is_not_pulled_back_while_it_is_dragged() -> None:
    its, meshcat, say = controls()
    for percent in (10, 20, 30):
        say(type="slider", name=LOST.format("uwb"), value=percent)
        assert its.wishes().lost["uwb"] == percent / 100.0
        assert meshcat.GetSliderValue(LOST.format("uwb")) == 0.0
    its.wishes()
    assert meshcat.GetSliderValue(LOST.format("uwb")) == 30.0


def test_no_message_wishes_more_than_the_sliders_ends_and_no_number_of_clicks_is_more_than_a_few() -> None:
    its, _, say = controls()
    for name, value in ((LOST.format("uwb"), 1e9), (PUSH[0], -1e300), (HEAVIER, -1e9), (SPEED, 0), (GOAL[0], 2**63)):
        say(type="slider", name=name, value=value)
    for name in (GO, STEP, PAUSE, RESTART):
        for _ in range(50_001 if name == STEP else 501):
            say(type="button", name=name)
    wishes = its.wishes()
    assert wishes.lost["uwb"] == 1.0
    assert (wishes.push[0], wishes.heavier, wishes.speed) == (-STRONGEST_PUSH, -MOST_HEAVIER / 100.0, SLOWEST)
    assert wishes.goal[0] == HOVERING.load_room().interior.max[0]
    assert wishes.steps == MOST_STEPS
    assert wishes.pauses
    assert its.wishes().steps == 0


@pytest.mark.long
def test_the_scene_shows_a_flight_and_its_lamps() -> None:
    meshcat = Meshcat()
    scene = Scene(meshcat, HOVERING.load_room(), HOVERING.vehicle, ("uwb", "camera"))
    live = flight()
    scene.begin(live.path)
    for _ in range(20):
        seen = live.step(Wishes(lost={"camera": 1.0}))
        scene.show(seen, draws=True)
    scene.show(seen._replace(P=np.full_like(seen.P, np.nan)), draws=True)  # has diverged: nothing to draw
    scene.show_goal(1.0, 2.0, 1.5)
    assert scene.lit() == {"uwb": True, "camera": False}
    for path in ("/flight/vehicle", "/flight/goal", "/flight/lamps/uwb", "/flight/true_path"):
        assert meshcat.HasPath(path)
