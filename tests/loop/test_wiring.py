"""A wiring refuses what does not fit, and orders a tick."""

import re
from dataclasses import replace

import numpy as np
import pytest
from small_loop import boxes

from ortilo_drake.loop.calls import Reading
from ortilo_drake.loop.element import Box, Element, Values, bundle, outside
from ortilo_drake.loop.wiring import Wiring


def with_(name: str, **changes: object) -> list[Box]:
    return [replace(box, **changes) if box.name == name else box for box in boxes()]  # type: ignore[arg-type]


def test_outputs_come_after_what_they_read() -> None:
    wiring = Wiring(boxes())
    names = [box.name for box in wiring.out_order]
    assert names.index("sensor") < names.index("gain")
    assert [box.name for box in wiring.step_order] == ["mass"]


def test_what_depends_on_which_inputs_has_an_order_of_its_own_in_every_process() -> None:
    """Generated code is in that order, and is kept by its text: a set of names has another in each process."""
    names = [f"input_{letter}" for letter in "gdafcbe"]
    read = [
        replace(boxes()[0], name=f"of_{name}", reads=dict.fromkeys(boxes()[0].element.inputs, name)) for name in names
    ]
    groups = list(Reading(Wiring([*(outside(name, 2) for name in names), *read])).groups)
    assert groups == sorted(groups, key=sorted)
    assert len(groups) == len(names) + 2  # of none, of each, of all


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ([*boxes(), boxes()[0]], "wiring: two boxes have one name among gain, gain, mass, sensor, watch"),
        (with_("watch", reads={"x": "masss"}), "watch: x: reads 'masss', must be one of gain, mass, sensor, watch"),
        (with_("gain", reads={"y": "sensor.z"}), "gain: y: reads 'sensor.z', must be a part of it: y"),
        ([*boxes(), bundle("all", boxes()[2:])], "all: holds 'mass', which shows a state: must be a box with an `out`"),
        (with_("mass", given=Values({"h": 0.1})), "mass: shows 'x', must be one of its states: []"),
        (with_("mass", given=Values({"h": 0.1}, {"x": np.zeros(3)})), "mass: x: has 3 numbers, must have 2"),
    ],
)
def test_what_does_not_fit_is_refused(changed: list[Box], said: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        Wiring(changed)


def test_outputs_in_a_circle_are_refused() -> None:
    def echo_out(heard: np.ndarray, out: np.ndarray) -> None:
        out[0] = heard[0]

    echo = Element("echo", out=echo_out)
    circle = [Box("a", echo, 1, reads={"heard": "b"}), Box("b", echo, 1, reads={"heard": "a"})]
    with pytest.raises(ValueError, match="must not read each other in a tick"):
        Wiring(circle)


def test_a_reserved_name_is_refused() -> None:
    def odd_out(n: object, out: np.ndarray) -> None:
        out[0] = 0.0

    odd = Element("odd", out=odd_out)
    with pytest.raises(ValueError, match=r"odd: a value is named \['seed'\], which is reserved"):
        Wiring([Box("odd", odd, 1, Values({"a": 1.0}, tables={"seed": np.zeros(1)}))])


def test_a_part_beyond_its_box_is_refused() -> None:
    for part, said in (((1, 2), "[1, 3)"), ((-1, 1), "[-1, 0)")):
        with pytest.raises(ValueError, match=f"^{re.escape(f'mass.rate: is {said}, must be within [0, 2)')}$"):
            Wiring(with_("mass", parts={"rate": part}))
