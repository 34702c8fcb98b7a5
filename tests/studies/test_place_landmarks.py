"""Landmarks for a path: what one tells, where one may stand, and what placing them gives."""

from pathlib import Path

import numpy as np
import pytest
from example_rooms import example_room

from ortilo_drake.floor.cramer_rao import information_rows
from ortilo_drake.model.footprints import footprints
from ortilo_drake.model.room import Landmark, Room, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.room_design.path_bound import step_information
from ortilo_drake.studies.room_design.place import (
    angle_information,
    floor_spots,
    landmark_information,
    place_anchors,
    room_text,
    standing_classes,
    with_anchors,
    worst_floor,
)
from ortilo_drake.studies.rooms.planned_floor import planned_truth

PATH = "planner={kind: waypoints, points: [[1, 0, 1.5], [4, 1, 1.5]]}"
SETTINGS = (PATH, "uwb.walls.kind=block", "uwb.link.blackouts=[]", "camera.kind=projected")


@pytest.fixture(scope="module")
def hall() -> Room:
    return example_room(1, 3)


def in_hall(room: Room, folder: Path, *settings: str) -> Scenario:
    file = folder / "hall.yaml"
    file.write_text(room_text(room, "a hall"))
    return load_scenario("nominal_imu_uwb_yolo", (*SETTINGS, f"room={file}", *settings))


def test_classes_that_stand_on_the_floor() -> None:
    room = load_room()
    assert "clock" not in standing_classes(room)
    assert "bird" not in standing_classes(room)
    assert {"person", "dog", "chair", "bicycle"} <= set(standing_classes(room))
    assert standing_classes(room.model_copy(update={"landmarks": ()})) == sorted(room.landmark_size)
    with pytest.raises(InputError, match="landmark_size: the room knows no class"):
        standing_classes(room.model_copy(update={"landmarks": (), "landmark_size": {}}))


def test_spots_are_free_and_away_from_the_path(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path)
    path = planned_truth(scenario)[1][:, :3]
    spots = floor_spots(hall, ["person", "dog"], 1.5, path, scenario.vehicle.radius)
    assert len(spots) > 20
    assert [spot.label for spot in spots[:3]] == ["person", "dog", "person"]
    for spot in spots:
        p, size = np.array(spot.position), np.array(hall.landmark_size[spot.label])
        reach = np.hypot(*size[:2]) / 2.0
        assert p[2] == pytest.approx(size[2] / 2.0, abs=1e-4)
        assert np.hypot(*(path[:, :2] - p[:2]).T).min() > scenario.vehicle.radius + reach
        for item in footprints(hall):
            assert np.hypot(*(p[:2] - np.clip(p[:2], item.low, item.high))) > item.radius + reach


def test_a_landmark_tells_the_position_what_is_left_beside_unknown_angles(hall: Room, tmp_path: Path) -> None:
    spots = [Landmark(label="person", position=(6.0, 1.5, 0.95)), Landmark(label="dog", position=(5.0, -1.0, 0.31))]
    room = hall.model_copy(update={"landmarks": (spots[0],), "walls": ()})
    scenario = in_hall(room, tmp_path, "sensors=[imu, camera]")
    truth = planned_truth(scenario)[1][:60]
    imu = information_rows(scenario.model_copy(update={"sensors": ("imu",)}), truth, room)
    both = information_rows(scenario, truth, room)
    assert imu is not None
    assert both is not None
    Q_inverse = angle_information(scenario, imu[0], len(truth))
    found = landmark_information(scenario, truth, room, spots, Q_inverse, 30)
    whole = (step_information(both[0], 2, 30) - step_information(imu[0], 2, 30))[:, :6, :6]
    whole[:, 3:, 3:] += Q_inverse
    for step in range(2):
        marginal = np.linalg.inv(np.linalg.inv(whole[step] + 1e-9 * np.eye(6))[:3, :3])
        np.testing.assert_allclose(found[0, step], marginal, rtol=1e-3, atol=1e-3 * np.abs(marginal).max())
        assert np.linalg.eigvalsh(found[1, step]).min() > -1e-6 * np.abs(found[1, step]).max()


@pytest.mark.long
def test_placed_landmarks_lower_the_worst_floor(hall: Room, tmp_path: Path) -> None:
    scenario = in_hall(hall, tmp_path)
    found = place_anchors(scenario, 3, 2.0, 5)
    assert len(found.room.landmarks) == 5
    without = with_anchors(hall, found.room.anchor_positions)
    folder = tmp_path / "without"
    folder.mkdir()
    assert found.after.floor < 0.95 * worst_floor(in_hall(without, folder)).floor
    assert found == place_anchors(scenario, 3, 2.0, 5)


@pytest.mark.long
def test_landmarks_that_cannot_be_placed_are_refused(hall: Room, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must have camera, whose landmarks are placed"):
        place_anchors(in_hall(hall, tmp_path, "sensors=[uwb, imu]"), 3, 2.0, 5)
    with pytest.raises(InputError, match="--landmarks 900: must not exceed the"):
        place_anchors(in_hall(hall, tmp_path), 3, 3.0, 900)
