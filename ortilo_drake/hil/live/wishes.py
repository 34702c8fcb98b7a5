"""The wishes of the user of a live flight at a tick."""

from typing import NamedTuple


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
