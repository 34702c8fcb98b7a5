"""A Python file that is in no package, as a module."""

import importlib.util
from pathlib import Path
from types import ModuleType


def module_of(file: Path, prefix: str = "") -> ModuleType:
    """Run a file and return it as a module of its own name, behind a prefix."""
    spec = importlib.util.spec_from_file_location(f"{prefix}{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
