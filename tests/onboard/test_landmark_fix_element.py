"""The landmark fix as an element: OpenCV's boxes give the pose that they were seen from."""

import numpy as np
import pytest
from plain_box import PlainBox
from seen_landmarks import EACH, EXACT, PNP, ROOM, covariance, shown_message, state

from ortilo_drake.model.signals import ARRIVED, DETECTIONS_SIZE, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.box_fix import DOUBLINGS
from ortilo_drake.onboard.landmarks.fix_element import camera_fix_box
from ortilo_drake.scenario import LandmarkFix as Settings

VALUES = {"known_tilt": [0, 1, 2, 5], "pose": [0, 1, 2, 3, 4, 5]}
NOTHING = np.zeros(DETECTIONS_SIZE)


def fix(method: str, **settings: object) -> PlainBox:
    return PlainBox(camera_fix_box(Settings(method=method, **settings), ROOM, 320))


def belief(away: tuple[float, float, float] = (0.0, 0.0, 0.0), position_sd: float = 0.1) -> np.ndarray:
    xhat = state()
    xhat[:3] += away
    return np.concatenate((xhat, covariance(position_sd)))


@pytest.mark.parametrize("method", [method for method in EACH if method is not PNP])
def test_the_fix_of_boxes_is_where_they_were_seen_from(method: str) -> None:
    its, where = fix(method), VALUES.get(method, [0, 1, 2])
    found = its.say(message=shown_message(EXACT, stamp=0.4), belief=belief((0.1, -0.05, 0.05)))
    assert (found[ARRIVED], found[STAMP]) == (1.0, 0.4)
    np.testing.assert_allclose(found[PAYLOAD : PAYLOAD + len(where)], np.array(EXACT)[where], atol=1e-5)
    assert not its.say(message=NOTHING, belief=belief()).any()


def test_a_prior_stands_in_for_the_covariance() -> None:
    sure = np.concatenate((state(), np.zeros(225)))
    prior = (0.1, 0.004)
    found = fix("known_attitude", prior_sd=prior).say(message=shown_message(EXACT), belief=sure)
    plain = fix("known_attitude").say(message=shown_message(EXACT), belief=belief())
    np.testing.assert_allclose(found, plain, rtol=1e-9, atol=1e-12)  # covariance() is that of the prior


def test_refused_images_are_counted_until_the_estimate_is_found_again() -> None:
    """0.4 m off with an sd of 0.05 m: each image without a fix counts one more, each fix one less."""
    its, away, there = fix("pose", center_sd=1.0, joint=0.999), belief((0.0, 0.4, 0.0), position_sd=0.05), []
    expected = 0.0
    for _ in range(DOUBLINGS + 2):
        found = its.say(message=shown_message(EXACT), belief=away)
        there.append(found[ARRIVED] == 1.0)
        its.step(message=shown_message(EXACT), belief=away)
        expected += -1.0 if there[-1] else 1.0
        assert its.state["refused"][0] == expected
    assert not there[0]
    assert any(there)
    its.state["refused"][0] = DOUBLINGS
    found = its.say(message=shown_message(EXACT), belief=away)
    np.testing.assert_allclose(found[PAYLOAD : PAYLOAD + 3], EXACT[:3], atol=1e-3)
    its.step(message=NOTHING, belief=away)
    assert its.state["refused"][0] == DOUBLINGS


def test_without_the_joint_test_no_image_is_counted() -> None:
    its, away = fix("pose", center_sd=1.0), belief((0.0, 0.4, 0.0), position_sd=0.05)
    assert not its.say(message=shown_message(EXACT), belief=away).any()
    its.step(message=shown_message(EXACT), belief=away)
    assert its.state["refused"][0] == 0.0
