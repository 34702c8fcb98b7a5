"""Checkpoints, from which an onboard process goes on where a killed process stopped.

One file holds the state; it is replaced at every tick. A path other than the scenario's is in a second file beside the
first, which is replaced when the path changes.
"""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.flight.store import keep, kept
from ortilo_drake.model.input_files import arrays_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.goal_path import knots, through

MAX_AGE = 5.0  # largest age of a checkpoint that is used [s]; after a longer time the vehicle is elsewhere
T = TypeVar("T")


class Checkpoint(NamedTuple):
    """The discrete state of an onboard half at a tick of a session, with all groups in one vector."""

    session: int
    tick: int
    state: np.ndarray


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; a reader sees the old one or the new one. InputError if the file cannot be written."""
    _replace(path, "checkpoint", session=checkpoint.session, tick=checkpoint.tick, state=checkpoint.state)


def _replace(path: Path, of: str, **arrays: npt.ArrayLike) -> None:
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: cannot be written: is no regular file")  # a full pipe would block the flight
    packed = io.BytesIO()
    np.savez(packed, **arrays)  # type: ignore[arg-type]  # no array is named allow_pickle
    keep(path, packed.getvalue(), of, sync=False)  # useless after a loss of power, and a disk may take 10 ms to sync


def _read(path: Path, of: str, make: Callable[[Mapping[str, np.ndarray]], T]) -> T | None:
    """Return `make` of a file's arrays; None if there is no file, or, with a warning, if the file is damaged."""

    def read(data: bytes) -> T:
        with arrays_of(io.BytesIO(data)) as file:
            return make(file)

    return kept(path, of, read, "not used")


def session_of(path: Path) -> int:
    """Return the session of a checkpoint; 0 if there is no checkpoint, or it is damaged."""
    return _read(path, "checkpoint", lambda file: int(file["session"])) or 0


def load_checkpoint(path: Path, session: int, tick: int, h: float, size: int) -> Checkpoint | None:
    """Return the checkpoint in a file if it fits a flight: its session, tick, length h of a tick [s] and state size.

    None if the checkpoint does not fit, is missing or is damaged.
    """

    def make(file: Mapping[str, np.ndarray]) -> Checkpoint:
        return Checkpoint(int(file["session"]), int(file["tick"]), np.array(file["state"], dtype=float))

    found = _read(path, "checkpoint", make)
    if found is None or found.session != session or found.state.shape != (size,) or not np.isfinite(found.state).all():
        return None
    return found if 0 <= tick - found.tick <= MAX_AGE / h else None


def path_file(checkpoint: Path) -> Path:
    """Return the name of the path file that belongs to a checkpoint file."""
    return checkpoint.with_suffix(".path.npz")


def save_path(checkpoint: Path, session: int, path: PiecewisePolynomial) -> None:
    """Write the path that a session flies from now on, beside its checkpoint; InputError if it cannot be written."""
    _replace(path_file(checkpoint), "path", session=session, knots=knots(path))


def load_path(checkpoint: Path, session: int) -> PiecewisePolynomial | None:
    """Return the path that a session flew last; None if it flew the scenario's path, or the file is damaged."""

    def make(file: Mapping[str, np.ndarray]) -> PiecewisePolynomial | None:
        its_knots = np.array(file["knots"], dtype=float)
        if its_knots.shape[0] != 7 or not np.isfinite(its_knots).all():
            raise ValueError(f"knots: {its_knots.shape}: must be finite (7, n)")
        return through(its_knots) if int(file["session"]) == session else None

    return _read(path_file(checkpoint), "path", make)
