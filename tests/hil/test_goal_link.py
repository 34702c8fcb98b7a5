"""A request is repeated until it is answered, and every end of it is one line."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import xarray as xr
from hil_link import KEY, Loop, PlayedWorld, answering, flight_for_packets, key_file, open_bus
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner
from waiting import HANGS

from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.flight.flight import fly
from ortilo_drake.hil.goals import goal_link
from ortilo_drake.hil.goals.goal_link import LOCKSTEP_REFUSAL, GoalLink, answer_to, ask_goal
from ortilo_drake.hil.sessions import run_world
from ortilo_drake.hil.wire.handshake import find_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.packets import Goal, Outbox, publish_goal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

SESSION = 77
SETTINGS = ("settle=0", "planner={kind: hover, duration: 1}")


class Clock:
    """A clock that stands still until it is told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(goal_link.time, "monotonic", lambda: self.now)


def sent_by(inbox: Inbox) -> list[Goal]:
    return [arrival.packet.value for arrival in inbox.poll()]


def link_and_wire(wait: float = 5.0) -> tuple[GoalLink, Inbox]:
    joined = Loop()
    inbox = Inbox(joined, ["goal"], flight_for_packets(SESSION))
    return GoalLink(Outbox(joined, SESSION), inbox, wait), inbox


def test_who_joins_under_way_asks_for_a_tick_whose_answer_it_takes() -> None:
    joined = Loop()
    inbox = Inbox(joined, ["goal"])
    inbox.begin(flight_for_packets(SESSION), 100)
    link = GoalLink(Outbox(joined, SESSION), inbox)
    link.ask(1.0, 2.0)
    link.turn([])
    assert [goal.tick for goal in sent_by(inbox)] == [100]
    assert inbox.counts().rejected == 0


def test_a_wish_is_repeated_until_its_own_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, (link, wire) = Clock(monkeypatch), link_and_wire()
    assert link.turn([]) is None
    link.ask(1.5, -2.0)
    sent = []
    for _ in range(100):  # one second
        assert link.turn([]) is None
        sent += sent_by(wire)
        clock.now += 0.01
    (wish,) = set(sent)
    assert len(sent) == 5
    assert (wish.session, wish.role, wish.x, wish.y, wish.reason) == (SESSION, "user", 1.5, -2.0, "")
    other = answer_to(wish._replace(number=wish.number ^ 1))
    assert link.turn([wish, other]) is None  # its own, and the answer to somebody else's
    answer = answer_to(wish, "no way")
    assert link.turn([wish, other, answer]) == answer
    sent_by(wire)
    clock.now += 1.0
    assert link.turn([answer]) is None
    assert sent_by(wire) == []


def test_a_newer_wish_replaces_the_older_one(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, (link, wire) = Clock(monkeypatch), link_and_wire()
    link.ask(1.0, 1.0)
    assert link.turn([]) is None
    (first,) = sent_by(wire)
    clock.now += 0.01
    link.ask(2.0, 2.0)
    assert link.turn([answer_to(first)]) is None
    (second,) = sent_by(wire)
    assert second.number != first.number
    assert link.turn([answer_to(second)]) == answer_to(second)


def test_without_an_answer_it_is_given_up_with_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, (link, _) = Clock(monkeypatch), link_and_wire(2.0)
    link.ask(1.0, 1.0)
    clock.now += 2.0
    assert link.turn([]) is None
    clock.now += 0.01
    answer = link.turn([])
    assert answer is not None
    assert answer.reason == "no answer in 2 s"
    assert link.turn([]) is None


@pytest.mark.long
@given(x=st.floats(allow_nan=True, allow_infinity=True), y=st.floats(allow_nan=True, allow_infinity=True))
def test_what_is_asked_for_arrives_or_is_refused_at_once(x: float, y: float) -> None:
    link, wire = link_and_wire()
    if abs(x) <= 1e4 and abs(y) <= 1e4:
        link.ask(x, y)
        assert link.turn([]) is None
        (wish,) = sent_by(wire)
        assert (wish.x, wish.y) == (x, y)
    else:
        with pytest.raises(InputError, match=r"^goal \(.*\): must be two finite numbers of at most 10000$"):
            link.ask(x, y)
        assert link.turn([]) is None
        assert sent_by(wire) == []


# --- a flight ----------------------------------------------------------------------------------------------------


ReasonFor = Callable[[Goal, int], str | None]


def play_flight(world: PlayedWorld, reason_for: ReasonFor, stop: threading.Event) -> None:
    """Be a world in flight, and an onboard half that answers the n-th packet of a wish with a reason, or not."""
    heard = tick = 0
    while not stop.wait(0.01):
        tick += 1
        for goal in world.turn(tick):
            heard += 1
            if (reason := reason_for(goal, heard)) is not None:
                publish_goal(world.outbox, answer_to(goal, reason))


@contextlib.contextmanager
def flying(bus: str, reason_for: ReasonFor) -> Iterator[None]:
    world, stop = PlayedWorld(bus, load_scenario("nominal_imu_uwb", SETTINGS)), threading.Event()
    with ThreadPoolExecutor(1) as pool:
        flight = pool.submit(play_flight, world, reason_for, stop)
        try:
            yield
        finally:
            stop.set()
            flight.result(HANGS)
            world.close()


def ask(bus: str, reason_for: ReasonFor, wait: float = HANGS, settings: tuple[str, ...] = SETTINGS) -> None:
    with flying(bus, reason_for):
        ask_goal(bus, KEY, load_scenario("nominal_imu_uwb", settings), 1.0, 2.0, wait)


def test_a_goal_is_taken_although_two_packets_are_lost(bus: str) -> None:
    heard: list[Goal] = []

    def answer_third(goal: Goal, n: int) -> str | None:
        heard.append(goal)
        return "" if n >= 3 else None

    ask(bus, answer_third)
    assert {goal._replace(tick=0) for goal in heard} == {heard[0]._replace(tick=0)}
    assert [goal.tick for goal in heard] == sorted(goal.tick for goal in heard)  # each says when it was asked
    assert (heard[0].x, heard[0].y) == (1.0, 2.0)


def test_every_refusal_is_one_line(bus: str, other_bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"^goal \(1, 2\): in an obstacle$"):
        ask(bus, lambda goal, n: "in an obstacle")
    with monkeypatch.context() as patch:  # however long the world takes to be heard
        patch.setattr(goal_link, "find_world", lambda bus, inbox, scenario, _: find_world(bus, inbox, scenario, HANGS))
        with pytest.raises(InputError, match=r"^goal \(1, 2\): no answer in 1 s$"):
            ask(bus, lambda goal, n: None, wait=1.0)
    with pytest.raises(InputError, match=r"^world: flies another scenario \(.*the world alone reads may differ$"):
        ask(bus, lambda goal, n: "", settings=(*SETTINGS, "control_rate=60"))
    with pytest.raises(InputError, match=r"^world: not heard in 0.2 s; start it with: ortilo hil world$"):
        ask_goal(other_bus, KEY, load_scenario("nominal_imu_uwb", SETTINGS), 1.0, 2.0, 0.2)


def test_the_command_takes_numbers_below_zero(bus: str, tmp_path: Path) -> None:
    heard: list[Goal] = []

    def answer(goal: Goal, n: int) -> str:
        heard.append(goal)
        return "no way" if goal.x > 0.0 else ""

    options = [part for setting in SETTINGS for part in ("--set", setting)]
    options += ["--url", bus, "--key", str(key_file(tmp_path)), "--wait", str(HANGS)]
    with flying(bus, answer):
        done = CliRunner().invoke(hil_app, ["goal", "-1.5", "-2e-1", "nominal_imu_uwb", *options])
        refused = CliRunner().invoke(hil_app, ["goal", "1", "-2", "nominal_imu_uwb", *options])
    assert (done.exit_code, done.output) == (0, "goal (-1.5, -0.2): flies there\n")
    assert {(goal.x, goal.y) for goal in heard} == {(-1.5, -0.2), (1.0, -2.0)}
    assert str(refused.exception) == "goal (1, -2): no way"


def test_a_flight_in_lockstep_refuses_and_goes_on(bus: str) -> None:
    scenario, joined = load_scenario("nominal_imu_uwb", SETTINGS), open_bus(bus)
    inbox, answers, asked, refused = Inbox(joined, ["hello", "goal"]), [], threading.Event(), threading.Event()

    def wait_a_little(*tick: object) -> None:
        """Go on only once the goal is under way; the world passes packets on between its ticks."""
        asked.wait(HANGS)
        refused.wait(0.2)

    with answering(scenario, bus, after_user=True) as answered, ThreadPoolExecutor(1) as pool:
        world = pool.submit(run_world, scenario, bus, KEY, True, HANGS, record=wait_a_little)
        flight = find_world(joined, inbox, scenario, HANGS).flight
        link = GoalLink(Outbox(joined, flight.session), inbox, HANGS)
        link.ask(1.0, 2.0)
        while not answers:
            heard = [arrival.packet.value for arrival in inbox.poll(10) if arrival.packet.name == "goal"]
            answers += filter(None, [link.turn(heard)])
            asked.set()
        refused.set()
        flight, _ = world.result(HANGS)
        assert answered.result(HANGS) == flight.sizes["tick"]
    assert [goal.reason for goal in answers] == [LOCKSTEP_REFUSAL]
    xr.testing.assert_equal(flight, fly(scenario))
