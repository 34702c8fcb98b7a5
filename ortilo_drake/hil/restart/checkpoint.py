"""Checkpoints, from which an onboard process goes on where a killed one stopped.

One file holds the state and is replaced at every tick. A path that is not the scenario's is in a second file beside it,
which is replaced when the path changes.
"""

import io
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.input_files import open_file
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.goal_path import knots, through

MAX_AGE = 5.0  # [s]: the vehicle is elsewhere by then, and an older checkpoint is not used


class Checkpoint(NamedTuple):
    """The discrete state of an onboard half at a tick of a session, all groups of it in one vector."""

    session: int
    tick: int
    state: np.ndarray


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; a reader sees the old one or the new one. InputError if that fails."""
    _replace(path, session=checkpoint.session, tick=checkpoint.tick, state=checkpoint.state)


def _replace(path: Path, **arrays: npt.ArrayLike) -> None:
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: cannot be written: is no regular file")  # a full pipe would stop the flight
    packed = io.BytesIO()
    np.savez(packed, **arrays)  # type: ignore[arg-type]  # no array is named allow_pickle
    write_bytes(path, packed.getvalue(), sync=False)  # useless after a loss of power; a disk may take 10 ms


def session_of(path: Path) -> int:
    """Return the session that a checkpoint is of; 0 if there is none, or it is damaged."""
    try:
        with open_file(path) as opened, np.load(opened, allow_pickle=False) as file:
            return int(file["session"])
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return 0


def load_checkpoint(path: Path, session: int, tick: int, h: float, size: int) -> Checkpoint | None:
    """Return the checkpoint that fits, or None.

    Args:
        path: the file; it may be missing, damaged or of another flight.
        session: the session of this flight.
        tick: the tick that the flight is at.
        h: tick [s].
        size: the size of the state.
    """
    try:
        with open_file(path) as opened, np.load(opened, allow_pickle=False) as file:
            found = Checkpoint(int(file["session"]), int(file["tick"]), np.array(file["state"], dtype=float))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None
    fits = found.session == session and found.state.shape == (size,) and bool(np.isfinite(found.state).all())
    return found if fits and 0 <= tick - found.tick <= MAX_AGE / h else None


def path_file(checkpoint: Path) -> Path:
    """Return the file of the path that belongs to a checkpoint."""
    return checkpoint.with_suffix(".path.npz")


def save_path(checkpoint: Path, session: int, path: PiecewisePolynomial) -> None:
    """Write the path that a session flies from now on, beside its checkpoint. InputError if that fails."""
    _replace(path_file(checkpoint), session=session, knots=knots(path))


def load_path(checkpoint: Path, session: int) -> PiecewisePolynomial | None:
    """Return the path that a session flew last; None if it is the scenario's, or the file is damaged."""
    try:
        with open_file(path_file(checkpoint)) as opened, np.load(opened, allow_pickle=False) as file:
            found, its_knots = int(file["session"]), np.array(file["knots"], dtype=float)
        if found != session or its_knots.shape[0] != 7 or not np.isfinite(its_knots).all():
            return None
        return through(its_knots)
    except (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, IndexError, zipfile.BadZipFile):
        return None  # RuntimeError: Drake refuses times that do not increase
