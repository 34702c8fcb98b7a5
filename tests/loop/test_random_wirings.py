"""Wirings of any boxes in any order: a tick's order, and what is refused in which words."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.loop.element import Box, Element, Values, bundle
from ortilo_drake.loop.wiring import Wire, Wiring


def sum_out(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """Say a + b."""
    out[0] = a[0] + b[0]


def kept_step(a: np.ndarray, b: np.ndarray, x: np.ndarray) -> None:
    """Keep a + b."""
    x[0] = a[0] + b[0]


SUM = Element("sum", out=sum_out)
KEPT = Element("kept", step=kept_step, shows="x")


def kept(name: str, a: str, b: str) -> Box:
    return Box(name, KEPT, 1, Values(start={"x": np.zeros(1)}), reads={"a": a, "b": b})


@st.composite
def wirings(draw: st.DrawFn) -> list[Box]:
    """Return boxes in any order; sums read boxes before them, so that there is no circle, states read sums."""
    count = draw(st.integers(1, 8))
    names = [f"box_{i}" for i in range(count)]
    boxes = [kept("start", "start", "start")]
    for i, name in enumerate(names):
        before = st.sampled_from(["start", *names[:i]])
        a, b = draw(before), draw(before)
        boxes.append(Box(name, SUM, 1, reads={"a": a, "b": b}) if draw(st.booleans()) else kept(name, a, b))
    order = draw(st.permutations(range(len(boxes))))
    return [boxes[i] for i in order]


@pytest.mark.long
@given(wirings())
def test_who_computes_comes_after_whom_it_reads_and_who_reads_a_state_before_whose_it_is(boxes: list[Box]) -> None:
    wiring = Wiring(boxes)
    outs, steps = [box.name for box in wiring.out_order], [box.name for box in wiring.step_order]
    assert sorted(outs) == sorted(box.name for box in boxes if box.element is SUM)
    assert sorted(steps) == sorted(box.name for box in boxes if box.element is not SUM)
    for box in boxes:
        for read in set(box.reads.values()) - {box.name}:
            if box.element is SUM and read in outs:
                assert outs.index(read) < outs.index(box.name)
            if box.element is not SUM and read in steps:
                assert steps.index(box.name) < steps.index(read)


@pytest.mark.long
@given(wirings(), st.randoms(use_true_random=False))
def test_the_order_of_a_tick_does_not_depend_on_the_order_of_the_boxes(boxes: list[Box], random: object) -> None:
    again = list(boxes)
    random.shuffle(again)  # type: ignore[attr-defined]
    one, other = Wiring(boxes), Wiring(again)
    assert [box.name for box in one.out_order] == [box.name for box in other.out_order]
    assert [box.name for box in one.step_order] == [box.name for box in other.step_order]


def refused(boxes: list[Box], said: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        Wiring(boxes)


@pytest.mark.long
@given(wirings(), st.data())
def test_what_is_read_must_be_there(boxes: list[Box], data: st.DataObject) -> None:
    gone = data.draw(st.sampled_from(boxes))
    left = [box for box in boxes if box is not gone]
    readers = [(box.name, port) for box in left for port in ("a", "b") if box.reads[port] == gone.name]
    if not readers:
        Wiring(left)
        return
    name, port = readers[0]
    among = ", ".join(sorted(box.name for box in left))
    refused(left, f"{name}: {port}: reads '{gone.name}', must be one of {among}")


@pytest.mark.long
@given(wirings(), st.data())
def test_a_part_that_is_read_must_be_one(boxes: list[Box], data: st.DataObject) -> None:
    i = data.draw(st.integers(0, len(boxes) - 1))
    port, part = data.draw(st.sampled_from("ab")), data.draw(st.sampled_from(["x", "delta", ""]))
    read = boxes[i].reads[port]
    boxes = [*boxes[:i], boxes[i].with_inputs(**{port: f"{read}.{part}"}), *boxes[i + 1 :]]
    if not part:  # the whole
        Wiring(boxes)
        return
    refused(boxes, f"{boxes[i].name}: {port}: reads '{read}.{part}', must be a part of it: ")


@given(wirings(), st.data())
def test_every_box_needs_a_name_of_its_own(boxes: list[Box], data: st.DataObject) -> None:
    twice = [*boxes, data.draw(st.sampled_from(boxes))]
    among = ", ".join(sorted(box.name for box in twice))
    refused(twice, f"wiring: two boxes have one name among {among}")


@given(st.integers(1, 6))
def test_outputs_in_a_circle_of_any_length_are_refused(length: int) -> None:
    circle = [Box(f"box_{i}", SUM, 1, reads=dict.fromkeys("ab", f"box_{(i + 1) % length}")) for i in range(length)]
    with pytest.raises(ValueError, match=r"^wiring: box_.* must not read each other in a tick$"):
        Wiring(circle)


@given(st.integers(1, 6))
def test_states_in_a_circle_step_one_after_the_other_only_if_that_is_possible(length: int) -> None:
    """Each would have to step before the next one, all around; alone a box may read its own state."""
    circle = [kept(f"box_{i}", *[f"box_{(i + 1) % length}"] * 2) for i in range(length)]
    if length == 1:
        assert [box.name for box in Wiring(circle).step_order] == ["box_0"]
        return
    with pytest.raises(ValueError, match=r"must not read each other in a tick$"):
        Wiring(circle)


@pytest.mark.long
@given(st.lists(st.integers(1, 5), min_size=1, max_size=5), st.data())
def test_a_bundle_says_one_box_after_the_other(sizes: list[int], data: st.DataObject) -> None:
    def ones_out(out: np.ndarray) -> None:
        out[:] = 1.0

    ones = Element("ones", out=ones_out)
    held = [Box(f"box_{i}", ones, size) for i, size in enumerate(sizes)]
    whole = bundle("whole", held)
    i = data.draw(st.integers(0, len(sizes) - 1))
    wiring = Wiring([whole, Box("sum", SUM, 1, reads={"a": "whole", "b": f"whole.box_{i}"}), *held])
    assert wiring.wires["sum", "a"] == Wire("whole", 0, sum(sizes))
    assert wiring.wires["sum", "b"] == Wire("whole", sum(sizes[:i]), sizes[i])
    assert [box.name for box in wiring.out_order][-1] == "sum"
