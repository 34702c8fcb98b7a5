"""The filter of recordings as plain Python: for a few seconds of data this is faster than compiling the filter."""

from types import ModuleType

import pytest

from ortilo_drake.loop.plain import plain_source


def run_plainly(monkeypatch: pytest.MonkeyPatch, module: ModuleType, *names: str) -> None:
    """Replace compiled functions in a module by their plain source."""
    for name in names:
        monkeypatch.setattr(module, name, plain_source(getattr(module, name)))
