"""Settings and fixtures of all tests: Hypothesis' profile, skips without EGL, separate buses, flights flown only once.

Hypothesis uses the same examples in every run, and has no deadline, because numba compiles. Profiles that a test file
registers start from this profile and keep its settings.
"""

import gc
import hashlib
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from filelock import FileLock
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_configure() -> None:
    """Handle SIGINT as in a terminal; a shell makes background jobs ignore SIGINT."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Let Python collect garbage less often, and not among the thousands of tests and modules.

    Otherwise a seventh of numba's compile time goes into garbage collection.
    """
    gc.freeze()
    gc.set_threshold(100_000, 50, 50)


NIGHTLY = ("notebook", "training", "real_time", "video", "long")  # marks of tests that `make test` leaves out


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --part K/N: of the tests with a mark of NIGHTLY, run every N-th, from the K-th on; run all other tests."""
    parser.addoption("--part", metavar="K/N", default="0/1", help="run every N-th of the nightly tests, from K (0 ...)")


def shorten_families(items: list[pytest.Item]) -> None:
    """Mark `long` all cases of each test marked `family`, except the case that the mark names, or else the first case.

    The first case is the first in the file, even if pytest-randomly has already changed the order.
    """
    families: dict[str, list[pytest.Function]] = {}
    for item in items:
        if isinstance(item, pytest.Function) and item.get_closest_marker("family"):
            families.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in families.values():
        named = [case for case in cases for mark in case.iter_markers("family") if case.callspec.id in mark.args]
        for case in cases:
            if case is not min(named or cases, key=lambda its: tuple(its.callspec.indices.values())):
                case.add_marker("long")


@pytest.hookimpl(wrapper=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Iterator[None]:
    """Leave out the nightly tests of other parts, and run real-time tests and notebooks first.

    xdist gives each of two workers half of the list. One half begins with the real-time tests, which run one at a time,
    the other half with the notebooks: both take long and should not be left for the end.
    """
    shorten_families(items)
    yield  # pytest-randomly changes the order here
    first_of, parts = map(int, config.getoption("part").split("/"))
    nightly = [item for item in items if any(map(item.get_closest_marker, NIGHTLY))]
    nightly.sort(key=lambda item: item.nodeid)
    left_out = {*nightly} - {*nightly[first_of::parts]}
    config.hook.pytest_deselected(items=[*left_out])
    items[:] = [item for item in items if item not in left_out]
    clock = [item for item in items if item.get_closest_marker("real_time")]
    notebooks = [item for item in items if item.get_closest_marker("notebook")]
    first = {*clock, *notebooks}
    others = [item for item in items if item not in first]
    half = max(0, len(items) // 2 - len(clock))
    items[:] = [*clock, *others[:half], *notebooks, *others[half:]]


@pytest.hookimpl(tryfirst=True)  # before the fixtures, which may draw pictures too
def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("egl"):
        from ortilo_drake.model.typed_yaml import InputError
        from ortilo_drake.world.scenery.rendering import check_egl

        try:
            check_egl()
        except InputError:
            pytest.skip("libEGL.so.1 or its driver is missing (Debian: libegl1 libgl1-mesa-dri): nothing can be drawn")


@pytest.fixture(scope="session")
def workers_folder(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder that all workers of this run share."""
    folder = tmp_path_factory.getbasetemp()
    return folder if worker_id == "master" else folder.parent


@pytest.fixture(scope="session")
def flown(workers_folder: Path) -> Callable[..., xr.Dataset]:
    """A function that returns the flight of load_scenario's arguments; all workers together fly each flight once."""
    from ortilo_drake.flight.flight import fly
    from ortilo_drake.flight.saved_flight import load_flight, save_flight
    from ortilo_drake.scenario import load_scenario

    def flight_of(name: str, changes: tuple[str, ...] = (), seed: int | None = None) -> xr.Dataset:
        scenario = load_scenario(name, changes, seed)
        file = workers_folder / f"{hashlib.sha256(scenario.model_dump_json().encode()).hexdigest()}.nc"
        with FileLock(f"{file}.lock"):
            if not file.exists():
                save_flight(fly(scenario), file)
            return load_flight(file)

    return flight_of


@pytest.fixture(autouse=True)
def one_in_real_time(request: pytest.FixtureRequest, workers_folder: Path) -> Iterator[None]:
    """Run only one real-time test at a time: two would compete for the processor."""
    if not request.node.get_closest_marker("real_time"):
        yield
        return
    with FileLock(workers_folder / "real_time.lock"):
        yield


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """Check that a test leaves the signal handlers unchanged, because later tests send these signals."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    after = [signal.getsignal(number) for number in numbers]
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    assert after == before


@pytest.fixture(autouse=True, scope="session")
def own_settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Use an empty folder in place of the settings folder of the user who runs the tests, which holds a key."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield


@pytest.fixture
def own_register(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give a test its own register of parts: a part that stays registered would change the flights of later tests."""
    from ortilo_drake.model import parts

    before = set(sys.modules)

    parts.known_sensors()  # loads the installed parts
    for name, own in (
        ("_SENSORS", dict(parts._SENSORS)),
        ("_PARTS", dict(parts._PARTS)),
        ("_FILES", list(parts._FILES)),
    ):
        monkeypatch.setattr(parts, name, own)
    yield
    for name in set(sys.modules) - before:
        if name.startswith("ortilo_plugin_"):  # removed so that the next test runs the file again
            del sys.modules[name]


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The URL of a bus that only this test uses; halves in this process wait for each other with much patience."""
    from hil_link import own_bus
    from waiting import HANGS

    for module in ("bridge", "lockstep_link", "real_time.real_time_onboard"):
        monkeypatch.setattr(f"ortilo_drake.hil.{module}.PATIENCE", HANGS)
    with own_bus() as url:
        yield url


@pytest.fixture
def other_bus() -> Iterator[str]:
    """The URL of a second bus that only this test uses."""
    from hil_link import own_bus

    with own_bus() as url:
        yield url


@pytest.fixture
def drawn_figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The list of figures that a test draws; no figure is written to a file."""
    made: list[Any] = []
    monkeypatch.setattr("ortilo_drake.views.pictures.save_picture", lambda figure, path: made.append(figure))
    return made
