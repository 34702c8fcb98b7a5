"""Reports as plain data, for JSON."""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from pydantic import BaseModel


def as_data(report: Any) -> Any:
    """Return a report as JSON's types: dictionaries, lists, text, numbers, None.

    A dataclass becomes a dictionary of its fields in their order, and so do settings of a scenario. Arrays and tuples
    become lists, a complex number becomes [real, imaginary], NaN and infinity become None.
    """
    if isinstance(report, BaseModel):
        return report.model_dump(mode="json")
    if is_dataclass(report):
        return {field.name: as_data(getattr(report, field.name)) for field in fields(report)}
    if isinstance(report, Mapping):
        return {key: as_data(value) for key, value in report.items()}
    if isinstance(report, list | tuple):
        return [as_data(value) for value in report]
    if isinstance(report, np.ndarray | np.generic):
        return as_data(report.tolist())
    if isinstance(report, complex):
        return [report.real, report.imag]
    return None if isinstance(report, float) and not math.isfinite(report) else report
