"""What all tests share: Hypothesis' settings, pictures or none, buses of their own, flights that are flown once.

Hypothesis takes the same examples in every run, and lets numba compile. Profiles that a test file registers itself
start from this one, so they keep its settings.
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
    """Take SIGINT as a terminal's process does: a shell that starts a job in the background has it ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Have Python look for unused cycles less often, and not among the thousands of tests and modules: a seventh of the
    time in which numba compiles went there.
    """
    gc.freeze()
    gc.set_threshold(100_000, 50, 50)


NIGHTLY = ("notebook", "training", "real_time", "video", "long")  # what `make nightly` runs and `make test` does not


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --part K/N: of the tests with a mark of NIGHTLY every N-th, from the K-th on; the others are all run."""
    parser.addoption("--part", metavar="K/N", default="0/1", help="run every N-th of the nightly tests, from K (0 ...)")


def shorten_families(items: list[pytest.Item]) -> None:
    """Mark `long` all cases but one of each test that is marked `family`: the one that it names, or else the first.

    The first in the file, in whichever order they run: pytest-randomly may have mixed them before.
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
    """Leave out the other parts' nightly tests, and put first what flies by the clock and the notebooks.

    Of two workers one begins with the first, one at a time, the other with the second: xdist gives each worker half of
    the list to begin with. Both take long: neither should be what is left at the end.
    """
    shorten_families(items)
    yield  # the order becomes random
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


@pytest.hookimpl(tryfirst=True)  # before the fixtures, which draw as well
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
    """A folder that the workers of this run have in common."""
    folder = tmp_path_factory.getbasetemp()
    return folder if worker_id == "master" else folder.parent


@pytest.fixture(scope="session")
def flown(workers_folder: Path) -> Callable[..., xr.Dataset]:
    """A function that returns the flight of load_scenario's arguments, flown once whichever worker asks first."""
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
    """Two flights by the clock would take each other's processor."""
    if not request.node.get_closest_marker("real_time"):
        yield
        return
    with FileLock(workers_folder / "real_time.lock"):
        yield


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """No test leaves signals otherwise than it found them: the next ones send them."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    after = [signal.getsignal(number) for number in numbers]
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    assert after == before


@pytest.fixture(autouse=True, scope="session")
def own_settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder for the settings of a user who runs the tests, not that user's own: there is the halves' key."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path_factory.mktemp("config")))
        yield


@pytest.fixture
def own_register(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Give a test a register of its own: a part that stays registered is another program to what flies later."""
    from ortilo_drake.model import parts

    before = set(sys.modules)

    parts.known_sensors()  # loads what is installed
    for name, own in (
        ("_SENSORS", dict(parts._SENSORS)),
        ("_PARTS", dict(parts._PARTS)),
        ("_FILES", list(parts._FILES)),
    ):
        monkeypatch.setattr(parts, name, own)
    yield
    for name in set(sys.modules) - before:
        if name.startswith("ortilo_plugin_"):  # so that the next test runs the file again
            del sys.modules[name]


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The URL of a bus that is this test's alone; halves in this process wait for each other as long as it takes."""
    from hil_link import own_bus
    from waiting import HANGS

    for module in ("bridge", "lockstep_link", "real_time.real_time_onboard"):
        monkeypatch.setattr(f"ortilo_drake.hil.{module}.PATIENCE", HANGS)
    with own_bus() as url:
        yield url


@pytest.fixture
def other_bus() -> Iterator[str]:
    """A second one."""
    from hil_link import own_bus

    with own_bus() as url:
        yield url


@pytest.fixture
def drawn_figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The figures that are drawn to be written, which none is."""
    made: list[Any] = []
    monkeypatch.setattr("ortilo_drake.views.pictures.save_picture", lambda figure, path: made.append(figure))
    return made
