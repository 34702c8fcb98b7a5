"""Files of matplotlib figures."""

import io
from pathlib import Path

from matplotlib.figure import Figure

from ortilo_drake.flight.files import write_bytes
from ortilo_drake.model.typed_yaml import InputError


def check_picture(path: Path) -> None:
    """Check that matplotlib can write a file of that suffix; InputError names the suffixes that it can."""
    allowed = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:] not in allowed:
        raise InputError(f"{path}: unknown kind of picture '{path.suffix}', give one of {', '.join(sorted(allowed))}")


def save_picture(figure: Figure, path: Path) -> Path:
    """Write a figure and return its path. Errors as check_picture and write_bytes."""
    check_picture(path)
    drawn = io.BytesIO()
    figure.savefig(drawn, format=path.suffix[1:])
    write_bytes(path, drawn.getvalue())
    return path
