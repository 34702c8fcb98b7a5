"""A wish is repeated until it is answered, and every end of it is one line."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import xarray as xr
from hil_link import answering, hear_hello, open_bus
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner
from waiting import HANGS

from ortilo_drake.commands.hil import hil_app
from ortilo_drake.experiments.flight import fly
from ortilo_drake.hil import goal_link
from ortilo_drake.hil.bus import MEMORY_URL, Bus
from ortilo_drake.hil.goal_link import LOCKSTEP_REFUSAL, GoalLink, answer_to, ask_goal
from ortilo_drake.hil.handshake import flight_of, say_hello, scenario_digest
from ortilo_drake.hil.inbox import Inbox
from ortilo_drake.hil.packet_checks import Flight
from ortilo_drake.hil.packets import CHANNELS, Goal, Hello, encode_goal
from ortilo_drake.hil.runs import run_world
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

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
    joined = open_bus(MEMORY_URL)
    return GoalLink(joined, SESSION, wait), Inbox(joined, ["goal"], Flight(SESSION, 1 / 30, 8))


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


@given(x=st.floats(allow_nan=True, allow_infinity=True), y=st.floats(allow_nan=True, allow_infinity=True))
def test_what_is_asked_for_arrives_or_is_refused_at_once(x: float, y: float) -> None:
    link, wire = link_and_wire()
    if abs(x) <= 1e12 and abs(y) <= 1e12:
        link.ask(x, y)
        assert link.turn([]) is None
        (wish,) = sent_by(wire)
        assert (wish.x, wish.y) == (x, y)
    else:
        with pytest.raises(InputError, match=r"^goal \(.*\): must be two finite numbers of at most 1e\+12$"):
            link.ask(x, y)
        assert link.turn([]) is None
        assert sent_by(wire) == []


# --- a flight ----------------------------------------------------------------------------------------------------


ReasonFor = Callable[[Goal, int], str | None]


def play_flight(joined: Bus, scenario: Scenario, reason_for: ReasonFor, stop: threading.Event) -> None:
    """Be a world in flight, and an onboard half that answers the n-th packet of a wish with a reason, or not."""
    inbox = Inbox(joined, ["goal"], flight_of(scenario, SESSION))
    heard, hello = 0, Hello("world", scenario_digest(scenario), SESSION)
    while not stop.is_set():
        say_hello(joined, hello)
        for arrival in inbox.poll(10):
            goal = arrival.packet.value
            if goal.role == "user":
                heard += 1
                if (reason := reason_for(goal, heard)) is not None:
                    joined.publish(CHANNELS["goal"], encode_goal(answer_to(goal, reason)))


@contextlib.contextmanager
def flying(bus: str, reason_for: ReasonFor) -> Iterator[None]:
    joined, stop, scenario = open_bus(bus), threading.Event(), load_scenario("imu_uwb", SETTINGS)
    with ThreadPoolExecutor(1) as pool:
        flight = pool.submit(play_flight, joined, scenario, reason_for, stop)
        try:
            yield
        finally:
            stop.set()
            flight.result(HANGS)


def ask(bus: str, reason_for: ReasonFor, wait: float = HANGS, seed: int | None = None) -> None:
    with flying(bus, reason_for):
        ask_goal(bus, load_scenario("imu_uwb", SETTINGS, seed), 1.0, 2.0, wait)


def test_a_goal_is_taken_although_two_packets_are_lost(bus: str) -> None:
    heard: list[Goal] = []

    def answer_third(goal: Goal, n: int) -> str | None:
        heard.append(goal)
        return "" if n >= 3 else None

    ask(bus, answer_third)
    assert set(heard) == {heard[0]}
    assert (heard[0].x, heard[0].y) == (1.0, 2.0)


def test_every_refusal_is_one_line(bus: str, other_bus: str) -> None:
    with pytest.raises(InputError, match=r"^goal \(1, 2\): in an obstacle$"):
        ask(bus, lambda goal, n: "in an obstacle")
    with pytest.raises(InputError, match=r"^goal \(1, 2\): no answer in 1 s$"):
        ask(bus, lambda goal, n: None, wait=1.0)
    with pytest.raises(InputError, match=r"^world: flies another scenario \(.*seed included$"):
        ask(bus, lambda goal, n: "", seed=77)
    with pytest.raises(InputError, match=r"^world: not heard in 0.2 s; start it with: ortilo hil world$"):
        ask_goal(other_bus, load_scenario("imu_uwb", SETTINGS), 1.0, 2.0, 0.2)


def test_the_command_takes_numbers_below_zero(bus: str) -> None:
    heard: list[Goal] = []

    def answer(goal: Goal, n: int) -> str:
        heard.append(goal)
        return "no way" if goal.x > 0.0 else ""

    options = [part for setting in SETTINGS for part in ("--set", setting)] + ["--url", bus]
    with flying(bus, answer):
        done = CliRunner().invoke(hil_app, ["goal", "-1.5", "-2e-1", "imu_uwb", *options])
        refused = CliRunner().invoke(hil_app, ["goal", "1", "-2", "imu_uwb", *options])
    assert (done.exit_code, done.output) == (0, "goal (-1.5, -0.2): flies there\n")
    assert {(goal.x, goal.y) for goal in heard} == {(-1.5, -0.2), (1.0, -2.0)}
    assert str(refused.exception) == "goal (1, -2): no way"


def test_a_flight_in_lockstep_refuses_and_goes_on(bus: str) -> None:
    scenario, joined = load_scenario("imu_uwb", SETTINGS), open_bus(bus)
    inbox, answers, refused = Inbox(joined, ["hello", "goal"]), [], threading.Event()
    with answering(scenario, bus) as answered, ThreadPoolExecutor(1) as pool:
        world = pool.submit(run_world, scenario, bus, True, HANGS, record=lambda *tick: refused.wait(HANGS))
        session = hear_hello(inbox).session
        inbox.begin(flight_of(scenario, session))
        link = GoalLink(joined, session)
        link.ask(1.0, 2.0)
        while not answers:
            heard = [arrival.packet.value for arrival in inbox.poll(10) if arrival.packet.name == "goal"]
            answers += filter(None, [link.turn(heard)])
        refused.set()
        flight, _ = world.result(HANGS)
        assert answered.result(HANGS) == flight.sizes["tick"]
    assert [goal.reason for goal in answers] == [LOCKSTEP_REFUSAL]
    xr.testing.assert_equal(flight, fly(scenario))
