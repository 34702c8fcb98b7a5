"""The wishes of the user of a live flight at a tick."""

from typing import NamedTuple


class Wishes(NamedTuple):
    """The values of the controls.

    Attributes:
        lost: share of each sensor's messages that is lost, beside what the scenario's link loses [1].
        push: a steady force in W along x and y, beside the scenario's own [N].
        heavier: true over believed mass, less 1, beside the scenario's own [1].
        speed: simulated over real time.
        goal: x, y of the goal that the marker shows [m].
        goes: a new goal: the vehicle is to fly there.
        pauses: time stands still.
        steps: ticks to fly nevertheless.
        restarts: the flight is to begin anew.
        ends: nothing more is wanted.
    """

    lost: dict[str, float] = {}  # noqa: RUF012 - never changed
    push: tuple[float, float] = (0.0, 0.0)
    heavier: float = 0.0
    speed: float = 1.0
    goal: tuple[float, float] = (0.0, 0.0)
    goes: bool = False
    pauses: bool = False
    steps: int = 0
    restarts: bool = False
    ends: bool = False
