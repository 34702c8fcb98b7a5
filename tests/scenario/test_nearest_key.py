"""Keys that do not exist are answered with those that do, and rates that do not divide with a tick that they do."""

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.inputs.nearest_key import keys_of
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.link import check_rate
from ortilo_drake.scenario.schema import scenario_schema


@pytest.mark.parametrize(
    ("setting", "meant"),
    [
        ("uwb.rate=20", "'uwb.link.rate'"),  # moved into a group of the group
        ("camera.loss=0.2", "'camera.link.loss'"),
        ("force_density=0.1", "'world.disturbance.force_density'"),  # two groups down, of several
        ("disturbance.force_density=0.1", "'world.disturbance.force_density'"),
        ("gates.uwb=0.9", "'estimator.gates.uwb'"),
        (
            "estimator.ranges.noise.sd=0.1",
            "'estimator.ranges.noise.sd' (kind tight, affine or tight, constant)",
        ),  # of another kind
        ("estimator.huber=3", "kind tight, which has 'estimator.huber'"),
        ("estimator.horizn=0.2", "'horizon'"),  # mistyped
        ("torque_densityd=0.1", "'world.disturbance.torque_density'"),  # mistyped, and in another group
    ],
)
def test_an_unknown_key_is_answered_with_the_one_that_was_meant(setting: str, meant: str) -> None:
    with pytest.raises(InputError, match=rf"unknown key .*did you mean .*{re.escape(meant)}"):
        load_scenario("imu_uwb", (setting,))


def test_a_key_of_no_likeness_is_answered_with_what_its_group_has() -> None:
    with pytest.raises(InputError, match=r"uwb\.link\.zzz: unknown key .*known are rate, loss, blackouts, delay"):
        load_scenario("imu_uwb", ("uwb.link.zzz=1",))
    with pytest.raises(InputError, match=r"'flow\.gyro_sd'\? imu has link, standstill, angle_density, rate_density"):
        load_scenario("imu_uwb", ("imu.gyro_sd=1",))


KEYS = keys_of(scenario_schema())
SETTABLE = sorted({key.words for key in KEYS if len(key.words) > 2 and key.words[-1] != "kind"})


@pytest.mark.long
@settings(max_examples=40)
@given(st.sampled_from(SETTABLE))
def test_a_key_without_the_group_it_is_in_is_answered_in_full(words: tuple[str, ...]) -> None:
    """As `uwb.rate` for `uwb.link.rate`: where only one key of the group ends so, it is the one named."""
    group, last = words[0], words[-1]
    alike = {w for w in SETTABLE if w[0] == group and w[-1] == last} | {w for w in SETTABLE if w[:2] == (group, last)}
    siblings = {key.words[1] for key in KEYS if len(key.words) > 1 and key.words[0] == group}
    if len(alike) == 1 and last not in siblings:
        with pytest.raises(InputError) as refused:
            load_scenario("imu_uwb", (f"{group}.{last}=1",))
        assert f"did you mean '{'.'.join(words)}'" in str(refused.value)


@given(st.integers(1, 120), st.sampled_from([10, 25, 30, 50, 100]))
def test_a_rate_that_does_not_divide_is_answered_with_a_control_rate_that_it_divides(rate: int, ticks: int) -> None:
    try:
        check_rate("uwb", float(rate), float(ticks))
        assert ticks % rate == 0
        return
    except ValueError as refused:
        assert ticks % rate != 0
        hint = re.search(r"set control_rate: (\d+), which allows it", str(refused))
    if hint is None:
        assert all(n * ticks % rate for n in range(1, 1000 // ticks + 1))
    else:
        assert int(hint[1]) % rate == int(hint[1]) % ticks == 0
        check_rate("uwb", float(rate), float(hint[1]))


def test_twenty_hertz_are_answered_with_sixty_ticks() -> None:
    with pytest.raises(InputError, match=r"uwb\.link\.rate: 20\.0: .*set control_rate: 60, which allows it"):
        load_scenario("imu_uwb", ("uwb.link.rate=20",))
    with pytest.raises(InputError, match=r"report_link\.rate: 20\.0: .*set control_rate: 60, which allows it"):
        load_scenario("imu_uwb", ("report_link.rate=20",))
