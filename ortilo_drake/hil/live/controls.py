"""The sliders and buttons of a live flight, in Meshcat's page."""

from pydrake.geometry import Meshcat

from ortilo_drake.hil.live.wishes import Wishes
from ortilo_drake.model.room import Room

LOST = "{} lost [%]"
PUSH = ("push to the east [N]", "push to the north [N]")
HEAVIER = "heavier [%]"
SPEED = "speed"
GOAL = ("goal east [m]", "goal north [m]")
GO, PAUSE, STEP, RESTART, STOP = "fly to the goal", "pause", "one tick", "fly anew", "stop"
SLOWEST, FASTEST = 0.1, 5.0
STRONGEST_PUSH = 2.0  # [N]
MOST_HEAVIER = 30.0  # [%]


class Controls:
    """What the user of a page wants.

    Args:
        meshcat: whose page it is.
        room: whose floor the goals are on.
        sensors: that fly; each but the imu can lose its messages.
        goal: x, y of the first goal shown [m].
    """

    def __init__(self, meshcat: Meshcat, room: Room, sensors: tuple[str, ...], goal: tuple[float, float]):
        self._meshcat = meshcat
        self._sensors = tuple(sensor for sensor in sensors if sensor != "imu")
        for sensor in self._sensors:
            meshcat.AddSlider(LOST.format(sensor), 0.0, 100.0, 1.0, 0.0)
        for name in PUSH:
            meshcat.AddSlider(name, -STRONGEST_PUSH, STRONGEST_PUSH, 0.05, 0.0)
        meshcat.AddSlider(HEAVIER, -MOST_HEAVIER, MOST_HEAVIER, 0.5, 0.0)
        meshcat.AddSlider(SPEED, SLOWEST, FASTEST, 0.1, 1.0)
        low, high = room.interior.min, room.interior.max
        for name, least, most, first in zip(GOAL, low, high, goal, strict=False):
            meshcat.AddSlider(name, least, most, 0.05, first)
        for name, key in ((GO, "KeyG"), (PAUSE, "KeyP"), (STEP, "KeyN"), (RESTART, "KeyR"), (STOP, "Escape")):
            meshcat.AddButton(name, key)
        self._clicks = dict.fromkeys((GO, PAUSE, STEP, RESTART, STOP), 0)

    def wishes(self) -> Wishes:
        """Return what is wanted now; of buttons, what was clicked since the last call."""
        value, clicked = self._meshcat.GetSliderValue, {name: self._new_clicks(name) for name in self._clicks}
        return Wishes(
            lost={sensor: value(LOST.format(sensor)) / 100.0 for sensor in self._sensors},
            push=(value(PUSH[0]), value(PUSH[1])),
            heavier=value(HEAVIER) / 100.0,
            speed=value(SPEED),
            goal=(value(GOAL[0]), value(GOAL[1])),
            goes=clicked[GO] > 0,
            pauses=self._clicks[PAUSE] % 2 == 1,
            steps=clicked[STEP],
            restarts=clicked[RESTART] > 0,
            ends=clicked[STOP] > 0,
        )

    def _new_clicks(self, name: str) -> int:
        before, self._clicks[name] = self._clicks[name], self._meshcat.GetButtonClicks(name)
        return self._clicks[name] - before
