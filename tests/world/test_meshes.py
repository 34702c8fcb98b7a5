import importlib
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import ReadObjToTriangleSurfaceMesh

from ortilo_drake.model.room import ORTILO_ROOM, load_room

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "scripts" / "make_room_meshes.py"
MESHES = ROOT / "ortilo_drake" / "world" / "scenery" / "meshes"
ROOM = load_room()
OUTLINES = {label: np.array(points) for label, points in ROOM.landmark_outline.items()}
CLUTTER = {  # extents [m]; foot at z = 0
    "bookshelf": (0.9, 0.4, 2.0),
    "cardboard_box": (0.5, 0.4, 0.3),
    "table": (1.5, 0.8, 0.8),
    "euro_pallet": (0.8, 1.2, 0.144),
    "stop_sign": (0.04, 0.6, 1.85),
    "ball": (0.3, 0.3, 0.3),
    "tennis_racket": (0.7, 0.28, 0.04),
    "baseball_bat": (0.86, 0.07, 0.07),
    "traffic_cone": (0.36, 0.36, 0.7),
    "barrel": (0.58, 0.58, 0.88),
    "suitcase": (0.26, 0.48, 0.75),
    "bucket": (0.3, 0.3, 0.38),
    "crate": (0.5, 0.5, 0.5),
    "stand": (0.5, 0.5, 0.86),
}


def path_of(name):
    return MESHES / f"{name.replace(' ', '_')}.obj"


def vertices_of(name):
    return np.array(ReadObjToTriangleSurfaceMesh(str(path_of(name))).vertices())


def assert_extends(vertices, low, high):
    np.testing.assert_allclose(vertices.min(axis=0), low, atol=1e-5)
    np.testing.assert_allclose(vertices.max(axis=0), high, atol=1e-5)


LANDMARKS = {label: vertices_of(label) for label in ROOM.classes}
ALL = [*(label.replace(" ", "_") for label in ROOM.classes), *CLUTTER, "wall", "floor", "floor32x10"]


@pytest.mark.parametrize("label", ROOM.classes)
def test_a_landmark_fills_its_size_about_the_origin(label):
    half = np.array(ROOM.landmark_size[label]) / 2
    assert_extends(LANDMARKS[label], -half, half)
    assert 500 <= ReadObjToTriangleSurfaceMesh(str(path_of(label))).num_triangles() <= 3000


@pytest.mark.parametrize("name", CLUTTER)
def test_clutter_stands_on_the_floor(name):
    x, y, z = CLUTTER[name]
    assert_extends(vertices_of(name), (-x / 2, -y / 2, 0), (x / 2, y / 2, z))


def test_walls_and_floors_have_their_sizes():
    half = np.array(ROOM.wall_size) / 2
    assert_extends(vertices_of("wall"), -half, half)
    assert_extends(vertices_of("floor"), (-0.5, -0.5, 0), (0.5, 0.5, 0))
    assert_extends(vertices_of("floor32x10"), (-16, -5, 0), (16, 5, 0))
    r = ROOM.stand_radius
    assert_extends(vertices_of("stand"), (-r, -r, 0), (r, r, ROOM.stand_height))


@pytest.mark.parametrize("name", ALL)
def test_a_mesh_has_normals_a_texture_and_faces_outwards(name):
    text = path_of(name).read_text(encoding="utf-8")
    mtl = (MESHES / re.search(r"^mtllib (\S+)$", text, re.M)[1]).read_text(encoding="utf-8")
    assert re.search(r"^newmtl painted$", mtl, re.M)
    assert "usemtl painted" in text
    image = cv2.imread(str(MESHES / re.search(r"^map_Kd (\S+)$", mtl, re.M)[1]))
    assert image.shape[0] == image.shape[1] <= 256
    assert image.std() > 3.0  # a picture, not a plain area

    def rows(key):
        return np.array([line.split()[1:] for line in text.splitlines() if line.startswith(key + " ")], dtype=float)

    v, vt, vn = rows("v"), rows("vt"), rows("vn")
    corners = np.array([[c.split("/") for c in line.split()[1:]] for line in text.splitlines() if line[:2] == "f "])
    i, j, k = (corners.astype(int) - 1).transpose(2, 0, 1)
    assert np.all((vt >= 0.0) & (vt <= 1.0))
    np.testing.assert_allclose(np.linalg.norm(vn, axis=1), 1.0, atol=2e-3)
    assert j.max() == len(vt) - 1
    across = np.cross(v[i[:, 1]] - v[i[:, 0]], v[i[:, 2]] - v[i[:, 0]])
    agree = np.einsum("fc,fxc->fx", across, vn[k])
    area = np.linalg.norm(across, axis=1)
    assert np.mean(agree[area > 1e-6] > 0.0) > 0.995  # thousandths round a sliver's normal to its other side


@pytest.mark.parametrize("name", [n for n in ALL if not n.startswith("floor")])
def test_a_mesh_encloses_a_volume(name):
    mesh = ReadObjToTriangleSurfaceMesh(str(path_of(name)))
    v = np.array(mesh.vertices())
    faces = np.array([[t.vertex(m) for m in range(3)] for t in mesh.triangles()])
    a, b, c = v[faces].transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 > 0.0  # divergence theorem: faces look outwards


def test_all_files_are_small():
    assert sum(file.stat().st_size for file in MESHES.iterdir()) < 3_000_000


@pytest.mark.processes
def test_the_script_makes_what_is_here(tmp_path):
    room = tmp_path / "room.yaml"
    stale = re.sub(r"^(  cat: \[\[).*", r"\g<1>0, 0, 0]]", ORTILO_ROOM.read_text(encoding="utf-8"), flags=re.M)
    room.write_text(stale, encoding="utf-8", newline="\n")
    subprocess.run([sys.executable, str(SCRIPT), str(tmp_path / "meshes"), str(room)], check=True)
    assert room.read_bytes() == ORTILO_ROOM.read_bytes() != stale.encode()
    made = {file.name: file for file in (tmp_path / "meshes").iterdir()}
    assert set(made) == {file.name for file in MESHES.iterdir()} - {"m100.obj", "m100.mtl"}
    for name, file in made.items():
        if name.endswith(".png"):  # its bytes depend on the compressing library
            np.testing.assert_array_equal(cv2.imread(str(file)), cv2.imread(str(MESHES / name)))
        else:
            assert file.read_bytes() == (MESHES / name).read_bytes(), name


def test_the_outline_section_is_put_into_a_room_without_one(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(SCRIPT.parent)
    outline = importlib.import_module("room_meshes.outline")
    text = ORTILO_ROOM.read_text(encoding="utf-8")
    start, end = text.index(outline.BEGIN), text.index("# The camera on the vehicle")
    room = tmp_path / "room.yaml"
    room.write_text(text[:start] + text[end:], encoding="utf-8", newline="\n")
    outline.write_section(room, outline.section(OUTLINES))
    assert room.read_bytes() == ORTILO_ROOM.read_bytes()


@pytest.mark.parametrize("label", ROOM.classes)
def test_an_outline_is_24_points_of_the_mesh(label):
    assert OUTLINES[label].shape == (24, 3)
    points = OUTLINES[label] * np.array(ROOM.landmark_size[label]) / 2
    away = np.linalg.norm(points[:, None] - LANDMARKS[label][None], axis=2).min(axis=1)
    assert away.max() < 0.0005 * np.linalg.norm(ROOM.landmark_size[label])  # rounded to thousandths


@pytest.mark.family
@pytest.mark.parametrize("label", ROOM.classes)
@given(seed=st.integers(0, 2**32 - 1), distance=st.floats(1.5, 8.0))
def test_the_outline_is_seen_as_large_as_the_mesh(label, seed, distance):
    """Boxes by OpenCV's projection, from anywhere around, the camera rolled at will."""
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R[:, 0] *= np.linalg.det(R)
    turn, t, K = cv2.Rodrigues(R)[0], np.array([0.0, 0.0, distance]), np.diag([149.0, 149.0, 1.0])

    def box(points):
        pixels = cv2.projectPoints(points, turn, t, K, None)[0].reshape(-1, 2)
        return np.array([pixels.min(axis=0), pixels.max(axis=0)])

    whole = box(LANDMARKS[label])
    outline = box(OUTLINES[label] * np.array(ROOM.landmark_size[label]) / 2)
    assert np.all(np.abs(outline - whole) <= 0.01 * (whole[1] - whole[0]))
