"""A user's request of a goal over the bus, repeated until the onboard half answers, because a relay may lose packets.

The onboard half flies to the goal at the height at which it comes to rest, or refuses with one line; see goals.py. Each
request has a number, which tells answers apart and shows the onboard half that a request is repeated.
"""

import time
from collections.abc import Iterable
from typing import Final

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.handshake import draw, find_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.limits import FARTHEST
from ortilo_drake.hil.wire.packets import Goal, Outbox, publish_goal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

LOCKSTEP_REFUSAL: Final = "the flight is in lockstep: goals need real time"
EVERY: Final = 0.2  # time between two repetitions of a request [s]
ANSWER_WAIT: Final = 5.0  # a request is given up after this time [s]
_POLL_MS: Final = 50


def goal_text(goal: Goal) -> str:
    """Return the name of a goal for messages."""
    return f"goal ({goal.x:g}, {goal.y:g})"


def answer_to(request: Goal, reason: str = "") -> Goal:
    """Return the onboard half's answer to a request; an answer with a reason is a refusal."""
    return request._replace(role="onboard", reason=reason)


class GoalLink:
    """A link that sends one request at a time to a flight and receives the answer; no method blocks.

    The inbox must hear goals and know the flight's tick. A request without an answer is given up after `wait` [s].
    """

    def __init__(self, outbox: Outbox, inbox: Inbox, wait: float = ANSWER_WAIT):
        self._outbox, self._inbox, self._wait = outbox, inbox, wait
        self._request: Goal | None = None
        self._until = self._next = 0.0

    def ask(self, x: float, y: float) -> None:
        """Request a flight to (x, y) in W [m], which replaces an earlier request; InputError if out of range."""
        request = Goal(self._outbox.session, 0, draw(), "user", float(x), float(y))
        if not (abs(request.x) <= FARTHEST and abs(request.y) <= FARTHEST):  # False for NaN
            raise InputError(f"{goal_text(request)}: must be two finite numbers of at most {FARTHEST:g}")
        self._request, self._next = request, time.monotonic()
        self._until = self._next + self._wait

    def turn(self, heard: Iterable[Goal]) -> Goal | None:
        """Repeat the request if that is due; return its answer once, or a refusal if no answer came in time.

        `heard` are the goal packets of this flight received since the last call.
        """
        if self._request is None:
            return None
        now, request = time.monotonic(), self._request
        answers = [goal for goal in heard if (goal.role, goal.number) == ("onboard", request.number)]
        if not answers and now > self._until:
            answers = [answer_to(request, f"no answer in {self._wait:g} s")]
        if answers:
            self._request = None
            return answers[0]
        if now >= self._next:
            # Send the next tick: the answer repeats it, and an answer with a tick before we joined is refused as old.
            publish_goal(self._outbox, request._replace(tick=self._inbox.tick + 1))
            self._next = now + EVERY
        return None


def ask_goal(url: str, key: bytes, scenario: Scenario, x: float, y: float, wait: float = ANSWER_WAIT) -> None:
    """Request that a flight in real time, on a bus, goes to a goal (x, y) in W [m]; return once the goal is accepted.

    `scenario` and `key` are those of the halves. `wait` is the longest search for the world, and then the longest wait
    for an answer [s]. InputError if the bus does not work, if the world is not heard or flies another scenario, or if
    the goal is refused or not answered.
    """
    with Bus(url, key) as bus:
        inbox = Inbox(bus, ("hello", "goal"))
        flight = find_world(bus, inbox, scenario, wait).flight
        link = GoalLink(Outbox(bus, flight.session), inbox, wait)
        link.ask(x, y)
        answer = link.turn(())
        while answer is None:
            arrivals = inbox.poll(_POLL_MS)
            answer = link.turn([arrival.packet.value for arrival in arrivals if arrival.packet.name == "goal"])
    if answer.reason:
        raise InputError(f"{goal_text(answer)}: {answer.reason}")
