"""The lines of a live bridge about its filter: that the filter began or was lost, and what contradicts the map."""

from collections.abc import Callable
from typing import Final

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.studies.live.anchor_bank import AnchorWatch, wrong_anchors_text
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
        self._said, self._disagrees = set[str](), False
        self._lost, self._told, self._fit_at = 0, -np.inf, np.inf

    def look_at(self, filter_: LiveFilter) -> None:
        """Say what has changed since the last call."""
        rates, watch, places = filter_.rates, filter_.heading, filter_.places
        if filter_.begun and "begun" not in self._said:
            self._said.add("begun")
            self._note(f"the filter has begun, by the ranges from {filter_.begins_at:.1f} s after the first on")
            for doubt in filter(None, (filter_.start_doubt, filter_.mirror)):
                self._say(f"warning  {doubt}")
        self._warn("force", filter_.force_doubt)
        self._warn("rates", "" if rates is None else rates.doubt, but_not_after="mirror")
        self._say_lost(filter_.lost, filter_.due)
        self._warn("noise", self._noise(places))
        doubt, known = filter_.agreement.doubt(filter_.gate, places.widened), bool(filter_.wrong)
        if bool(doubt) != self._disagrees and not known:
            self._disagrees = bool(doubt)
            if doubt:
                self._say(f"warning  ranges: {doubt}: {self._cause(filter_)}")
            else:
                self._note("ranges: agree with the estimate again")
        if not filter_.agreement.is_unfit(False, filter_.gate):
            self._fit_at = filter_.due
        known |= places.suspected or places.scatter is not None
        if filter_.due - self._fit_at > LASTS and places.judges and not known:
            self._warn("puzzled", f"ranges: {PUZZLED}")
        if watch is not None and watch.doubt is not None:
            self._warn("heading", f"heading: {watch.doubt.text()}", but_not_after="rates")
        if watch is not None and watch.mirror is not None and not (rates is not None and rates.mirrors):
            self._warn("mirror", watch.mirror.text())
        if places.wrong is not None and "anchors" not in self._said:
            names = names_of(self._map, len(filter_.anchors.figures()))
            self._warn("anchors", wrong_anchors_text(places.wrong, names))

    def _warn(self, kind: str, said: str, but_not_after: str = "") -> None:
        """Say a warning if there is one, unless one of its kind, or of the kind `but_not_after`, was said before."""
        if said and not self._said & {kind, but_not_after}:
            self._said.add(kind)
            self._say(f"warning  {said}")

    def _noise(self, places: AnchorWatch) -> str:
        """Return that ranges scatter more than the map says, and which key of the map mends this; else ""."""
        if places.scatter is None or "noise" in self._said:
            return ""
        sd = f"{np.ceil(100.0 * places.scatter) / 100.0:.2f}"
        key = f"range_white: {sd}, range_correlated: {sd}"  # both: in real rooms such errors last
        if self._map.imu is None:
            key = f"baseline_range: {places.scatter:.2f}"
        told = f"a range scatters by {places.scatter:.2f} m, the map says {places.stated:.2f} m"
        return f"noise: {told}: `filter: {{{key}}}` would fit; until then covariances are larger"

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
