"""Packages that only some users need: which extra brings each, and modules that are imported when first used."""

import importlib
import importlib.util
from typing import Any, Final

from ortilo_drake.model.typed_yaml import InputError

EXTRAS: Final = {
    "cv2": "camera",
    "mcap": "log",
    "rosbags": "log",
    "zstandard": "log",
    "pyarrow": "map",
    "distributed": "workers",
    "dask": "workers",
    "cryptography": "workers",
}


def is_installed(package: str) -> bool:
    """Return whether a package can be imported."""
    return importlib.util.find_spec(package) is not None


def check_installed(package: str, extra: str) -> None:
    """Check that an optional package is there; InputError names the extra that brings it."""
    if not is_installed(package):
        raise missing(package, extra)


def missing(package: str, extra: str) -> InputError:
    """Return the line that names the extra with a package."""
    return InputError(f"{package}: is not installed, needed for this: pip install 'ortilo-drake[{extra}]'")


class _Later:
    """A module of an extra that is imported when something of it is first used."""

    def __init__(self, name: str):
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):  # whoever looks at a module's names imports nothing
            raise AttributeError(attribute)
        package = self._name.partition(".")[0]
        check_installed(package, EXTRAS[package])
        return getattr(importlib.import_module(self._name), attribute)


def later(name: str) -> Any:
    """Return a module of one of the EXTRAS, in the place of `import name`.

    The first use of it raises an InputError naming the extra where that is not installed.
    """
    return _Later(name)
