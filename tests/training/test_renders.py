"""Rendered pictures and their labels: exact to the pixel, the same everywhere, and safe on disk."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw

from ortilo_drake.model.room import CameraModel, Room, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.training.pictures import sets
from ortilo_drake.training.pictures.labels import (
    BOX,
    CLASS,
    DISTANCE,
    LABEL_SIZE,
    LANDMARK,
    MAX_OBJECTS,
    VISIBLE,
    Frames,
    is_to_be_found,
)
from ortilo_drake.training.pictures.renders import Studio, render_scene
from ortilo_drake.training.pictures.sets import load_frames, load_set, render_set, render_shard, set_folder
from ortilo_drake.world.scenery.rendering import camera_in_body, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import scene_items

pytestmark = pytest.mark.training

BASE = load_room()
CAMERA = BASE.camera.scaled_to(320)


def room_with(*landmarks: dict, walls: list | None = None) -> Room:
    """Return a room with nothing in it but these landmarks and walls."""
    changes = {"landmarks": landmarks, "walls": walls or [], "stands": [], "furniture": []}
    return Room.model_validate_json(json.dumps(BASE.model_dump(mode="json") | changes))


def looking(x: float, y: float, z: float, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> RigidTransform:
    """Return X_WC of the camera on a vehicle whose camera is at that place."""
    X_WB = RigidTransform(RollPitchYaw(roll, pitch, yaw), [0.0, 0.0, 0.0])
    return RigidTransform((X_WB @ camera_in_body(CAMERA)).rotation(), [x, y, z])


def label_image(room: Room, X_WC: RigidTransform, camera: CameraModel = CAMERA) -> np.ndarray:
    graph = make_scene_graph(scene_items(room))
    query = graph.get_query_output_port().Eval(graph.CreateDefaultContext())
    return query.RenderLabelImage(render_cameras(camera)[0], SceneGraph.world_frame_id(), X_WC).data[..., 0].copy()


def landmark(label: str, x: float, y: float, z: float, yaw: float = 0.0) -> dict:
    return {"label": label, "position": [x, y, z], "yaw": yaw}


# --- labels ---------------------------------------------------------------------------------------------------


def in_clear_view(label: str, width: int) -> list[np.ndarray]:
    """Return how far a landmark's box lies beyond the edges of its own pixels, from three places [px] (4 each)."""
    room, camera = room_with(landmark(label, 4.0, 0.3, 1.2, 0.7)), BASE.camera.scaled_to(width)
    studio, errors = Studio(room, (label,), camera), []
    for X_WC in (looking(0.0, 0.0, 1.2), looking(2.0, 0.6, 1.6, -0.2, 0.15, 0.1), looking(-2.0, 1.0, 0.9, -0.1)):
        _, labels = studio.picture(X_WC)
        v, u = np.nonzero(label_image(room, X_WC, camera) == 0)
        assert len(u) > 20
        errors.append(labels[0, BOX] - [u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5])
        assert labels[0, VISIBLE] > 0.99  # its post may stand before its edge
        assert labels[0, CLASS] == labels[0, LANDMARK] == 0.0
        assert labels[0, DISTANCE] == pytest.approx(np.linalg.norm([4.0, 0.3, 1.2] - X_WC.translation()), rel=1e-6)
        assert np.all(labels[1:] == -1.0)
    return errors


@pytest.mark.egl
@pytest.mark.parametrize("label", sorted(BASE.landmark_size))
def test_the_box_of_a_landmark_in_clear_view_is_that_of_its_pixels(label: str) -> None:
    # Four times as fine, for a leaf or a spoke may slip between the pixels: this is one pixel of a picture of 320.
    assert np.abs(in_clear_view(label, 1280)).max() <= 4.0


@pytest.mark.egl
def test_boxes_lie_neither_to_one_side_nor_to_the_other_of_the_pixels() -> None:
    errors = np.array([in_clear_view(label, 320) for label in sorted(BASE.landmark_size)]).reshape(-1, 4)
    # An edge falls anywhere between two pixels: of 108 the mean is within 4 of its own sd, 0.29 px / sqrt(108).
    assert abs(errors.mean()) < 0.11


@pytest.mark.egl
def test_what_a_wall_hides_is_not_seen() -> None:
    dog = landmark("dog", 6.0, 0.0, 0.4)
    behind = Studio(room_with(dog, walls=[[3.0, 0.0, np.pi / 2]]), ("dog",), CAMERA)
    _, labels = behind.picture(looking(0.0, 0.0, 1.0))
    assert labels[0, CLASS] == 0.0
    assert labels[0, VISIBLE] == 0.0
    assert not is_to_be_found(labels).any()


@pytest.mark.egl
def test_what_a_wall_hides_in_part_is_seen_in_part() -> None:
    chair = landmark("chair", 6.0, 0.0, 0.5)
    X_WC = looking(0.0, 0.0, 0.6)
    free, half = room_with(chair), room_with(chair, walls=[[3.0, 1.5, np.pi / 2]])
    _, labels = Studio(half, ("chair",), CAMERA).picture(X_WC)
    expected = np.sum(label_image(half, X_WC) == 0) / np.sum(label_image(free, X_WC) == 0)
    assert 0.2 < expected < 0.8
    assert labels[0, VISIBLE] == pytest.approx(expected, rel=1e-6)
    _, whole = Studio(free, ("chair",), CAMERA).picture(X_WC)
    np.testing.assert_array_equal(labels[0, BOX], whole[0, BOX])  # of the whole landmark


@pytest.mark.egl
def test_boxes_are_cut_at_the_border_and_what_is_behind_or_too_near_has_no_label() -> None:
    room = room_with(
        landmark("chair", 2.0, 2.0, 1.0), landmark("dog", -3.0, 0.0, 1.0), landmark("person", 0.25, -0.5, 0.85)
    )
    image, labels = Studio(room, ("chair", "dog", "person"), CAMERA).picture(looking(0.0, 0.0, 1.0))
    assert image.shape == (240, 320, 3)
    assert labels[:, CLASS].tolist() == [0.0] + [-1.0] * (MAX_OBJECTS - 1)
    assert labels[0, 1] == -0.5
    _, u = np.nonzero(label_image(room, looking(0.0, 0.0, 1.0)) == 0)
    assert u.min() == 0
    assert abs(labels[0, 3] - (u.max() + 0.5)) <= 1.0


@pytest.mark.egl
def test_labels_come_nearest_first_and_name_their_landmark() -> None:
    room = room_with(landmark("dog", 6.0, 1.0, 0.4), landmark("cat", 3.0, -0.5, 0.4), landmark("dog", 4.5, 0.2, 0.4))
    _, labels = Studio(room, ("cat", "dog"), CAMERA).picture(looking(0.0, 0.0, 1.0))
    assert labels[:3, LANDMARK].tolist() == [1.0, 2.0, 0.0]
    assert labels[:3, CLASS].tolist() == [0.0, 1.0, 1.0]
    assert np.all(np.diff(labels[:3, DISTANCE]) > 0)


@pytest.mark.parametrize("least", [(0.6, 8.0), (0.5, 6.0)])
def test_what_is_to_be_found_is_visible_and_large_enough(least: tuple[float, float]) -> None:
    row = np.array([0.0, 10.0, 10.0, 10.0 + least[1], 30.0, least[0], 0.0, 3.0])
    assert is_to_be_found(row, least)
    for column, value in ((CLASS, -1.0), (VISIBLE, least[0] - 0.01), (3, 9.9 + least[1]), (4, 9.9 + least[1])):
        other = row.copy()
        other[column] = value
        assert not is_to_be_found(other, least)


# --- the same everywhere --------------------------------------------------------------------------------------

PROGRAM = """
import sys, hashlib
from ortilo_drake.training.pictures.renders import render_scene
frames = render_scene(sys.argv[1], 3, 1, 2, 160)
print(hashlib.sha256(frames.images.tobytes() + frames.labels.tobytes()).hexdigest())
"""


def same(one: Frames, other: Frames) -> bool:
    return np.array_equal(one.images, other.images) and np.array_equal(one.labels, other.labels)


@pytest.mark.egl
def test_a_scene_is_the_same_twice_and_another_is_another() -> None:
    one = render_scene("random_rooms", 3, 1, 2, 160)
    assert one.images.shape == (2, 120, 160, 3)
    assert one.images.dtype == np.uint8
    assert one.labels.shape == (2, MAX_OBJECTS, LABEL_SIZE)
    assert np.ptp(one.images) > 100  # there is something to see
    assert same(one, render_scene("random_rooms", 3, 1, 2, 160))
    for other in (("random_rooms", 4, 1), ("random_rooms", 3, 2)):
        assert not same(one, render_scene(*other, 2, 160))


@pytest.mark.egl
def test_a_scene_of_the_papers_room_is_the_same_in_another_process() -> None:
    import hashlib

    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "paper_room"],
        env=os.environ | {"PYTHONHASHSEED": "321", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    frames = render_scene("paper_room", 3, 1, 2, 160)
    assert done.stdout.strip() == hashlib.sha256(frames.images.tobytes() + frames.labels.tobytes()).hexdigest()


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sets, "PICTURES", {part: dict.fromkeys(sets.KINDS, 2) for part in ("train", "test")})


@pytest.mark.egl
def test_a_set_is_the_same_on_one_worker_and_on_two(small: None, tmp_path: Path) -> None:
    for workers in (1, 2):
        render_set(tmp_path / str(workers), "test", "random_rooms", 5, 2, 64, workers)
    one, two = (load_frames(set_folder(tmp_path / str(workers), "test", "random_rooms")) for workers in (1, 2))
    assert one.images.shape == (4, 48, 64, 3)
    assert same(one, two)


# --- on disk --------------------------------------------------------------------------------------------------


@pytest.mark.egl
def test_an_interrupted_set_goes_on_and_finished_scenes_are_kept(small: None, tmp_path: Path) -> None:
    counted: list[None] = []
    render_set(tmp_path, "train", "random_rooms", 0, 2, 64, 1, lambda: counted.append(None))
    assert len(counted) == 2
    whole = load_frames(set_folder(tmp_path, "train", "random_rooms"))
    first, second = sorted(set_folder(tmp_path, "train", "random_rooms").glob("*.npz"))
    second.unlink()
    before = first.stat().st_mtime_ns
    render_set(tmp_path, "train", "random_rooms", 0, 2, 64, 1)
    assert first.stat().st_mtime_ns == before
    assert same(whole, load_frames(first.parent))
    assert sorted(path.name for path in first.parent.iterdir()) == ["00000.npz", "00001.npz", "set.json"]


@pytest.mark.egl
def test_test_scenes_are_no_training_scenes(small: None, tmp_path: Path) -> None:
    for part in ("train", "test"):
        render_set(tmp_path, part, "random_rooms", 0, 1, 64, 1)
    train, test = (load_frames(set_folder(tmp_path, part, "random_rooms")) for part in ("train", "test"))
    assert not same(train, test)


@pytest.mark.parametrize(("seed", "width"), [(1, 64), (0, 80)])
def test_a_set_is_not_mixed_with_another_seed_or_width(seed: int, width: int, tmp_path: Path) -> None:
    render_set(tmp_path, "test", "random_rooms", 0, 0, 64, 1)
    with pytest.raises(InputError, match=r"random_rooms: holds pictures of .*: take another folder"):
        render_set(tmp_path, "test", "random_rooms", seed, 0, width, 1)


def test_the_sets_of_both_kinds_are_loaded_one_after_the_other(tmp_path: Path) -> None:
    for n, kind in enumerate(sets.KINDS, start=1):
        labels = np.full((n, MAX_OBJECTS, LABEL_SIZE), n, dtype=np.float32)
        write_shard(
            set_folder(tmp_path, "train", kind) / "00000.npz",
            images=np.full((n, 12, 16, 3), n, np.uint8),
            labels=labels,
        )
    frames = load_set(tmp_path, "train")
    assert frames.images[:, 0, 0, 0].tolist() == frames.labels[:, 0, 0].tolist() == [1, 2, 2]


def write_shard(path: Path, **changes: np.ndarray) -> Path:
    labels = np.full((2, MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{"images": np.zeros((2, 12, 16, 3), np.uint8), "labels": labels} | changes)
    return path


def test_a_shard_that_is_there_is_not_rendered_again(tmp_path: Path) -> None:
    path = write_shard(tmp_path / "00000.npz")
    before = path.read_bytes()
    assert render_shard("random_rooms", 0, 0, 1, 64, str(path)) == str(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("damage", ["flip", "cut"])
def test_a_damaged_shard_is_told_and_rendered_again(
    damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_shard(tmp_path / "00000.npz")
    whole, frames = path.read_bytes(), load_frames(tmp_path)
    monkeypatch.setattr(sets, "render_scene", lambda *_: frames)
    at = len(whole) // 2
    path.write_bytes(whole[:at] if damage == "cut" else whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    render_shard("random_rooms", 0, 0, 2, 16, str(path))
    assert same(load_frames(tmp_path), frames)
    (record,) = caplog.records
    assert record.getMessage().startswith(f"{path}: ")
    assert record.getMessage().endswith(": rendered again")


@pytest.mark.parametrize("content", [b"", b"PK", b"no shard", np.zeros(3).tobytes()])
def test_refuses_a_file_that_is_no_shard(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "00000.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"00000\.npz: not a shard of rendered pictures"):
        load_frames(tmp_path)


def test_refuses_an_array_in_place_of_a_shard(tmp_path: Path) -> None:
    with (tmp_path / "00000.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match=r"00000\.npz: not a shard"):
        load_frames(tmp_path)


LABELS = np.full((2, MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("images", np.zeros((2, 12, 16, 4), np.uint8), "must be uint8"),
        ("images", np.zeros((2, 12, 16, 3)), "must be uint8"),
        ("images", np.zeros((2, 12, 16), np.uint8), "must be uint8"),
        ("images", np.zeros((0, 12, 16, 3), np.uint8), "must be uint8"),
        ("images", np.zeros((3, 12, 16, 3), np.uint8), "labels"),
        ("labels", LABELS[:, :5], "labels"),
        ("labels", LABELS.astype(float), "labels"),
        ("labels", np.where(LABELS < 0, np.nan, LABELS).astype(np.float32), "finite"),
        ("labels", np.array([{}]), "not a shard"),
    ],
)
def test_refuses_a_shard_of_other_arrays(name: str, value: np.ndarray, message: str, tmp_path: Path) -> None:
    write_shard(tmp_path / "00000.npz", **{name: value})
    with pytest.raises(InputError, match=rf"00000\.npz: .*{message}"):
        load_frames(tmp_path)


def test_refuses_shards_of_different_sizes_and_a_folder_without_any(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no rendered pictures"):
        load_frames(tmp_path)
    write_shard(tmp_path / "00000.npz")
    write_shard(tmp_path / "00001.npz", images=np.zeros((2, 24, 32, 3), np.uint8))
    with pytest.raises(InputError, match=r"00001\.npz: pictures \(2, 24, 32, 3\): must be \(n, 12, 16, 3\)"):
        load_frames(tmp_path)


@given(st.integers(0, 10**9), st.binary(min_size=1, max_size=8), st.booleans())
@settings(max_examples=60)
def test_a_damaged_shard_is_frames_or_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, place: int, damage: bytes, ends: bool
) -> None:
    path = tmp_path_factory.mktemp("shard", numbered=True) / "00000.npz"
    content = bytearray(write_shard(path).read_bytes())
    place %= len(content)
    content[place : place + len(damage)] = damage
    path.write_bytes(content[: place + 1] if ends else content)
    with contextlib.suppress(InputError):
        assert load_frames(path.parent).images.dtype == np.uint8
