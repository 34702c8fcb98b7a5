"""Options of `ortilo hil`, and the display of a flight while it lasts."""

import contextlib
from collections.abc import Iterator
from typing import Annotated, Any

import typer

from ortilo_drake.commands.options import finite
from ortilo_drake.commands.terminal import err, progress_bar

UrlOption = Annotated[
    str, typer.Option(help="The world's address, tcp://HOST:PORT; by default one of this machine alone.")
]
ServesOption = Annotated[
    str, typer.Option(help="Serve this address; tcp://0.0.0.0:PORT for other machines, by default this one alone.")
]
KeyOption = Annotated[
    str | None,
    typer.Option("--key", metavar="FILE", help="The secret of both halves, of `ortilo hil key`; by default your own."),
]
InsecureOption = Annotated[
    bool, typer.Option("--insecure", help="No secret: anyone on the network can command the vehicle.")
]
WaitOption = Annotated[float, typer.Option(min=1.0, callback=finite, help="Time to wait for the other half [s].")]
LockstepOption = Annotated[bool, typer.Option("--lockstep", help="Wait for each answer: bit for bit as `ortilo fly`.")]
SecondsOption = Annotated[
    float | None,
    typer.Option(min=0.1, callback=finite, help="In real time, stop after this time [s], not with the path."),
]


@contextlib.contextmanager
def showing_flight(name: str, ticks: int, lockstep: bool) -> Iterator[dict[str, Any]]:
    """Show a flight in the terminal, by a bar in lockstep, else by a panel; yield run_world's arguments for that."""
    from ortilo_drake.hil.real_time.panel import live_panel

    if lockstep:
        with progress_bar() as bar:
            task = bar.add_task(name, total=ticks)
            yield {"progress": lambda k: bar.update(task, completed=k)}
    else:
        with live_panel(err) as show_statistics:
            yield {"show_statistics": show_statistics}
