"""A Python file outside of packages, loaded as a module."""

import importlib.util
from pathlib import Path
from types import ModuleType


def module_of(file: Path, prefix: str = "") -> ModuleType:
    """Run a file and return it as a module; the module's name is the file's name behind a prefix."""
    spec = importlib.util.spec_from_file_location(f"{prefix}{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
