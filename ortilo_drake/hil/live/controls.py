"""The sliders and buttons of a live flight, on Meshcat's page."""

import numpy as np
from pydrake.geometry import Meshcat

from ortilo_drake.hil.live.live_flight import Wishes
from ortilo_drake.model.room import Room
from ortilo_drake.sensors.described import unwired
from ortilo_drake.views.guarded.panel import Panel

LOST = "{} lost [%]"
PUSH = ("push to the east [N]", "push to the north [N]")
HEAVIER = "heavier [%]"
SPEED = "speed"
GOAL = ("goal east [m]", "goal north [m]")
GO, PAUSE, STEP, RESTART, STOP = "fly to the goal", "pause", "one tick", "fly anew", "stop"
SLOWEST, FASTEST = 0.1, 5.0
STRONGEST_PUSH = 2.0  # [N]
MOST_HEAVIER = 30.0  # [%]
MOST_STEPS = 10  # most single ticks between two calls of wishes; nobody clicks faster


class Controls:
    """The controls on the page, with the values that the user set and the clicks.

    Meshcat shows the sliders and buttons on its pages; the panel has the inputs of the pages' users. `goal` is x, y of
    the first goal [m]; goals are within the room. The messages of each of `sensors` that sends by radio can be lost.
    """

    def __init__(self, meshcat: Meshcat, panel: Panel, room: Room, sensors: tuple[str, ...], goal: tuple[float, float]):
        self._meshcat, self._panel = meshcat, panel
        self._sensors = unwired(sensors)
        self._shown: dict[str, float] = {}
        self._seen: dict[str, float] = {}
        for sensor in self._sensors:
            self._add_slider(LOST.format(sensor), 0.0, 100.0, 1.0, 0.0)
        for name in PUSH:
            self._add_slider(name, -STRONGEST_PUSH, STRONGEST_PUSH, 0.05, 0.0)
        self._add_slider(HEAVIER, -MOST_HEAVIER, MOST_HEAVIER, 0.5, 0.0)
        self._add_slider(SPEED, SLOWEST, FASTEST, 0.1, 1.0)
        low, high = room.interior.min, room.interior.max
        for name, least, most, first in zip(GOAL, low, high, goal, strict=False):
            self._add_slider(name, float(least), float(most), 0.05, float(np.clip(first, least, most)))
        for name, key in ((GO, "KeyG"), (PAUSE, "KeyP"), (STEP, "KeyN"), (RESTART, "KeyR"), (STOP, "Escape")):
            meshcat.AddButton(name, key)
            panel.add_button(name)
        self._clicks = dict.fromkeys((GO, PAUSE, STEP, RESTART, STOP), 0)

    def wishes(self) -> Wishes:
        """Return the present wishes: the values of the sliders, and the buttons clicked since the last call."""
        self._show_settled()
        value, clicked = self._seen.__getitem__, {name: self._new_clicks(name) for name in self._clicks}
        return Wishes(
            lost={sensor: value(LOST.format(sensor)) / 100.0 for sensor in self._sensors},
            push=(value(PUSH[0]), value(PUSH[1])),
            heavier=value(HEAVIER) / 100.0,
            speed=value(SPEED),
            goal=(value(GOAL[0]), value(GOAL[1])),
            goes=clicked[GO] > 0,
            pauses=self._clicks[PAUSE] % 2 == 1,
            steps=min(clicked[STEP], MOST_STEPS),
            restarts=clicked[RESTART] > 0,
            ends=clicked[STOP] > 0,
        )

    def _add_slider(self, name: str, least: float, most: float, step: float, first: float) -> None:
        self._meshcat.AddSlider(name, least, most, step, first)
        self._panel.add_slider(name, least, most, first)
        self._shown[name] = self._seen[name] = first

    def _show_settled(self) -> None:
        """Tell Meshcat the values of sliders that came to rest, for pages that are opened later.

        Meshcat updates all pages at once: an earlier update would pull back a slider that is still being dragged.
        """
        before, self._seen = self._seen, {name: self._panel.value(name) for name in self._shown}
        for name, value in self._seen.items():
            if value == before[name] and value != self._shown[name]:
                self._meshcat.SetSliderValue(name, value)
                self._shown[name] = value

    def _new_clicks(self, name: str) -> int:
        before, self._clicks[name] = self._clicks[name], self._panel.clicks(name)
        return self._clicks[name] - before
