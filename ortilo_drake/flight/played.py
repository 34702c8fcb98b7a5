"""A scenario's flights, played from its wiring by compiled code."""

from functools import cached_property

import numpy as np

from ortilo_drake.diagrams.wiring.truth import drawn_values, normals_at_start
from ortilo_drake.diagrams.wiring.whole import boxes_of, signals_of
from ortilo_drake.flight.figures import TRACE_SIZE
from ortilo_drake.flight.figures_element import figures_box
from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.flight.lost import bounds_of
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.drawn_truth import AtStart

_LOGGED = ("state", "control", "y", "delta", "V2", "belief", "reference")  # as Measurement.logged_sizes has them


class Played:
    """Flights of a scenario all of whose boxes are elements.

    Args:
        scenario: the scenario.

    Attributes:
        ticks: of a flight, but for the first.

    Raises:
        InputError: if the scenario cannot be flown, see check_flyable.
    """

    def __init__(self, scenario: Scenario):
        self._scenario, self._room, self.ticks = scenario, scenario.load_room(), check_flyable(scenario)
        boxes = boxes_of(scenario, self.ticks)
        self._signals = signals_of(boxes)
        figures = figures_box(bounds_of(self._room, scenario.vehicle))
        figures = figures.with_inputs(**{name: self._signals[name] for name in ("state", "belief", "reference")})
        self.wiring = Wiring([*boxes, figures])
        self._player = Player(self.wiring, ("figures", self._signals["delta"]), "figures")
        self._sensors = scenario.measurement.sizes["delta"]

    @property
    def text(self) -> str:
        """The generated source of a flight without a log."""
        return self._player.text

    @cached_property
    def _logger(self) -> Player:
        names = ("delta", *_LOGGED)
        player = Player(self.wiring, ("figures", *(self._signals[name] for name in names)), "figures")
        player.fly(np.zeros(1, dtype=np.int64), np.empty((1, player.width)))  # compiles
        return player

    def compile_logged(self) -> None:
        """Compile all that flies with a log, so that compiling does not count as flying time."""
        _ = self._logger

    def fly(
        self, seeds: np.ndarray, draw: AtStart, trace: np.ndarray, arrived: np.ndarray, log: np.ndarray
    ) -> tuple[int, int]:
        """Fly once and write the figures; return the last tick and the cause of the loss, see lost.CAUSES.

        Args:
            seeds: of all noise, at each tick (ticks + 1): one and the same for a flight of a seed, another from some
                tick on for one that branches off it.
            draw: what is drawn at the start.
            trace: a row for each tick, see figures.py (ticks + 1, TRACE_SIZE).
            arrived: in how many ticks each sensor's value reached the filter (s).
            log: a row for each tick, see Measurement.logged_sizes (ticks + 1, w); (0, w) for none.
        """
        player = self._logger if log.shape[0] else self._player
        rows = np.empty((self.ticks + 1, player.width))
        last = player.fly(seeds, rows, drawn_values(self.wiring, self._scenario, self._room, draw))
        flown, logged = rows[: last + 1], TRACE_SIZE + 1 + self._sensors
        trace[: last + 1] = flown[:, :TRACE_SIZE]
        arrived[:] = np.sum(flown[:, TRACE_SIZE + 1 : logged], axis=0)
        if log.shape[0]:
            log[: last + 1] = flown[:, logged:]
        return last, int(rows[last, TRACE_SIZE])

    def normals_at_start(self) -> dict[str, int]:
        """Return the number of standard normal numbers that each stream draws at the start, by its name."""
        return normals_at_start(self.wiring, self._scenario, self._room)
