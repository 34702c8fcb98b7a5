"""The messages' layouts, as the head of model/signals.py gives them."""

from ortilo_drake.model import signals


def test_messages_are_arrived_and_stamp_and_then_what_they_carry() -> None:
    header = 2
    assert header == signals.PAYLOAD
    assert header + 3 + 3 + 3 == signals.IMU_SIZE  # attitude, w_WB_B and f_B
    assert header + 3 + 3 * 3 == signals.FIX_SIZE  # p_WB and its covariance
    assert len(("class", "score", "left", "top", "right", "bottom")) == signals.DETECTION_SIZE
    assert header + 32 * 6 == signals.DETECTIONS_SIZE
