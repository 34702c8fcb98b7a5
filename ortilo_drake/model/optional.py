"""Packages that only some users need."""

import importlib.util

from ortilo_drake.model.typed_yaml import InputError


def check_installed(package: str, extra: str) -> None:
    """Check that an optional package is there.

    Raises:
        InputError: naming the extra that brings it.
    """
    if importlib.util.find_spec(package) is None:
        raise InputError(f"{package}: is not installed, needed for this: pip install 'ortilo-drake[{extra}]'")
