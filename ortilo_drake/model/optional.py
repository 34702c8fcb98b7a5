"""Packages that only some users need: the extra that installs each one, and modules that are imported at first use."""

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
    """Check that an optional package is installed; InputError names the extra that installs it."""
    if not is_installed(package):
        raise missing(package, extra)


def missing(package: str, extra: str) -> InputError:
    """Return the InputError for a missing package; it names the extra that installs the package."""
    return InputError(f"{package}: is not installed, needed for this: pip install 'ortilo-drake[{extra}]'")


class _Later:
    """A module of an extra that is imported when one of its attributes is first used."""

    def __init__(self, name: str):
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):  # inspecting a module's names must not import the package
            raise AttributeError(attribute)
        package = self._name.partition(".")[0]
        check_installed(package, EXTRAS[package])
        return getattr(importlib.import_module(self._name), attribute)


def later(name: str) -> Any:
    """Return a module of one of the EXTRAS, for use in place of `import name`.

    The first use of the module raises an InputError that names the extra, if the package is not installed.
    """
    return _Later(name)
