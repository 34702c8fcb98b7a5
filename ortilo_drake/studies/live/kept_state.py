"""The last state of a live filter in a file: a bridge that died in flight goes on from it when it is started again.

The state kept is one whose estimate went to the autopilot. Until the first messages of the new process, the filter is
propagated as in any silence of all sensors (passing.py): 0.1 s after the last sample the body is taken to hover, with
white noise of rates and forces. In T seconds this adds to each axis the variances

    attitude  (0.3 rad/s/√Hz)² T,   velocity  (2 m/s²/√Hz)² T + (0.3 rad/s/√Hz · g)² T³ / 3 (of x and y, by the tilt)

So the ranges must tell the position anew, and beyond LOST nobody knows the heading either. Both clocks, the stamps and
the wall clock, tell whether the state is of this flight.
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
from ortilo_drake.studies.live.sensor_records import LOST
from ortilo_drake.studies.recorded.filter_types import State
from ortilo_drake.studies.recorded.imu_watch import RESTS

EVERY: Final = 0.2  # least time between two states that are kept [s]
OTHER_CLOCK: Final = 1.0  # stamps and wall clock may move against each other by so much [s]
_OF: Final = "state of a live filter"  # the file's kind, in its last line


class Kept(NamedTuple):
    """A filter's state, with the data needed to go on from it.

    Attributes:
        origin: stamp from which the state's time counts [s].
        newest: newest stamp of a sensor then [s].
        received: time of the last message by the wall clock [ns].
        resets: how often the filter had started anew, in all processes.
        state: the filter's state.
    """

    origin: float
    newest: float
    received: int
    resets: int
    state: State


class StateKeeper:
    """Writes states by a map to a file, at most one in EVERY; `say` takes a line if the file cannot be written."""

    def __init__(self, path: Path, map_: Map, say: Callable[[str], None]):
        self._path, self._digest, self._say = path, digest_of(map_), say
        self._last = -np.inf

    def keep(self, t: float, one: Kept | None) -> None:
        """Write the state of an estimate stamped t [s], unless the last one written is recent; None deletes the file.

        A state later than the estimate is not written, nor a state at rest: the vehicle may take off in the meantime.
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
    """Return a digest of this program's version and a map, without start and standstill, which are past in the air."""
    return hashlib.sha256((__version__ + map_.in_the_air().model_dump_json()).encode()).hexdigest()


def load_state(path: Path, map_: Map) -> Kept | None:
    """Return the state in a file, None if there is no file.

    Raises:
        ValueError: if the file is damaged, or of another map.
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
    """Return why the filter cannot go on from a kept state, given the newest stamp [s] and its receipt [ns]; or ""."""
    by_stamps, by_wall = newest - kept.newest, 1e-9 * (received - kept.received)
    age = newest - kept.origin - kept.state.t
    if by_wall <= LOST and (abs(by_stamps - by_wall) > OTHER_CLOCK or age <= 0.0):
        return f"its clock is another: the stamps went on by {by_stamps:.1f} s, the wall clock by {by_wall:.1f} s"
    if (old := max(age, by_wall)) > LOST:
        return f"it is {old:.1f} s old, and the body may be turned any way after {LOST:g} s"
    return ""
