"""Asking the onboard half for a goal over the bus: again and again, for the wire may lose it, until it answers.

The onboard half flies there at the height at which it then is, or refuses with one line; see goals.py. A wish's number
tells the answers apart, and lets the onboard half know a repeated wish.
"""

import time
from collections.abc import Iterable
from typing import Final

from ortilo_drake.hil.wire.bus import open_bus
from ortilo_drake.hil.wire.handshake import draw, find_world
from ortilo_drake.hil.wire.inbox import Inbox
from ortilo_drake.hil.wire.limits import FARTHEST
from ortilo_drake.hil.wire.packets import Goal
from ortilo_drake.hil.wire.wire import Outbox, publish_goal
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

LOCKSTEP_REFUSAL: Final = "flies in lockstep, which takes no goals"
EVERY: Final = 0.2  # after which a wish is repeated [s]
ANSWER_WAIT: Final = 5.0  # after which it is given up [s]
_POLL_MS: Final = 50


def goal_text(goal: Goal) -> str:
    """Return how a message names a goal."""
    return f"goal ({goal.x:g}, {goal.y:g})"


def answer_to(wish: Goal, reason: str = "") -> Goal:
    """Return the onboard half's answer to a wish; a reason refuses it."""
    return wish._replace(role="onboard", reason=reason)


class GoalLink:
    """Sends one wish at a time and hears its answer, and never waits.

    Args:
        outbox: to the flight.
        inbox: hears goals, and the flight's tick.
        wait: after how long without an answer a wish is given up [s].
    """

    def __init__(self, outbox: Outbox, inbox: Inbox, wait: float = ANSWER_WAIT):
        self._outbox, self._inbox, self._wait = outbox, inbox, wait
        self._wish: Goal | None = None
        self._until = self._next = 0.0

    def ask(self, x: float, y: float) -> None:
        """Wish to fly to (x, y) in W [m], instead of what was wished for before; InputError if that is no place."""
        wish = Goal(self._outbox.session, 0, draw(), "user", float(x), float(y))
        if not (abs(wish.x) <= FARTHEST and abs(wish.y) <= FARTHEST):  # False for NaN
            raise InputError(f"{goal_text(wish)}: must be two finite numbers of at most {FARTHEST:g}")
        self._wish, self._next = wish, time.monotonic()
        self._until = self._next + self._wait

    def turn(self, heard: Iterable[Goal]) -> Goal | None:
        """Repeat the wish if it is time to; return its answer, once: heard, or that none came.

        Args:
            heard: the goals of this flight that came since the last call, our own among them.
        """
        if self._wish is None:
            return None
        now, wish = time.monotonic(), self._wish
        answers = [goal for goal in heard if (goal.role, goal.number) == ("onboard", wish.number)]
        if not answers and now > self._until:
            answers = [answer_to(wish, f"no answer in {self._wait:g} s")]
        if answers:
            self._wish = None
            return answers[0]
        if now >= self._next:
            # Of the tick to come: the answer has the same, and one from before we joined would be refused as old.
            publish_goal(self._outbox, wish._replace(tick=self._inbox.tick + 1))
            self._next = now + EVERY
        return None


def ask_goal(url: str, key: bytes, scenario: Scenario, x: float, y: float, wait: float = ANSWER_WAIT) -> None:
    """Have a flight in real time go to a goal; return once the onboard half is on its way.

    Args:
        url: the bus, see bus.open_bus.
        key: that the halves share, see key_file.py.
        scenario: what is flown, the same as the halves'.
        x: east [m], in W.
        y: north [m], in W.
        wait: how long to look for the world, and then for an answer [s].

    Raises:
        InputError: if the bus does not work, the world is not heard or flies another scenario, or the goal is refused
            or not answered.
    """
    with open_bus(url) as bus:
        inbox = Inbox(bus, ("hello", "goal"), key)
        flight = find_world(bus, inbox, scenario, key, wait).flight
        link = GoalLink(Outbox(bus, flight.session, flight.key), inbox, wait)
        link.ask(x, y)
        answer = link.turn(())
        while answer is None:
            arrivals = inbox.poll(_POLL_MS)
            answer = link.turn([arrival.packet.value for arrival in arrivals if arrival.packet.name == "goal"])
    if answer.reason:
        raise InputError(f"{goal_text(answer)}: {answer.reason}")
