"""A live flight from its first tick until the user stops it."""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from ortilo_drake.hil.goals.goals import GoalPlanner
from ortilo_drake.hil.live.live_flight import LiveFlight, ShownTick, Wishes
from ortilo_drake.hil.live.scene import Scene
from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import Scenario

DRAWN_EVERY: Final = 1.0 / 15.0  # least period of drawing the page [s of wall time]
RECENT: Final = 5.0  # window over which shares of arrivals are counted [s]
_REST: Final = 0.02  # time between two reads of the controls while the flight stands still, or checks for a page [s]


@dataclass
class Status:
    """The status of a live flight at its last tick."""

    time: float = 0.0
    """time of the last tick [s]."""
    error: float = 0.0
    """distance between estimated and true position [m]."""
    sd: float = 0.0
    """three standard deviations of the position: 3 sqrt(trace of its covariance) [m]."""
    by_axis: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)] * 3)
    """error and three standard deviations in x, y and z [m]."""
    lit: dict[str, bool] = field(default_factory=dict)
    """whether each sensor's lamp is lit; empty without a scene."""
    arrivals: dict[str, float | None] = field(default_factory=dict)
    """share of each sensor's due messages that arrived in the last RECENT seconds [1]; None before the first tick."""
    is_paused: bool = False
    """whether the flight is paused."""
    is_lost: bool = False
    """whether the flight is lost, see flight/lost.py."""
    note: str = ""
    """the last event, such as an answer to a goal; empty before any event."""
    scenario: str = ""
    """name of the scenario."""

    def json(self) -> bytes:
        """Return the status as JSON for the page beside Meshcat's view; null for values that are not finite."""
        return json.dumps(as_data(self)).encode()

    def line(self) -> str:
        """Return the status in a line of text."""
        shares = (f"{name} {'-' if share is None else f'{share:.0%}'}" for name, share in self.arrivals.items())
        line = f"{self.time:6.1f} s  error {100.0 * self.error:5.1f} cm, 3 sigma {100.0 * self.sd:5.1f} cm"
        line += f"  arrived lately: {', '.join(shares) or '-'}"
        return line + ("  paused" if self.is_paused else "") + (f"  {self.note}" if self.note else "")


class Shares:
    """The share of each sensor's due messages that arrived in the last `ticks` ticks.

    `due` gives each sensor's period in ticks. A message may arrive in a later tick than the one in which it is due.
    """

    def __init__(self, due: dict[str, int], ticks: int):
        self._due = due
        self._arrived = {sensor: deque[bool](maxlen=max(ticks // every, 1) * every) for sensor, every in due.items()}

    def count(self, seen: ShownTick) -> None:
        """Count the arrivals of a tick."""
        for sensor, its in self._arrived.items():
            its.append(sensor in seen.arrived)

    def now(self) -> dict[str, float | None]:
        """Return the shares [1] by sensor; None before the first tick."""
        due = {sensor: -(-len(its) // self._due[sensor]) for sensor, its in self._arrived.items()}
        return {s: min(sum(its) / due[s], 1.0) if its else None for s, its in self._arrived.items()}


def wait_for_page(pages: Callable[[], int], clock: Any = time) -> None:
    """Return once a page is open: a flight that began earlier might end, or be lost, unseen.

    `pages` returns the number of open pages, as Meshcat.GetNumActiveConnections does; the clock is as in fly_live.
    """
    while not pages():
        clock.sleep(_REST)


def fly_live(
    scenario: Scenario,
    planner: GoalPlanner,
    says: Callable[[], Wishes],
    scene: Scene | None,
    show: Callable[[Status], None],
    clock: Any = time,
) -> Status:
    """Fly until the user asks to end; return the last status.

    A lost flight stands still until the user restarts it. `planner` plans paths to goals, `says` returns the user's
    present wishes, and `scene`, if there is one, shows the flight. `show` is called at intervals with the status.
    `clock` has monotonic() and sleep().
    """
    due: dict[str, int] = {sensor: scenario.every(sensor) for sensor in scenario.sensors}
    status, drawn_at, begins = Status(scenario=scenario.name), -np.inf, True
    while True:
        wishes = says()
        if wishes.ends:
            return status
        if begins or wishes.restarts:
            flight, shares, begins = LiveFlight(scenario, planner), Shares(due, round(RECENT / scenario.h)), False
            status, next_at = Status(scenario=scenario.name), clock.monotonic()
            if scene:
                scene.begin(flight.path)
        status.is_paused = wishes.pauses and not status.is_lost
        if status.is_lost or (wishes.pauses and not wishes.steps):
            if scene:
                scene.show_goal(*wishes.goal, 0.3)
            show(status)
            clock.sleep(_REST)
            next_at = clock.monotonic()
            continue
        for _ in range(max(wishes.steps, 1) if wishes.pauses else 1):
            seen = flight.step(wishes)
            wishes = wishes._replace(goes=False)
            shares.count(seen)
            status.is_lost = seen.lost is not None
        now = clock.monotonic()
        draws = now - drawn_at >= DRAWN_EVERY or wishes.pauses or status.is_lost
        drawn_at = now if draws else drawn_at
        status.time, status.arrivals = seen.time, shares.now()
        errors, sds = seen.xhat[:3] - seen.x[:3], 3.0 * np.sqrt(np.diag(seen.P)[:3])
        status.error, status.sd = float(np.linalg.norm(errors)), float(np.linalg.norm(sds))
        status.by_axis = list(zip(errors.tolist(), sds.tolist(), strict=True))
        status.note = seen.answers[-1] if seen.answers else status.note
        if seen.lost:
            status.note = f"lost at {seen.lost.time:.1f} s: {seen.lost.cause}"
        if scene:
            scene.show(seen, draws)
            status.lit = scene.lit()
            scene.show_goal(*wishes.goal, float(seen.x[2]))
        if draws:
            show(status)
        # A flight that falls behind, for example with a slow renderer, does not hurry afterwards.
        next_at = max(next_at + scenario.h / wishes.speed, now - 0.1)
        clock.sleep(max(next_at - clock.monotonic(), 0.0))
