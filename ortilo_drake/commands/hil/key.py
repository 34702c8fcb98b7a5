"""The command `ortilo hil key`: it makes a secret key for two machines."""

from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.terminal import say_written


def key(file: Annotated[Path, typer.Argument(help="A new file; copy it to the other machine.")]) -> None:
    """Write a new key to a file that only you can read, for --key of both halves."""
    from ortilo_drake.hil.wire.key_file import write_key

    write_key(file)
    say_written(file)
