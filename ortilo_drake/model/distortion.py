"""Settings of a lens with distortion; model/lens.py has the equations."""

from typing import Annotated, Literal

from pydantic import Field

Distortion = Literal["none", "brown_conrady", "fisheye"]
Coefficients = Annotated[tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...], Field(max_length=8)]
_COUNTS = {"none": (0,), "brown_conrady": (4, 5, 8), "fisheye": (4,)}


def check_count(distortion: str, coefficients: tuple[float, ...]) -> None:
    """Raise ValueError, for a model's validator, if the distortion does not have this number of coefficients."""
    allowed = _COUNTS[distortion]
    if len(coefficients) not in allowed:
        counts = " or ".join(map(str, allowed))
        raise ValueError(f".coefficients: {len(coefficients)} of them: {distortion} has {counts}")
