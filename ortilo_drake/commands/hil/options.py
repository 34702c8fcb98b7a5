"""Options of `ortilo hil`, and the display of a running flight."""

import contextlib
from collections.abc import Iterator
from typing import Annotated, Any

import typer

from ortilo_drake.commands.options import finite
from ortilo_drake.commands.terminal import err, progress_bar

UrlOption = Annotated[str, typer.Option(help="The world's address, tcp://HOST:PORT; by default on this machine.")]
ServesOption = Annotated[
    str, typer.Option(help="Address to serve; tcp://0.0.0.0:PORT is open to other machines, the default is not.")
]
KeyOption = Annotated[
    str | None,
    typer.Option(
        "--key", metavar="FILE", help="File with the key of both halves, from `ortilo hil key`; by default your own."
    ),
]
InsecureOption = Annotated[
    bool, typer.Option("--insecure", help="Use no key: everyone on the network can command the vehicle.")
]
WaitOption = Annotated[float, typer.Option(min=1.0, callback=finite, help="How long to look for the other half [s].")]
LockstepOption = Annotated[
    bool, typer.Option("--lockstep", help="Each half waits for the other: the flight of `ortilo fly`, bit for bit.")
]
SecondsOption = Annotated[
    float | None,
    typer.Option(min=0.1, callback=finite, help="In real time, end after this time [s]; by default at the path's end."),
]


@contextlib.contextmanager
def showing_flight(name: str, ticks: int, lockstep: bool) -> Iterator[dict[str, Any]]:
    """Show a flight in the terminal, as a bar in lockstep, else as a panel; yield the arguments of run_world for it."""
    from ortilo_drake.hil.real_time.panel import live_panel

    if lockstep:
        with progress_bar() as bar:
            task = bar.add_task(name, total=ticks)
            yield {"progress": lambda k: bar.update(task, completed=k)}
    else:
        with live_panel(err) as show_statistics:
            yield {"show_statistics": show_statistics}
