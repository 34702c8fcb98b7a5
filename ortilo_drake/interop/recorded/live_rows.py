"""Live messages of a map's topics as rows of ranges, imu, range finder and flow, in the order of their stamps.

This is `read_recording` message by message: the same numbers, and the same reasons for rows that cannot be used. No
wall clock is read. A row is released once every topic has shown a later stamp, or once the newest stamp of all topics
is `lag` ahead of the row. So a silent topic delays the others by `lag` at most. A row that comes after later rows were
released is counted and not used.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.anchors import anchors_of
from ortilo_drake.interop.recorded.columns import Stream
from ortilo_drake.interop.recorded.live_stream import BELIEVED, TOO_LATE, LiveStream
from ortilo_drake.interop.recorded.map_file import Find, Map
from ortilo_drake.interop.recorded.range_rows import (
    Ranges,
    differences_of,
    ranges_by_column,
    ranges_by_name,
    ranges_of_anchor,
    surveyed,
)
from ortilo_drake.interop.recorded.recording import (
    AidRows,
    Imu,
    between,
    columns_of,
    complete,
    imu_of,
    looks_of,
    with_attitude,
)
from ortilo_drake.interop.recorded.rejected import Rejections
from ortilo_drake.interop.recorded.sources import Column, Source
from ortilo_drake.model.typed_yaml import InputError

LAG: Final = 0.1  # default of `lag` [s]
SILENT: Final = 2.0  # a topic this far behind the others is called silent [s]
AGAIN: Final = ": heard again"
LATE_ROWS: Final = 10  # number of late rows of a topic that causes a warning
OTHER_CLOCK: Final = 1.0  # a row late by more than this has a stamp of another clock, or is out of order [s]
SOURCES: Final = ("ranges", "differences", "imu", "accelerometer", "range_finder", "flow")


class Block(NamedTuple):
    """Rows in the order of their stamps, which count from the first range [s]; imu is None if the map has no imu.

    If the map has a separate accelerometer, the imu's `force` is not filled in.
    """

    ranges: Ranges
    imu: Imu | None
    looks: AidRows


def joined(a: Any, b: Any) -> Any:
    """Return the rows of a followed by the later rows of b; both are arrays, or tuples whose parts are joined."""
    if a is None or b is None:
        return None
    if isinstance(a, np.ndarray):
        return np.concatenate((a, b))
    parts = map(joined, a, b)
    return a._make(parts) if hasattr(a, "_make") else tuple(parts)


def parted(block: Block, t: float) -> tuple[Block, Block]:
    """Return the rows up to and including the stamp t [s], and the rows after it."""
    ranges, imu, looks = block

    def part(after: float, until: float) -> Block:
        r, f, m = ((stamps > after) & (stamps <= until) for stamps in (ranges.t, looks.finder_t, looks.flow_t))
        finder = {"finder_t": looks.finder_t[f], "distance": looks.distance[f]}
        seen = looks._replace(**finder, flow_t=looks.flow_t[m], flow=looks.flow[m])
        return Block(ranges.only(r), None if imu is None else between(imu, after, until), seen)

    return part(-np.inf, t), part(t, np.inf)


def behind_gap(block: Block, longest: float) -> Block:
    """Return the rows from the first range after the last gap of ranges longer than `longest` [s]; else all rows."""
    gaps = np.flatnonzero(np.diff(block.ranges.t) > longest)
    return parted(block, float(np.nextafter(block.ranges.t[gaps[-1] + 1], -np.inf)))[1] if len(gaps) else block


def why_not_live(map_: Map) -> str | None:
    """Return the reason why a map's topics cannot be read live; None if they can be."""
    for name in SOURCES:
        source = getattr(map_, name)
        if source is None:
            continue
        if source.topic is None and not getattr(source, "topics", ()):
            return f"{name}: is a table: each live source needs a `topic`"
        if source.zero == "first":
            return f"{name}.zero: first: live stamps must be of one clock; `late` takes a known offset off"
    if map_.command is not None:
        return "command: cannot be used live: give the accelerometer"
    if isinstance(map_.anchors, Find):
        return "anchors: find: cannot be used live: give their places, which `ortilo replay` or `room survey` finds"
    if isinstance(map_.anchors, str):
        return f"anchors: {map_.anchors}: no such file beside the map"
    return None


class LiveRows:
    """The rows of a map's topics; `origin` is the stamp of the first range [s], None before it is known.

    `anchors` are the positions of the anchors (n, 3) [m], `topics` those to subscribe to. Although a topic is silent, a
    row is released once the newest stamp is `lag` [s] ahead of the row. InputError if the map cannot be read live.
    """

    def __init__(self, map_: Map, lag: float = LAG):
        if found := why_not_live(map_):
            raise InputError(found)
        self._map, self._lag = map_, lag
        self._names, positions = surveyed(Path(), map_)
        self.anchors = np.asarray(positions, dtype=float)
        self.origin: float | None = None
        self._given = -np.inf
        self._said: set[str] = set()
        self._silent: set[str] = set()
        self._late: set[str] = set()
        self._since: dict[str, float] = {}  # the stamp from which on a silence counts, by name [s]
        self._strangers = 0
        self._of_ranges = self._range_streams()
        self._others = {
            key: self._stream(key, columns_of(map_, key)[0]) for key in SOURCES[2:] if getattr(map_, key) is not None
        }
        self._streams = [*(stream for stream, _ in self._of_ranges), *self._others.values()]
        ranging = [stream for stream, _ in self._of_ranges]
        self._sources = [*([ranging] if ranging else []), *([stream] for stream in self._others.values())]
        self.topics = tuple(dict.fromkeys(stream.topic for stream in self._streams))

    @property
    def newest(self) -> float:
        """The newest stamp of all settled topics [s]; -inf while no topic is settled."""
        believed = [stream.newest - stream.source.late for stream in self._streams if stream.settled]
        return max(believed, default=-np.inf)

    def add(self, topic: str, received: int, message: Any) -> list[str]:
        """Take a message and its time of receipt [ns]; return lines about its problems, each line only once."""
        mine = [stream for stream in self._streams if stream.topic == topic]
        self._strangers += not mine
        wrong = [stream.add(received, message, self._given) for stream in mine]
        late = [line for stream in mine if (line := self._lateness(stream))]
        lines = (
            late + [f"{topic}: {line}" for line in wrong if line] + ([] if mine else [f"{topic}: is not in the map"])
        )
        new = [line for line in dict.fromkeys(lines) if line not in self._said]
        self._said.update(new)
        return new + self._silences()

    def before(self, wanted: float = -np.inf, ended: bool = False) -> tuple[float, Block] | None:
        """Return the horizon [s], the stamp before which no more rows are accepted, and the waiting rows before it.

        None until the first range is due, and until the horizon is beyond `wanted`. Horizon and `wanted` [s] count from
        `origin`, as the stamps of the Block do. With `ended` the topics have ended, and all waiting rows are due.
        """
        horizon = np.inf if ended else self._horizon()
        if self.origin is not None and horizon - self.origin <= wanted:
            return None
        ranges = self._ranges(horizon)
        if self.origin is None:
            if not len(ranges.t):
                return None
            self.origin = float(ranges.t[0])
        self._given, origin = horizon, self.origin

        def read(key: str) -> Stream:
            measured, turned = columns_of(self._map, key)[1], getattr(getattr(self._map, key), "orientation", None)
            stream = complete(self._others[key].until(horizon), measured)
            return stream if turned is None else with_attitude(stream, turned, measured)

        imu = None if self._map.imu is None else imu_of(self._map, read, origin)
        block = Block(ranges._replace(t=ranges.t - origin), imu, looks_of(self._map, read, origin))
        return horizon - origin, block

    def counts(self) -> dict[str, int]:
        """Return the number of unused rows, by topic and reason."""
        all_ = [stream.rejected for stream in self._streams]
        found = {f"{one.source}: {reason}": n for one in all_ for reason, n in one.counts.items()}
        return found | ({"messages of topics that are not in the map": self._strangers} if self._strangers else {})

    def message_counts(self) -> dict[str, int]:
        """Return the number of messages received on each topic."""
        return {stream.topic: stream.messages for stream in self._streams}

    def _horizon(self) -> float:
        shown = min(stream.newest - stream.source.late for stream in self._streams)
        return max(shown, self.newest - self._lag)

    def _lateness(self, stream: LiveStream) -> str:
        """Return a warning, once for a topic, when LATE_ROWS of its messages came too late; else an empty text."""
        n = stream.rejected.counts.get(TOO_LATE, 0)
        if n < LATE_ROWS or stream.topic in self._late:
            return ""
        self._late.add(stream.topic)
        needed, said = self._lag + stream.late_by, f"warning  {stream.topic}: {n} messages are not used: they come"
        if stream.late_by > OTHER_CLOCK:
            return f"{said} {needed:.1f} s after others with later stamps: another clock?"
        drifts = {one.topic: one.drift for one in self._streams if one.drift != 0.0}
        if drifts:
            name = max(drifts, key=lambda one: abs(drifts[one]))
            by, which = abs(drifts[name]), "fast" if drifts[name] > 0.0 else "slow"
            return (
                f"{said} up to {needed:.2f} s after others with later stamps, and the clock of {name} is {which} by "
                f"{by:.2%} ({round(1e6 * by, -2):.0f} ppm): no --lag will do for long; stamp all by one clock"
            )
        lag = np.ceil(100.0 * needed - 1e-3) / 100.0
        return f"{said} up to {needed:.2f} s after others with later stamps: --lag {lag:g} takes them"

    def _silences(self) -> list[str]:
        """Return a line for each source and each topic of a source with several that fell silent or is heard again."""
        newest, lines = self.newest, list[str]()
        for streams in self._sources:
            heard, beside = [stream.newest - stream.source.late for stream in streams], newest
            if len(streams) > 1:
                beside = max(heard)
                of_all = self._silence("all topics of ranges", beside, newest, streams)
                if of_all == ["all topics of ranges" + AGAIN]:
                    self._since |= {stream.rejected.source: beside for stream in streams}  # topics resume one by one
                lines += of_all
            for stream, stamp in zip(streams, heard, strict=True):
                lines += self._silence(stream.rejected.source, stamp, beside, [stream])
        return lines

    def _silence(self, name: str, stamp: float, newest: float, streams: list[LiveStream]) -> list[str]:
        """Return a line if a name fell silent or is heard again; its stamp is `stamp`, that of others `newest` [s]."""
        if newest == -np.inf:
            return []
        behind = newest - max(stamp, self._since.setdefault(name, newest))
        if (behind > SILENT) == (name in self._silent):
            return []
        self._silent ^= {name}
        if behind <= SILENT:
            return [name + AGAIN]
        why = next((stream.rejected.most() for stream in streams if stream.dropped >= BELIEVED), "")
        return [f"{name}: silent for {SILENT:g} s" + (f". What came is not used: {why}" if why else "")]

    def _stream(
        self, key: str, columns: tuple[Column, ...], names: tuple[Column, ...] = (), topic: str = "", width: int = 0
    ) -> LiveStream:
        source: Source = getattr(self._map, key)
        topic = topic or str(source.topic)
        rejected = Rejections(f"{topic} ({key})", word="message")
        return LiveStream(topic, source, columns, width or len(columns), names, rejected)

    def _range_streams(self) -> list[tuple[LiveStream, Callable[[Stream], Ranges]]]:
        """Return the streams of ranges and differences, each with the function that makes ranges of its rows."""
        single, pairs, found = self._map.ranges, self._map.differences, list[tuple[LiveStream, Callable]]()
        if single is not None:
            scale = single.scale
            for i, topic in enumerate(single.topics):
                of_one = partial(ranges_of_anchor, i=i, scale=scale)
                found.append((self._stream("ranges", single.values, topic=topic), of_one))
            if single.topic is not None and single.anchor is not None:
                found.append((self._stream("ranges", single.values, (single.anchor,)), self._by_name))
            elif single.topic is not None:
                everyone = self._stream("ranges", single.values, width=len(self.anchors))
                found.append((everyone, lambda stream: ranges_by_column(stream, _no_tags(stream), scale)))
        if pairs is not None:
            found.append((self._stream("differences", (pairs.value,), (pairs.b, pairs.a)), self._differences))
        return found

    def _by_name(self, stream: Stream) -> Ranges:
        assert self._map.ranges is not None
        assert stream.names is not None
        anchor = anchors_of(stream.names[:, 0].tolist(), self._names)
        return ranges_by_name(stream, anchor, _no_tags(stream), self._map.ranges.scale)

    def _differences(self, stream: Stream) -> Ranges:
        assert self._map.differences is not None
        assert stream.names is not None
        b, a = (anchors_of(names.tolist(), self._names) for names in stream.names.T)
        return differences_of(stream, b, a, _no_tags(stream), self.anchors, self._map.differences)

    def _ranges(self, horizon: float) -> Ranges:
        parts = [rows_of(stream.until(horizon)) for stream, rows_of in self._of_ranges]
        ranges = Ranges(*(np.concatenate(part) for part in zip(*parts, strict=True)))
        return ranges.only(np.lexsort((ranges.anchor, ranges.t)))


def _no_tags(stream: Stream) -> np.ndarray:
    return np.zeros(len(stream.t), np.int64)
