"""What an onboard process needs to go on where a killed one stopped, in a file that is replaced at every tick."""

import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ortilo_drake.experiments.files import replacing

MAX_AGE = 5.0  # an older checkpoint tells nothing of where the vehicle is [s]


class Checkpoint(NamedTuple):
    """The discrete state of an onboard half at a tick of a session, all groups of it in one vector."""

    session: int
    tick: int
    state: np.ndarray


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; a reader sees the old one or the new one. InputError if that fails."""
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez(file, session=checkpoint.session, tick=checkpoint.tick, state=checkpoint.state)


def load_checkpoint(path: Path, session: int, tick: int, h: float, size: int) -> Checkpoint | None:
    """Return the checkpoint that fits, or None.

    Args:
        path: the file; it may be missing, damaged or another flight's.
        session: of this flight.
        tick: at which the flight is now.
        h: tick [s].
        size: of the state.
    """
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            found = Checkpoint(int(file["session"]), int(file["tick"]), np.array(file["state"], dtype=float))
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        return None
    fits = found.session == session and found.state.shape == (size,) and bool(np.isfinite(found.state).all())
    return found if fits and 0 <= tick - found.tick <= MAX_AGE / h else None
