"""The last state of a live filter in a file: a bridge that died in flight goes on from it when it is started again.

Kept is a state whose estimate went to the autopilot. Until the first messages of the new process the filter is
propagated as in any silence of all sensors (passing.py): 0.1 s after its last sample the body is taken to hover, but
for white noise of its rates and forces. In T seconds that adds to each axis the variances

    attitude  (0.3 rad/s/√Hz)² T,   velocity  (2 m/s²/√Hz)² T + (0.3 rad/s/√Hz · g)² T³ / 3 (of x and y, by the tilt)

so the ranges must tell the position anew, and beyond LOST nobody knows the heading either. Whether the state is of this
flight is judged by both clocks.
"""

import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake import __version__
from ortilo_drake.flight.store import keep, reason_of, unsealed
from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.model.input_files import MIB, arrays_of, exists, read_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.live.imu_record import LOST
from ortilo_drake.studies.recorded.filter_types import State
from ortilo_drake.studies.recorded.imu_watch import RESTS

EVERY: Final = 0.2  # a state is kept [s]
OTHER_CLOCK: Final = 1.0  # by which stamps and wall clock may move against each other [s]
_OF: Final = "state of a live filter"  # what the file is called in its last line


class Kept(NamedTuple):
    """A filter's state, and what is needed to go on from it.

    Attributes:
        origin: stamp that the state's time counts from [s].
        newest: stamp of a sensor then [s].
        received: when the last message was, by the wall clock [ns].
        resets: how often the filter had started anew, in all processes.
        state: the filter's.
    """

    origin: float
    newest: float
    received: int
    resets: int
    state: State


class StateKeeper:
    """Writes states to a file, at most one in EVERY, by a map; say takes a line if it cannot be written any more."""

    def __init__(self, path: Path, map_: Map, say: Callable[[str], None]):
        self._path, self._digest, self._say = path, digest_of(map_), say
        self._last = -np.inf

    def keep(self, t: float, one: Kept | None) -> None:
        """Write the state of an estimate stamped t [s] unless the last is recent; None deletes what was written.

        Nor is one kept that is already further than that estimate, or that rests: it may take off in the meantime.
        """
        if one is None:
            self._path.unlink(missing_ok=True)
            return
        later = one.origin + one.state.t > t
        if later or one.state.t < self._last + EVERY or one.state.watched[RESTS] > 0.0:
            return
        self._last = one.state.t
        packed = io.BytesIO()
        clocks, numbers = np.array([one.origin, one.newest]), one.state._asdict()
        np.savez(packed, map=self._digest, clocks=clocks, received=one.received, resets=one.resets, **numbers)
        try:
            keep(self._path, packed.getvalue(), _OF, sync=False)  # of no use after a loss of power
        except InputError as error:
            self._last = np.inf
            self._say(f"warning  {error}")


def digest_of(map_: Map) -> str:
    """Return a digest of this program's version and a map, but its start and standstill, which are past in the air."""
    return hashlib.sha256((__version__ + map_.in_the_air().model_dump_json()).encode()).hexdigest()


def load_state(path: Path, map_: Map) -> Kept | None:
    """Return the state in a file, None if there is none.

    Raises:
        ValueError: if it is damaged, or that of another map.
    """
    if not exists(path):
        return None
    try:
        with arrays_of(io.BytesIO(unsealed(read_bytes(path, MIB), _OF))) as file:
            digest, clocks, received, resets = (file[name] for name in ("map", "clocks", "received", "resets"))
            state = State(float(file["t"]), *(np.array(file[name], dtype=float) for name in State._fields[1:]))
    except Exception as error:  # NumPy, zipfile and the operating system raise a dozen kinds
        raise ValueError(reason_of(error).removeprefix(f"{path}: ")) from None
    if str(digest) != digest_of(map_):
        raise ValueError("it is of another map")
    if not all(np.isfinite(part).all() for part in state[:4]):
        raise ValueError("it is not finite")
    return Kept(float(clocks[0]), float(clocks[1]), int(received), int(resets), state)


def why_not(kept: Kept, newest: float, received: int) -> str:
    """Return why a state is not gone on from, when the newest stamp [s] was received [ns]; empty if it can be."""
    by_stamps, by_wall = newest - kept.newest, 1e-9 * (received - kept.received)
    age = newest - kept.origin - kept.state.t
    if by_wall <= LOST and (abs(by_stamps - by_wall) > OTHER_CLOCK or age <= 0.0):
        return f"its clock is another: the stamps went on by {by_stamps:.1f} s, the wall clock by {by_wall:.1f} s"
    if (old := max(age, by_wall)) > LOST:
        return f"it is {old:.1f} s old, and the body may be turned any way after {LOST:g} s"
    return ""
