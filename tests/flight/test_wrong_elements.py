"""What an element of one's own does wrong ends in one line, by every player, and in no memory but its own."""

import re
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest
from command_line import run
from numba import njit

import ortilo_drake as od
from ortilo_drake.flight.players import player_of
from ortilo_drake.loop.raised import ElementError

pytestmark = pytest.mark.usefixtures("own_register")
SHORT = {"planner": {"kind": "hover", "duration": 1.0}, "settle": 0.0}


class Own(od.Frozen):
    """Settings of a servo."""

    kind: Literal["own"]


def reads_beyond(uwb: np.ndarray, out: np.ndarray) -> None:
    out[:] = 0.0
    if uwb[0] != 0.0:  # of zeros, by which the functions are tried in Python, it is not seen
        out[0] = uwb[4000]


def writes_beyond(uwb: np.ndarray, out: np.ndarray) -> None:
    out[:] = 0.0
    if uwb[0] != 0.0:
        out[4] = 1.0


def writes_all(estimate: np.ndarray, out: np.ndarray) -> None:
    out[:] = estimate


def raises(uwb: np.ndarray, out: np.ndarray) -> None:
    out[:] = 0.0
    if uwb[0] != 0.0:
        raise ValueError("too far")


def steps_beyond(uwb: np.ndarray, kept: np.ndarray) -> None:
    kept[int(uwb[0]) * 4] = 1.0


@pytest.mark.long
@pytest.mark.parametrize("player", ["engine", "drake", "drake-elements"])
@pytest.mark.parametrize(
    ("function", "said"),
    [
        (reads_beyond, "IndexError: index is out of bounds"),
        (writes_beyond, "IndexError: index is out of bounds"),
        (steps_beyond, "IndexError: index is out of bounds"),
        (writes_all, "ValueError: cannot assign slice from input of different size"),
        (raises, "ValueError: too far"),
    ],
)
def test_what_goes_wrong_in_flight_is_told_in_a_line(function: Any, said: str, player: str) -> None:
    if function is steps_beyond:
        made = od.box(4, step=function, state={"kept": np.zeros(4)}, shows="kept")
    else:
        made = od.box(4, function)
    od.register_servo("own", Own, box=lambda belief: made)
    scenario = od.load_scenario("nominal_imu_uwb", servo={"kind": "own"}, **SHORT)
    place = rf"{function.__name__} \(test_wrong_elements\.py, line {function.__code__.co_firstlineno}\)"
    for _ in range(2):  # what the first flight raised is not the second one's
        with pytest.raises(ElementError, match=f"^{place}: {said}$"):
            player_of(scenario, player).fly(0)


@pytest.mark.long
def test_a_flight_after_one_that_raised_is_not_blamed() -> None:
    od.register_servo("own", Own, box=lambda belief: od.box(4, raises))
    wrong, right = (
        od.Engine(od.load_scenario("nominal_imu_uwb", **SHORT, **its)) for its in ({"servo": {"kind": "own"}}, {})
    )
    with pytest.raises(ElementError):
        wrong.figures([0, 1], threads=2)
    assert right.figures([0])[0, right.columns.index("cause")] == -1.0


MODULE = """
from typing import Literal
import ortilo_drake as od

class Own(od.Frozen):
    kind: Literal["own"]

def say(n, estimate, out):
    out[:] = 0.0
    out[0] = float("3" + str(n.gain))

od.register_servo("own", Own, box=lambda belief: od.box(4, say, numbers={"gain": 1.0}))
"""


@pytest.mark.long
def test_what_numba_cannot_compile_is_told_by_the_command_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(MODULE)
    assert run("--plugin", str(tmp_path / "mine.py"), "fly", "nominal_imu_uwb", "--set", "servo.kind=own") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("ortilo: say (mine.py, line 8): numba cannot compile it: No implementation of function")
    assert line.endswith("in line 10")


def returns(estimate: np.ndarray, out: np.ndarray) -> np.ndarray:
    return np.zeros(4)


def writes(estimate: np.ndarray, out: np.ndarray) -> None:
    out[:] = 0.0


def fails(belief: od.Belief) -> od.Box:
    raise RuntimeError("no\nmotors")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (fails, r"RuntimeError: no\\nmotors"),
        (lambda belief: None, r"its box returns None: must return an od\.box"),
        (lambda belief: od.box(4, returns), "out: returns something: must write into `out` instead"),
        (lambda belief: od.box(4, writes, numbers={"gain": "high"}), "gain: is 'high', must be a number or an array.*"),
        (lambda belief: od.box(4, writes, numbers={"k": 1.0}), r"own: a value is named \['k'\], which is reserved"),
    ],
)
def test_a_part_that_cannot_be_made_is_told_with_its_field(make: Any, said: str) -> None:
    od.register_servo("own", Own, box=make)
    with pytest.raises(od.InputError, match=rf"^servo\.kind: own: {said}$"):
        od.Engine(od.load_scenario("nominal_imu_uwb", servo={"kind": "own"}, **SHORT))


class Numbers(NamedTuple):
    """The numbers of a sensor."""

    sd: float


@njit
def beyond_its_noise(its: Numbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return a height with noise that was not asked for."""
    return np.array([x[2] + its.sd * v[900]])


@njit
def too_many(its: Numbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return four values of a payload of one."""
    return np.array([x[2] + its.sd * v[0], 1e9, 1e9, 1e9])


class Height(od.SensorSettings):
    """Settings of a sensor of the height."""


def height_sd(scenario: od.Scenario, room: od.Room, states: np.ndarray) -> np.ndarray:
    return np.full((len(states), 1), 0.1)


@pytest.mark.long
@pytest.mark.parametrize("player", ["engine", "drake"])
@pytest.mark.parametrize(
    ("measure", "said"),
    [
        (beyond_its_noise, "IndexError: index is out of bounds"),
        (too_many, "ValueError: returns another number of values than its payload has"),
    ],
)
def test_a_sensor_s_function_stays_within_its_arrays(measure: Any, said: str, player: str) -> None:
    share = od.Compiled(lambda scenario, room: Numbers(0.1), payload=1, noises=1, measure=measure)
    rows, V = (od.row("z_own", z=1.0),), np.array([[0.01]])
    od.register_sensor(od.Sensor("height", Height, rows=rows, sd=height_sd, V=lambda scenario: V, compiled=share))
    scenario = od.load_scenario("nominal_imu_uwb", sensors=["uwb", "imu", "height"], **SHORT)
    with pytest.raises(ElementError, match=rf"^{measure.__name__} \(test_wrong_elements\.py, line \d+\): {said}$"):
        player_of(scenario, player).fly(0)


def test_a_row_with_the_name_of_its_sensor_is_refused_in_a_line() -> None:
    share = od.Compiled(lambda scenario, room: Numbers(0.1), payload=1, noises=1, measure=too_many)
    rows, V = (od.row("height", z=1.0),), np.array([[0.01]])
    od.register_sensor(od.Sensor("height", Height, rows=rows, sd=height_sd, V=lambda scenario: V, compiled=share))
    with pytest.raises(od.InputError, match=r"^sensors: .*height, .*, height: every sensor and every row needs a name"):
        od.Engine(od.load_scenario("nominal_imu_uwb", sensors=["uwb", "imu", "height"], **SHORT))


@njit
def without_time(its: Numbers, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return a height, of a function with too few parameters."""
    return np.array([x[2] + its.sd * v[0]])


@njit
def of_wind(its: Numbers, payload: np.ndarray, xhat: np.ndarray, P: np.ndarray, wind: float) -> np.ndarray:
    """Return a fix, of a function with an input that nobody has."""
    return np.array([payload[0] + wind, its.sd])


@pytest.mark.parametrize(
    ("measure", "solve", "said"),
    [
        (without_time, None, r"measure: too many positional arguments: must take \(numbers, x, v, t\)"),
        (beyond_its_noise, of_wind, "solve: missing .* 'wind': must take .numbers, payload, xhat, P."),
        (3.0, None, "measure: 3.0 is not a callable object: must take .numbers, x, v, t."),
    ],
)
def test_a_sensor_s_function_with_other_inputs_is_refused_in_a_line(measure: Any, solve: Any, said: str) -> None:
    share = od.Compiled(lambda scenario, room: Numbers(0.1), payload=1, noises=1, measure=measure, solve=solve)
    with pytest.raises(od.InputError, match=rf"^sensor: height: {said}$"):
        od.register_sensor(od.Sensor("height", Height, (od.row("z_own", z=1.0),), sd=height_sd, compiled=share))


@pytest.mark.parametrize("shape", [3, (2, -1), "ab", (2.5,)])
def test_a_work_array_needs_a_shape(shape: Any) -> None:
    said = f"w: {shape!r}: must be a shape, such as (3,) or (3, 3)"
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        od.box(4, writes, work={"w": shape})


def test_an_engine_takes_a_scenario_s_name_and_refuses_another_in_a_line() -> None:
    assert od.Engine("nominal_imu_uwb").ticks == od.Engine(od.load_scenario("nominal_imu_uwb")).ticks
    with pytest.raises(od.InputError, match=r"^scenario: 'nominal' is unknown"):
        od.Engine("nominal")
    with pytest.raises(od.InputError, match=r"^scenario: 3: must be a ready-made one's name or a \.yaml file$"):
        od.Engine(3)  # type: ignore[arg-type]
