"""What a live bridge says of its filter, a line each: that it began or was lost, and what contradicts the map."""

from collections.abc import Callable
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.studies.live.anchor_bank import wrong_anchors_text
from ortilo_drake.studies.live.live_filter import LiveFilter
from ortilo_drake.studies.recorded.moved_anchors import names_of

Say = Callable[[str], None]
SELDOM: Final = 30.0  # a filter that is lost again and again is told of so often [s]


class LiveWarnings:
    """The lines about a filter by a map, each once for as long as it holds; note takes those of no trouble."""

    def __init__(self, map_: Map, say: Say, note: Say | None = None):
        self._map, self._say, self._note = map_, say, note or say
        self._begun = self._disagrees = self._turned = self._wrong = self._unit = self._rates = False
        self._lost, self._told = 0, -np.inf

    def look_at(self, filter_: LiveFilter) -> None:
        """Say what has changed."""
        if filter_.begun and not self._begun:
            self._begun = True
            self._note(f"the filter has begun, by the ranges from {filter_.begins_at:.1f} s after the first on")
            for doubt in filter(None, (filter_.start_doubt, filter_.mirror)):
                self._say(f"warning  {doubt}")
        if filter_.force_doubt and not self._unit:
            self._unit = True
            self._say(f"warning  {filter_.force_doubt}")
        if filter_.rates is not None and filter_.rates.doubt and not self._rates:
            self._rates = True
            self._say(f"warning  {filter_.rates.doubt}")
        self._say_lost(filter_.lost, filter_.due)
        doubt = filter_.agreement.doubt()
        if bool(doubt) != self._disagrees:
            self._disagrees = bool(doubt)
            cause = "a wrong heading, place of an anchor, axis or noise?"
            if doubt:
                self._say(f"warning  ranges: {doubt}: {cause}")
            else:
                self._note("ranges: agree with the estimate again")
        heading, wrong = None if filter_.heading is None else filter_.heading.doubt, filter_.places.wrong
        if heading is not None and not self._turned:
            self._turned = True
            self._say(f"warning  heading: {heading.text()}")
        if wrong is not None and not self._wrong:
            self._wrong = True
            self._say(f"warning  {wrong_anchors_text(wrong, names_of(self._map, len(filter_.anchors.figures())))}")

    def _say_lost(self, lost: int, t: float) -> None:
        if lost > self._lost and t - self._told > SELDOM:
            times = "" if lost - self._lost == 1 else f" ({lost - self._lost} times in {min(t - self._told, t):.0f} s)"
            self._say(f"the filter was lost, and starts anew from the ranges{times}")
            self._lost, self._told = lost, t
