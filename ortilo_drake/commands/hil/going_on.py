"""What lets a bridge that is killed in flight be followed by one that goes on."""

import signal
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any


def interrupt_once(number: int, frame: FrameType | None) -> None:
    """Interrupt at the first Ctrl-C alone: a terminal and the parent process both send one."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def kept_in(
    path: Path, map_: Any, bridge: Any, send: Callable[..., None], say: Callable[[str], None]
) -> Callable[..., None]:
    """Let a bridge go on from the state in a file, and return a target that also keeps the state of what it sends."""
    from ortilo_drake.studies.live.kept_state import StateKeeper, load_state

    try:
        if (found := load_state(path, map_)) is not None:
            bridge.resume(found, str(path))
    except ValueError as error:
        say(f"warning  {path}: is not used: {error}")
    keeper = StateKeeper(path, map_, say)

    def send_and_keep(told: Any, wanted: Any, resets: int) -> None:
        send(told, wanted, resets)
        keeper.keep(told.t, bridge.kept)

    def forget(told: Any, wanted: Any, resets: int) -> None:
        if bridge.kept is None:  # the next begins without what is wrong, or is held by it again
            keeper.keep(told.t, None)

    bridge.add_target("state", forget)
    return send_and_keep
