"""The wishes of the user of a live flight at a tick."""

from typing import NamedTuple


class Wishes(NamedTuple):
    """The values of the controls at a tick."""

    lost: dict[str, float] = {}  # noqa: RUF012 - never changed
    """share of each sensor's messages that is lost, beside what the scenario's link loses [1]."""
    push: tuple[float, float] = (0.0, 0.0)
    """a steady force in W along x and y, beside the scenario's own [N]."""
    heavier: float = 0.0
    """true over believed mass, less 1, beside the scenario's own [1]."""
    speed: float = 1.0
    """simulated over real time."""
    goal: tuple[float, float] = (0.0, 0.0)
    """x, y of the goal that the marker shows [m]."""
    goes: bool = False
    """a new goal: the vehicle is to fly there."""
    pauses: bool = False
    """time stands still."""
    steps: int = 0
    """ticks to fly nevertheless."""
    restarts: bool = False
    """the flight is to begin anew."""
    ends: bool = False
    """nothing more is wanted."""
