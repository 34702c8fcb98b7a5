"""The command `ortilo replay`: a log flown again by the onboard half."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.options import JsonOption, quiet_drake
from ortilo_drake.commands.terminal import check_writable, out, say_if_compiling, say_written, show_report, write_json


def replay(
    log: Annotated[Path, typer.Argument(help="A log's folder, or its .mcap file.")],
    json_file: JsonOption = None,
) -> None:
    """Drive the onboard half from a recorded world and compare its estimates with the recorded ones."""
    check_writable(json_file)
    from ortilo_drake.interop.log.replay import replay_log

    quiet_drake()
    say_if_compiling()
    result = replay_log(log)
    write_json(json_file, result)
    out.print(f"[bold]{log}[/bold]")
    show_report(result)
    say_written(json_file)
