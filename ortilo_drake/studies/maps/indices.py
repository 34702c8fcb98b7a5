"""Sobol's indices: what share of a figure's variance over the ranges each setting makes, alone and with the others."""

from typing import NamedTuple

import numpy as np
from scipy.stats import sobol_indices

from ortilo_drake.studies.maps.map_flights import Map, MapPoint
from ortilo_drake.studies.maps.sweep import Sensitivity


class Index(NamedTuple):
    """Indices of a setting.

    Attributes:
        figure: of what.
        setting: which one.
        first: share of the variance that it makes alone [1].
        total: share that would be left if all others were held [1].
    """

    figure: str
    setting: str
    first: float
    total: float


def indices_of(found: Map) -> list[Index]:
    """Return the indices of the share of lost flights and of the RMS error's logarithm; none for other designs.

    By Saltelli's estimators, SciPy's. A figure that is the same everywhere has none, nor has the error where at a point
    all flights were lost.
    """
    design = found.sweep.design
    if not isinstance(design, Sensitivity):
        return []
    n, settings = design.points, list(found.sweep.axes)
    figures = {
        "share of lost flights": [row.lost / row.flights for row in found.rows],
        "logarithm of the RMS error": [_log(row) for row in found.rows],
    }
    rows = []
    for name, values in figures.items():
        f = np.array(values)
        if not np.isfinite(f).all() or np.ptp(f[: 2 * n]) == 0.0:
            continue
        parts = {"f_A": f[None, :n], "f_B": f[None, n : 2 * n], "f_AB": f[2 * n :].reshape(len(settings), 1, n)}
        result = sobol_indices(func=parts, n=n)
        first, total = np.atleast_2d(result.first_order)[0], np.atleast_2d(result.total_order)[0]
        rows += [Index(name, *of) for of in zip(settings, first.tolist(), total.tolist(), strict=True)]
    return rows


def _log(row: MapPoint) -> float:
    return float(np.log(row.kept_rms)) if row.kept_rms else float("nan")
