"""Hypothesis for the whole suite: the same examples in every run, and time for numba to compile; and pictures.

Profiles that a test file registers itself start from this one, so they keep its settings.
"""

from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "egl: draws pictures; skipped where libEGL or a driver for it is missing")


@pytest.hookimpl(tryfirst=True)  # before the fixtures, which draw as well
def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("egl"):
        from ortilo_drake.model.typed_yaml import InputError
        from ortilo_drake.world.rendering import check_egl

        try:
            check_egl()
        except InputError:
            pytest.skip("libEGL.so.1 or its driver is missing (Debian: libegl1 libgl1-mesa-dri): nothing can be drawn")


@pytest.fixture
def bus() -> Iterator[str]:
    """The URL of a bus that is this test's alone."""
    from hil_link import own_bus

    with own_bus() as url:
        yield url


@pytest.fixture
def other_bus() -> Iterator[str]:
    """A second one."""
    from hil_link import own_bus

    with own_bus() as url:
        yield url
