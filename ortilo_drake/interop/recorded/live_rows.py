"""Live messages of a map's topics as rows of ranges, imu, range finder and flow, in the order of their stamps.

This is `read_recording` message by message: the same numbers, and the same reasons for rows that cannot be used. No
wall clock is read: a row is given out once every topic has shown a later stamp, or once the newest stamp of all is
`lag` ahead of it. So a topic that falls silent holds the others back by `lag` and no more; a row that comes later than
that is counted, and lost.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.anchor_names import anchors_of
from ortilo_drake.interop.recorded.attitudes import are_attitudes
from ortilo_drake.interop.recorded.live_ranges import each_difference, each_range
from ortilo_drake.interop.recorded.live_stream import LiveStream, Row, complete
from ortilo_drake.interop.recorded.map_file import Find, Map
from ortilo_drake.interop.recorded.range_rows import Ranges, surveyed
from ortilo_drake.interop.recorded.recording import NO_AID_ROWS, AidRows, Imu, force_of, imu_columns, imu_motion
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Quaternion, Source
from ortilo_drake.model.typed_yaml import InputError

LAG: Final = 0.1  # by default [s]
SILENT: Final = 2.0  # a topic so far behind the others is called silent [s]
SOURCES: Final = ("ranges", "differences", "imu", "accelerometer", "range_finder", "flow")


class Block(NamedTuple):
    """Rows in the order of their stamps [s], which count from the first range; imu is None where the map has none.

    With an accelerometer of its own, the imu's `force` is not filled in.
    """

    ranges: Ranges
    imu: Imu | None
    looks: AidRows


def why_not_live(map_: Map) -> str | None:
    """Return the reason why a map's topics cannot be read live; None if they can."""
    for name in SOURCES:
        source = getattr(map_, name)
        if source is None:
            continue
        if source.topic is None and not getattr(source, "topics", ()):
            return f"{name}: is a table: live, each source needs its `topic`"
        if source.zero == "first":
            return f"{name}.zero: first: live stamps must be of one clock; `late` takes a known offset off"
    if map_.command is not None:
        return "command: is not heard live: give the accelerometer"
    if isinstance(map_.anchors, Find):
        return "anchors: find: live they must be surveyed: `ortilo replay` or `ortilo room survey` finds them"
    if isinstance(map_.anchors, str):
        return f"anchors: {map_.anchors}: no such file beside the map"
    return None


class LiveRows:
    """The rows of a map's topics.

    Args:
        map_: what is what.
        lag: by how much the newest stamp is ahead of a row that is given out although a topic is silent [s].

    Attributes:
        anchors: positions (n, 3).
        origin: stamp of the first range [s], None before it is known.

    Raises:
        InputError: if the map cannot be heard live.
    """

    def __init__(self, map_: Map, lag: float = LAG):
        if found := why_not_live(map_):
            raise InputError(found)
        self._map, self._lag = map_, lag
        self._names, positions = surveyed(Path(), map_)
        self.anchors = np.asarray(positions, dtype=float)
        self.origin: float | None = None
        self._given, self._first = -np.inf, np.inf
        self._said: set[str] = set()
        self._silent: set[str] = set()
        self._strangers = 0
        self._of_ranges = [*self._range_streams(), *self._difference_streams()]
        self._imu = self._of("imu", imu_columns(map_) if map_.imu else (), self._imu_row)
        self._accelerometer = self._of("accelerometer", getattr(map_.accelerometer, "force", ()), _vector_row)
        finder = () if map_.range_finder is None else (map_.range_finder.distance,)
        self._finder = self._of("range_finder", finder, self._finder_row)
        self._flow = self._of("flow", getattr(map_.flow, "pixels", ()), _vector_row)
        others = (self._imu, self._accelerometer, self._finder, self._flow)
        self._streams = [*self._of_ranges, *(stream for stream in others if stream is not None)]

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics to listen to."""
        return tuple(dict.fromkeys(stream.topic for stream in self._streams))

    @property
    def newest(self) -> float:
        """The newest stamp of all topics whose stamps are believed [s], -inf before that."""
        believed = [stream.newest - stream.source.late for stream in self._streams if stream.settled]
        return max(believed, default=-np.inf)

    def add(self, topic: str, received: int, message: Any) -> list[str]:
        """Take a message; return lines about its problems, each once.

        Args:
            topic: where it came from; one that the map does not name is counted.
            received: when it came [ns]; its stamp if it has none.
            message: with attributes as the map names them.
        """
        mine = [stream for stream in self._streams if stream.topic == topic]
        self._strangers += not mine
        wrong = [stream.add(received, message, self._given) for stream in mine]
        lines = [f"{topic}: {line}" for line in wrong if line] + ([] if mine else [f"{topic}: is not in the map"])
        new = [line for line in dict.fromkeys(lines) if line not in self._said]
        self._said.update(new)
        return new + self._silences()

    def before(self, wanted: float = -np.inf, ended: bool = False) -> tuple[float, Block] | None:
        """Return the stamp before which nothing more will come [s], and the rows before it.

        None until the first range is due, and until that stamp is beyond the one wanted.

        Args:
            wanted: by the clock of the block [s].
            ended: whether the topics have ended: then all that waits is due.
        """
        horizon = np.inf if ended else self._horizon()
        if self.origin is not None and horizon - self.origin <= wanted:
            return None
        if self.origin is None:
            first = [row[0] for stream in self._of_ranges for row in stream.rows if row[0] < horizon]
            if not first:
                return None
            self.origin = min(first)
        self._given = horizon
        return horizon - self.origin, Block(self._ranges(horizon), self._samples(horizon), self._looks(horizon))

    def counts(self) -> dict[str, int]:
        """Return the number of rows not used, by topic and reason."""
        found: dict[str, int] = {}
        for stream in self._streams:
            for reason, n in stream.rejected.counts.items():
                found[f"{stream.rejected.source}: {reason}"] = n
        return found | ({"messages of topics that are not in the map": self._strangers} if self._strangers else {})

    def message_counts(self) -> dict[str, int]:
        """Return the number of messages received on each topic."""
        return {stream.topic: stream.messages for stream in self._streams}

    def _horizon(self) -> float:
        shown = min(stream.newest - stream.source.late for stream in self._streams)
        return max(shown, self.newest - self._lag)

    def _silences(self) -> list[str]:
        """Return a line for each topic that fell silent or speaks again."""
        lines, newest = [], self.newest
        self._first = min(self._first, newest) if newest > -np.inf else np.inf
        for stream in self._streams:
            name = stream.rejected.source
            behind = newest - max(stream.newest - stream.source.late, self._first)
            if (behind > SILENT) == (name in self._silent):
                continue
            if behind > SILENT:
                self._silent.add(name)
                why = stream.rejected.most()
                lines.append(f"{name}: silent for {SILENT:g} s" + (f": {why}" if why else ""))
            else:
                self._silent.remove(name)
                lines.append(f"{name}: is heard again")
        return lines

    def _make(
        self,
        what: str,
        source: Source,
        topic: str,
        columns: tuple,
        width: int,
        rows_of: Callable[[list[float], tuple[str, ...]], Iterable[Row | str]],
        names: tuple = (),
    ) -> LiveStream:
        return LiveStream(
            topic, source, columns, names, width, rows_of, Rejections(f"{topic} ({what})", word="message")
        )

    def _of(self, what: str, columns: tuple, row_of: Callable[[list[float]], Row | str]) -> LiveStream | None:
        source = getattr(self._map, what)
        if source is None:
            return None
        width = len(columns)
        return self._make(what, source, source.topic, columns, width, lambda numbers, _: (row_of(numbers),))

    def _range_streams(self) -> Iterator[LiveStream]:
        source = self._map.ranges
        if source is None:
            return
        n = len(self.anchors)
        for i, topic in enumerate(source.topics):
            rows_of = each_range(source, lambda names, i=i: (i,))  # type: ignore[misc]
            yield self._make("ranges", source, topic, source.values, 1, rows_of)
        if source.topic is None:
            return
        if source.anchor is None:
            everyone = each_range(source, lambda names: range(n))
            yield self._make("ranges", source, source.topic, source.values, n, everyone)
        else:
            named = each_range(source, lambda names: (self._anchor(names[0]),))
            yield self._make("ranges", source, source.topic, source.values, 1, named, (source.anchor,))

    def _difference_streams(self) -> Iterator[LiveStream]:
        source = self._map.differences
        if source is None:
            return
        assert source.topic is not None
        rows_of = each_difference(source, self.anchors, self._anchor)
        yield self._make("differences", source, source.topic, (source.value,), 1, rows_of, (source.b, source.a))

    def _anchor(self, name: str) -> int:
        return int(anchors_of([name], self._names)[0])

    def _imu_row(self, numbers: list[float]) -> Row | str:
        assert self._map.imu is not None
        turned = self._map.imu.orientation
        wrong = complete(numbers, 6)
        if not wrong and turned is not None and not are_attitudes(np.array([numbers[6:]]), turned)[0]:
            return f"rows without a {'unit quaternion' if isinstance(turned, Quaternion) else 'rotation matrix'}"
        return wrong or tuple(numbers)

    def _finder_row(self, numbers: list[float]) -> Row | str:
        assert self._map.range_finder is not None
        distance = numbers[0] * self._map.range_finder.scale
        return complete(numbers, 1) or ("distances of 0 or less" if distance <= 0.0 else (distance,))

    def _ranges(self, horizon: float) -> Ranges:
        parts = []
        for stream in self._of_ranges:
            rows = stream.until(horizon, 4)
            if len(stream.names) == 1:
                _, first = np.unique(rows[:, :2], axis=0, return_index=True)
                if len(first) < len(rows):
                    stream.rejected.add("duplicate stamps of one anchor", "", len(rows) - len(first))
                rows = rows[np.sort(first)]
            parts.append(rows)
        t, anchor, r, other = np.concatenate(parts).T
        anchor, other, tag = (part.astype(np.int64) for part in (anchor, other, np.zeros(len(t))))
        ranges = Ranges(t - self.origin, anchor, r, other, tag)
        return ranges.only(np.lexsort((ranges.anchor, ranges.t)))

    def _samples(self, horizon: float) -> Imu | None:
        source = self._map.imu
        if self._imu is None or source is None:
            return None
        rows = self._imu.until(horizon, 1 + self._imu.width)
        rates, force, attitude = imu_motion(rows[:, 1:], source, self._imu.topic)
        own = None
        if self._accelerometer is not None:
            seen = self._accelerometer.until(horizon, 4)
            own = seen[:, 0] - self.origin, force_of(seen[:, 1:], source)
        return Imu(rows[:, 0] - self.origin, rates, force, attitude, own)

    def _looks(self, horizon: float) -> AidRows:
        looks = NO_AID_ROWS
        if self._finder is not None:
            rows = self._finder.until(horizon, 2)
            looks = looks._replace(finder_t=rows[:, 0] - self.origin, distance=rows[:, 1])
        if self._flow is not None:
            rows = self._flow.until(horizon, 3)
            looks = looks._replace(flow_t=rows[:, 0] - self.origin, flow=rows[:, 1:])
        return looks


def _vector_row(numbers: list[float]) -> Row | str:
    return complete(numbers, len(numbers)) or tuple(numbers)
