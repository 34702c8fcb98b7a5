"""The lines of a live bridge about its filter: that the filter began or was lost, and what contradicts the map."""

from collections.abc import Callable
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.studies.live.anchor_bank import wrong_anchors_text
from ortilo_drake.studies.live.contradictions import lasting_cause
from ortilo_drake.studies.live.live_filter import LiveFilter
from ortilo_drake.studies.recorded.moved_anchors import names_of

Say = Callable[[str], None]
PUZZLED: Final = (  # if no cause that is tried explains the disagreement
    "no one cause explains them: no two anchors exchanged, no heading, mirrored room or larger noise. Are several "
    "anchors wrong, or stamps, scale or axes? `ortilo replay` of a recording tries more"
)
LASTS: Final = 3.0  # ranges must contradict the estimate for so long: after a landing all ranges do for a while [s]
SELDOM: Final = 30.0  # least time between two lines about a lost filter [s]


class LiveWarnings:
    """The lines about a filter by a map, each said once while it holds; `note` takes the lines about no trouble.

    Once a lasting cause is named, its consequences are not said: wrong rates turn the heading too.
    """

    def __init__(self, map_: Map, say: Say, note: Say | None = None):
        self._map, self._say, self._note = map_, say, note or say
        self._begun = self._disagrees = self._turned = self._wrong = self._unit = self._rates = False
        self._noisy = self._mirrored = self._puzzled = False
        self._lost, self._told, self._fit_at = 0, -np.inf, np.inf

    def look_at(self, filter_: LiveFilter) -> None:
        """Say what has changed since the last call."""
        if filter_.begun and not self._begun:
            self._begun = True
            self._note(f"the filter has begun, by the ranges from {filter_.begins_at:.1f} s after the first on")
            for doubt in filter(None, (filter_.start_doubt, filter_.mirror)):
                self._say(f"warning  {doubt}")
        if filter_.force_doubt and not self._unit:
            self._unit = True
            self._say(f"warning  {filter_.force_doubt}")
        rates, watch = filter_.rates, filter_.heading
        if rates is not None and rates.doubt and not (self._rates or self._mirrored):
            self._rates = True
            self._say(f"warning  {rates.doubt}")
        self._say_lost(filter_.lost, filter_.due)
        self._say_noise(filter_)
        doubt = filter_.agreement.doubt(filter_.gate, filter_.places.widened)
        known = bool(lasting_cause(rates, watch, filter_.places))
        if bool(doubt) != self._disagrees and not known:
            self._disagrees = bool(doubt)
            if doubt:
                self._say(f"warning  ranges: {doubt}: {self._cause(filter_)}")
            else:
                self._note("ranges: agree with the estimate again")
        if not filter_.agreement.is_unfit(False, filter_.gate):
            self._fit_at = filter_.due
        known |= filter_.places.suspected or filter_.places.scatter is not None
        if filter_.due - self._fit_at > LASTS and filter_.places.judges and not (known or self._puzzled):
            self._puzzled = True
            self._say(f"warning  ranges: {PUZZLED}")
        heading, mirror = (None, None) if watch is None else (watch.doubt, watch.mirror)
        if heading is not None and not (self._turned or self._rates):
            self._turned = True
            self._say(f"warning  heading: {heading.text()}")
        if mirror is not None and not (self._mirrored or (rates is not None and rates.mirrors)):
            self._mirrored = True
            self._say(f"warning  {mirror.text()}")
        wrong = filter_.places.wrong
        if wrong is not None and not self._wrong:
            self._wrong = True
            self._say(f"warning  {wrong_anchors_text(wrong, names_of(self._map, len(filter_.anchors.figures())))}")

    def _say_noise(self, filter_: LiveFilter) -> None:
        """Say once that ranges scatter more than the map says, and which key of the map mends this."""
        places = filter_.places
        if places.scatter is None or self._noisy:
            return
        self._noisy = True
        sd = f"{np.ceil(100.0 * places.scatter) / 100.0:.2f}"
        key = f"range_white: {sd}, range_correlated: {sd}"  # both: in real rooms such errors last
        if self._map.imu is None:
            key = f"baseline_range: {places.scatter:.2f}"
        told = f"a range scatters by {places.scatter:.2f} m, the map says {places.stated:.2f} m"
        self._say(f"warning  noise: {told}: `filter: {{{key}}}` would fit; until then estimates go out less sure")

    def _cause(self, filter_: LiveFilter) -> str:
        alone = filter_.agreement.alone()
        if alone is None:
            return "a wrong heading, place of an anchor, axis or noise?"
        name = names_of(self._map, len(filter_.anchors.figures()))[alone]
        return f"anchor {name} alone: is a wall, the body or a person in its way, or is it in another place?"

    def _say_lost(self, lost: int, t: float) -> None:
        if lost > self._lost and t - self._told > SELDOM:
            times = "" if lost - self._lost == 1 else f" ({lost - self._lost} times in {min(t - self._told, t):.0f} s)"
            self._say(f"the filter was lost, and starts anew from the ranges{times}")
            self._lost, self._told = lost, t
