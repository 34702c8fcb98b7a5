"""A flight whose user changes the world while the flight lasts, tick by tick.

The two halves are those of flight/stepped_halves.py. The user changes only the world: losses of messages, a force that
pushes, the mass. The onboard half learns of the changes as in reality, from its sensors. Only goals go to the onboard
half itself (hil/goals/goals.py).
"""

from typing import NamedTuple

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from ortilo_drake.flight.lost import Lost, find_loss
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.goals.goals import GoalPlanner, Goals
from ortilo_drake.hil.wire.packets import Goal
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ForceTruth
from ortilo_drake.sensors.described import measuring

MESSAGES = {measuring("landmarks"): ("detections", "shutter", "image")}  # other sensors' ports have the sensor's name


class Wishes(NamedTuple):
    """The values of the controls at a tick."""

    lost: dict[str, float] = {}  # noqa: RUF012 - never changed
    """share of each sensor's messages that is lost, in addition to the losses of the scenario's link [1]."""
    push: tuple[float, float] = (0.0, 0.0)
    """steady force in W along x and y, in addition to the scenario's own [N]."""
    heavier: float = 0.0
    """relative increase of the true mass, in addition to the scenario's own [1]."""
    speed: float = 1.0
    """simulated over real time [1]."""
    goal: tuple[float, float] = (0.0, 0.0)
    """x, y in W of the goal that the marker shows [m]."""
    goes: bool = False
    """whether the vehicle is to fly to `goal`, as a new goal."""
    pauses: bool = False
    """whether the flight is paused."""
    steps: int = 0
    """number of ticks to fly although the flight is paused."""
    restarts: bool = False
    """whether the flight is to start again."""
    ends: bool = False
    """whether the session is to end."""


class ShownTick(NamedTuple):
    """The state of a live flight at a tick, as shown to the user."""

    time: float
    """time of the tick [s]."""
    x: np.ndarray
    """the true state x (12)."""
    xhat: np.ndarray
    """the estimate xhat (15)."""
    P: np.ndarray
    """covariance of the estimate (15, 15)."""
    arrived: tuple[str, ...]
    """sensors whose message the filter used."""
    sent: tuple[str, ...]
    """sensors that sent a message."""
    path: PiecewisePolynomial | None
    """a new path that the vehicle flies from now on; None if the path stays the same."""
    answers: tuple[str, ...]
    """answers to goals, a line each."""
    lost: Lost | None
    """the loss of the flight, which then goes no further; None if it is not lost."""


def with_a_force(scenario: Scenario) -> Scenario:
    """Return the scenario with a force model in its world; the force is 0 N where the scenario has none."""
    if scenario.truth.force != ForceTruth():
        return scenario
    force = ForceTruth(gust_time=2.0 * ForceTruth().gust_time)  # not the default, so the world has a force; its sd is 0
    return scenario.model_copy(update={"truth": scenario.truth.model_copy(update={"force": force})})


class LiveFlight:
    """One flight of a scenario that lasts as long as it is stepped.

    `planner` plans paths to goals; the caller enters and leaves its context.
    """

    def __init__(self, scenario: Scenario, planner: GoalPlanner):
        self._scenario, self._room = with_a_force(scenario), scenario.load_room()
        self._world, self._onboard = WorldHalf(self._scenario), OnboardHalf(self._scenario)
        self._goals, self._asked = Goals(scenario, planner), 0
        self._rng = np.random.default_rng(scenario.seed)
        self._k, self._set = 0, (0.0, 0.0, 0.0)

    @property
    def path(self) -> Trajectory | None:
        """The path that the vehicle flies, p_WB(t) (3 rows) [m]; None where the planner is a System."""
        return self._onboard.path

    def step(self, wishes: Wishes) -> ShownTick:
        """Fly one tick and return its state.

        Losses, push and mass of the wishes apply to this tick; a goal is taken if `goes` is True.
        """
        self._change_the_world(wishes)
        time = self._k * self._scenario.h
        if wishes.goes:
            self._asked += 1
            self._goals.receive(Goal(0, self._k, self._asked, "user", *wishes.goal))
        said = self._goals.step(time, self._onboard.path)
        if said.path is not None:
            self._onboard.fly_path(said.path)
        x, messages = self._world.state, self._world.sample()
        sensors = self._scenario.measurement.sensors
        names: dict[str, tuple[str, ...]] = {
            sensor: MESSAGES.get(sensor, (sensor,)) for sensor in self._scenario.sensors
        }
        sent = tuple(sensor for sensor in sensors if any(name in messages for name in names.get(sensor, ())))
        for sensor in sent:
            if self._rng.random() < wishes.lost.get(sensor, 0.0):
                for name in names[sensor]:
                    messages.pop(name, None)
        self._onboard.receive(messages)
        outputs = self._onboard.outputs()
        arrived = tuple(sensor for sensor, delta in zip(sensors, outputs["delta"], strict=False) if delta > 0.0)
        lost = find_loss(x[np.newaxis], self._scenario.h, self._room, self._scenario.vehicle, self._k)
        if lost is None:
            self._world.advance(outputs["control"])
            self._onboard.advance()
            self._k += 1
        answers = tuple(
            f"goal ({answer.x:g}, {answer.y:g}): {answer.reason or 'on the way'}" for answer in said.answers
        )
        P = outputs["covariance"].reshape(N_XBAR, N_XBAR)
        return ShownTick(time, x, outputs["estimate"], P, arrived, sent, said.path, answers, lost)

    def _change_the_world(self, wishes: Wishes) -> None:
        wanted = (*wishes.push, wishes.heavier)
        if wanted != self._set:
            self._world.change_body(wishes.heavier, np.array([*wishes.push, 0.0]))
            self._set = wanted
