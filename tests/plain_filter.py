"""The filter of recordings as plain Python: on a few seconds it takes less time than to compile it."""

from types import ModuleType

import pytest

from ortilo_drake.loop.plain import plain_source


def run_plainly(monkeypatch: pytest.MonkeyPatch, module: ModuleType, *names: str) -> None:
    """Put the plain source of compiled functions in their place in a module."""
    for name in names:
        monkeypatch.setattr(module, name, plain_source(getattr(module, name)))
