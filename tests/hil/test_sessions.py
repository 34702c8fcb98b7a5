"""What a session asks of its bus."""

import pytest
from hil_link import KEY, refuses

from ortilo_drake.hil import sessions
from ortilo_drake.scenario import load_scenario


@pytest.mark.parametrize(("camera", "size"), [("projected", 2**17), ("rendered", 2**20)])
def test_a_stranger_fills_no_more_of_the_worlds_memory_than_its_flights_packets(
    bus: str, monkeypatch: pytest.MonkeyPatch, camera: str, size: int
) -> None:
    """A world without pictures takes 64 KiB at once, one with pictures of 320 x 240 px ten times as much."""
    scenario = load_scenario("nominal_imu_uwb_yolo", (f"camera.kind={camera}", "camera.width=320"))

    def attack(*args: object) -> None:
        """Stands in for what the session makes next, once its bus is there."""
        assert refuses(bus, size)
        raise KeyboardInterrupt

    monkeypatch.setattr(sessions, "Greeter", attack)
    with pytest.raises(KeyboardInterrupt):
        sessions.run_world(scenario, bus, KEY, lockstep=True, wait=1.0)
