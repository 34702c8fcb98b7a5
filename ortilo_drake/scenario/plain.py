"""Python values as the plain data of a scenario file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from ortilo_drake.model.typed_yaml import InputError


def plain_value(field: str, value: Any) -> Any:
    """Return a value as reading YAML would give it; InputError naming the field if YAML cannot hold the value."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain_value(f"{field}.{key}", part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(f"{field}.{k}", part) for k, part in enumerate(value)]
    if isinstance(value, None | bool | int | float | str):
        return value
    raise InputError(
        f"{field}: {str(value)[:60]}: must be a number, text, list, dict, path, NumPy array or settings of a scenario, "
        f"not a {type(value).__name__}"
    )
