"""The summary of a flight."""

import json
from dataclasses import asdict, dataclass
from typing import Annotated, Final

from pydantic import AfterValidator, TypeAdapter

from ortilo_drake.flight.lost import CAUSES
from ortilo_drake.flight.store import Amount, Count, Error


def _known(cause: str) -> str:
    if cause not in CAUSES:
        raise ValueError(f"{cause!r}: must be one of {', '.join(CAUSES)}")
    return cause


@dataclass(frozen=True)
class Loss:
    """The end of a lost flight: its time [s], and its cause, one of lost.CAUSES."""

    time: Amount
    cause: Annotated[str, AfterValidator(_known)]


@dataclass(frozen=True)
class FixError:
    """Median and 95th percentile of the distance of a sensor's position fixes from the truth [m]."""

    median: Error
    p95: Error


@dataclass(frozen=True)
class Summary:
    """Figures of a flight, as `ortilo fly --json` writes them; a lost flight's errors cover the time up to its loss."""

    scenario: str
    """name of the scenario."""
    seed: Count
    """seed of all noise."""
    lost: Loss | None
    """time and cause of the loss; None for a flight that was not lost."""
    contacts: list[str]
    """furniture that the vehicle touched."""
    mse: dict[str, Error]
    """mean squared error of the estimated position per axis [m^2], see metrics.estimation_mse."""
    floor: dict[str, Error] | None
    """mean Cramer-Rao floor of `mse` per axis [m^2]; None where there is no floor."""
    efficiency: dict[str, Error | None]
    """mse over floor per axis [1]; None without a floor above 0."""
    tick_efficiency: dict[str, Error | None]
    """mean over ticks of the ratio squared error / floor, per axis [1]; None without a floor above 0."""
    path_mse: Error | None
    """see metrics.path_mse [m^2]; None where it is not defined."""
    path_distance_mse: Error
    """see metrics.path_distance_mse [m^2]."""
    max_path_distance: Error
    """largest distance from the path [m]."""
    max_reference_distance: Error
    """largest distance from the reference r_k [m]."""
    arrivals: dict[str, Error | None]
    """used / due measurements by sensor [1]; None for a sensor that is never due."""
    fix_errors: dict[str, FixError]
    """errors of the position fixes by sensor."""
    nees: float
    """mean of metrics.position_nees, 3 if the filter is consistent."""
    nis: dict[str, float]
    """mean of metrics.nis by sensor."""
    player: str | None
    """player of the flight, see players.py; None where it is unknown, as for a log."""
    real_time_factor: Error
    """simulated over wall time [1]; NaN where wall time was not measured."""


_SUMMARY: Final = TypeAdapter(Summary)


def summary_text(summary: Summary) -> str:
    """Return a summary as JSON, which read_summary reads."""
    return json.dumps(asdict(summary))


def read_summary(text: str | bytes) -> Summary:
    """Return the summary that summary_text wrote; ValueError if the text is no such summary."""
    return _SUMMARY.validate_json(text, strict=True)
