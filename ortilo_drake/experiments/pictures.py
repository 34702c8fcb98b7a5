"""Pictures on disk, by matplotlib."""

from pathlib import Path

from matplotlib.figure import Figure

from ortilo_drake.experiments.files import replacing
from ortilo_drake.model.typed_yaml import InputError


def check_picture(path: Path) -> None:
    """Refuse a kind of picture that cannot be drawn; InputError says which can."""
    allowed = Figure().canvas.get_supported_filetypes()
    if path.suffix[1:] not in allowed:
        raise InputError(f"{path}: unknown kind of picture '{path.suffix}', give one of {', '.join(sorted(allowed))}")


def save_picture(figure: Figure, path: Path) -> Path:
    """Write a figure, under a temporary name first; return its path. Errors as check_picture."""
    check_picture(path)
    with replacing(path) as partial:
        figure.savefig(partial)
    return path
