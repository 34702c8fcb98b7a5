"""Functions by which a new bridge can continue after a bridge was killed in flight."""

import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """Interrupt only at the first Ctrl-C: the terminal and the parent process both send one."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def kept_in(
    path: Path, map_: Any, bridge: Any, send: Callable[..., None], say: Callable[[str], None]
) -> Callable[..., None]:
    """Let a bridge continue from the state in a file; return a target that sends and also saves the state there."""
    from ortilo_drake.studies.live.kept_state import StateKeeper, load_state

    try:
        if (found := load_state(path, map_)) is not None:
            bridge.resume(found, str(path))
    except ValueError as error:
        say(f"warning  {path}: is not used: {error}")
    keeper = StateKeeper(path, map_, say)

    def send_and_keep(stamped: Any, wanted: Any, resets: int) -> None:
        send(stamped, wanted, resets)
        keeper.keep(stamped.t, bridge.kept)

    def forget(stamped: Any, wanted: Any, resets: int) -> None:
        if bridge.kept is None:  # the next bridge must not start from a wrong state
            keeper.keep(stamped.t, None)

    bridge.add_target("state", forget)
    return send_and_keep
