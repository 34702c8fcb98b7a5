"""Flights that look at pictures: the same bits everywhere, late pictures, networks of the user's, and bad input."""

import importlib.util
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import yaml
from command_line import run
from flight_tracks import digest

import ortilo_drake as od
from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.ensemble import flight_file, fly_many
from ortilo_drake.flight.flight import fly, make_simulator
from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP
from ortilo_drake.model.typed_yaml import Frozen, InputError
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Scenario, load_scenario

HOVER = ("planner={kind: hover, point: [8, 1, 1.5], duration: 0.6}", "settle=0.2")
RENDERED = ("camera.kind=rendered", "camera.width=64")
# Of untrained weights hardly a score exceeds this, of trained ones many do: some boxes at any rate.
LOW = "detector.threshold=1.0e-4"

needs_torch = pytest.mark.skipif(
    importlib.util.find_spec("torch") is None or importlib.util.find_spec("safetensors") is None,
    reason="torch or safetensors is not installed: Darknet's networks cannot be computed",
)


def scenario_of(*settings: str, seed: int = 3) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", (*HOVER, *RENDERED, LOW, *settings), seed)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the setting of the paper's room without its furniture, which takes long to load."""
    room = yaml.safe_load(ORTILO_ROOM.read_text(encoding="utf-8"))
    changes = {"furniture": [], "landmarks": room["landmarks"][:14], "walls": room["walls"][:6]}
    path = tmp_path_factory.mktemp("room") / "bare.yaml"
    path.write_text(yaml.safe_dump(room | changes), encoding="utf-8")
    assert set(load_room(path).classes) == set(load_room().classes)
    return f"room={path}"


# --- the same bits --------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.egl
def test_the_same_seed_flies_the_same_bits_twice_and_another_others(bare: str) -> None:
    scenario = scenario_of(bare)
    one, two, other = fly(scenario), fly(scenario), fly(scenario_of(bare, seed=4))
    assert digest(one) == digest(two)
    assert digest(one) != digest(other)


@pytest.mark.processes
@pytest.mark.egl
def test_the_same_bits_on_one_worker_and_on_two(bare: str, tmp_path: Path) -> None:
    scenario = scenario_of(bare)
    digests = []
    for workers in (1, 2):
        fly_many(scenario, range(2), tmp_path / str(workers), workers)
        files = [flight_file(tmp_path / str(workers), scenario, seed) for seed in range(2)]
        digests.append([digest(load_flight(file)) for file in files])
    assert digests[0] == digests[1]
    assert len(set(digests[0])) == 2


# --- what crosses from world to onboard -----------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.parametrize(
    ("link", "delays"),
    [("{rate: 10.0}", {0}), ("{rate: 10.0, delay: 2}", {2}), ("{rate: 10.0, random_delay: 4}", set(range(5)))],
)
def test_pictures_come_with_their_stamps_and_boxes_a_latency_later(bare: str, link: str, delays: set[int]) -> None:
    scenario = scenario_of(bare, f"camera.link={link}", "camera.latency=2", "planner.duration=1.5")
    diagram = make_closed_loop(scenario)
    simulator, h = make_simulator(diagram, scenario), scenario.h
    context = simulator.get_context()
    world, onboard = diagram.GetSubsystemByName("world"), diagram.GetSubsystemByName("onboard")
    camera = world.GetSubsystemByName("rendered_camera")
    detector = onboard.GetSubsystemByName("detector")
    drawn, arrived = {}, {}
    for k in range(40):
        if k:  # AdvanceTo(0) would make the updates of tick 0; this goes to before those of tick k
            simulator.AdvanceTo(k * h)
        if k % 3 == 0:
            drawn[k] = camera.GetOutputPort("color_image").Eval(camera.GetMyContextFromRoot(context)).data.copy()
        shutter = world.GetOutputPort("shutter").Eval(world.GetMyContextFromRoot(context))
        if shutter[ARRIVED] == 1.0:
            stamp = round(shutter[STAMP] / h)
            image = world.GetOutputPort("image").Eval(world.GetMyContextFromRoot(context))
            np.testing.assert_array_equal(image.data, drawn[stamp])
            arrived[k] = stamp
        message = detector.get_output_port().Eval(detector.GetMyContextFromRoot(context))
        assert bool(message[ARRIVED]) == (k - 2 in arrived)
        if message[ARRIVED]:
            assert round(message[STAMP] / h) == arrived[k - 2]
            assert message[PAYLOAD] >= 0.0  # some box
            assert set(message[PAYLOAD::DETECTION_SIZE]) <= {-1.0, *range(9)}
    assert {k - stamp for k, stamp in arrived.items()} == delays
    assert len({image.tobytes() for image in drawn.values()}) == len(drawn)  # the vehicle moves


@pytest.mark.long
@pytest.mark.egl
def test_a_flight_with_late_pictures_flies_to_its_end(bare: str) -> None:
    flight = fly(scenario_of(bare, "camera.link={rate: 10.0, delay: 1, random_delay: 2}"))
    assert flight.sizes["tick"] == 25
    assert np.isfinite(flight["truth"].values).all()


# --- a network of the user's ----------------------------------------------------------------------------------

TINY = """[net]\nwidth=64\nheight=48\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=8\nsize=3\nstride=4\npad=1\nactivation=leaky
[maxpool]\nsize=2\nstride=2
[convolutional]\nfilters=28\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=8,8,20,16\nclasses=9\nnum=2
"""
FLOATS = 4 * 8 + 8 * 27 + 28 + 28 * 8
NAMES = "\n".join(load_room().classes)


def write_network(folder: Path, text: str = TINY, floats: int = FLOATS, names: str = NAMES) -> tuple[str, ...]:
    """Write a small network of seeded weights; return the words that fly it."""
    (folder / "tiny.cfg").write_text(text)
    (folder / "tiny.names").write_text(names)
    values = np.random.default_rng(1).uniform(0.05, 0.5, floats).astype("<f4")
    (folder / "tiny.weights").write_bytes(np.array([0, 2, 0, 9, 0], dtype="<i4").tobytes() + values.tobytes())
    return "--detector", str(folder / "tiny.cfg"), str(folder / "tiny.weights")


def command(*more: str, camera: str | None = None) -> list[str]:
    words = ["fly", "nominal_imu_uwb_yolo", "--set", HOVER[0], "--set", HOVER[1], "--set", RENDERED[1]]
    return [*words, *(() if camera is None else ("--camera", camera)), *more]


@pytest.mark.long
@pytest.mark.egl
@needs_torch
def test_a_network_of_the_users_flies(capsys: pytest.CaptureFixture[str], bare: str, tmp_path: Path) -> None:
    words = write_network(tmp_path)
    out = tmp_path / "flight.nc"
    assert run(*command(*words, "--set", bare, "--out", str(out))) == 0
    assert capsys.readouterr().err == ""
    flight = load_flight(out)
    scenario = Scenario.model_validate_json(flight.attrs["scenario"])
    assert scenario.camera.kind == "rendered"
    assert scenario.detector.cfg == words[1]
    assert scenario.detector.weights == words[2]
    assert digest(flight) == digest(fly(scenario))


@pytest.mark.long
@pytest.mark.egl
def test_an_onnx_network_flies(capsys: pytest.CaptureFixture[str], bare: str, tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    from onnx_networks import Network

    names = [*load_room().classes]
    path = Network("v8", len(names), (96, 64)).write(tmp_path / "net.onnx", {"names": str(names)})
    out = tmp_path / "flight.nc"
    low = "detector.threshold=0.02"  # random weights: some boxes at any rate
    assert run(*command("--onnx", str(path), "--set", low, "--set", bare, "--out", str(out))) == 0
    assert capsys.readouterr().err == ""
    flight = load_flight(out)
    scenario = Scenario.model_validate_json(flight.attrs["scenario"])
    assert scenario.detector.onnx == str(path)
    assert digest(flight) == digest(fly(scenario))


class Brightest(Frozen):
    """A detector of one's own: it boxes the brightest pixel and calls it by its class."""

    kind: Literal["brightest"] = "brightest"
    label: str = "dog"
    bad: str = ""


def make_brightest(settings: Brightest, classes: tuple[str, ...], size: tuple[int, int]) -> Any:
    label = classes.index(settings.label)

    def find(image: np.ndarray) -> Any:
        assert image.shape == (size[1], size[0], 3)
        v, u = np.unravel_index(image.sum(axis=2).argmax(), (size[1], size[0]))
        found = np.array([label]), np.array([0.9]), np.array([[u - 2.0, v - 2.0, u + 2.0, v + 2.0]])
        wrong = {
            "shape": (found[0], found[1], found[2][0]),
            "label": (np.array([len(classes)]), *found[1:]),
            "score": (found[0], np.array([2.0]), found[2]),
            "nothing": None,
        }
        return wrong.get(settings.bad, found)

    return find


@pytest.fixture
def registered(own_register: None) -> None:
    od.register_detector("brightest", Brightest, make_brightest)


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.usefixtures("registered")
def test_a_registered_detector_looks_at_the_pictures(bare: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("base: nominal_imu_uwb_yolo\ndetector: {kind: brightest, label: cat}\n")
    scenario = load_scenario(file, (*HOVER, *RENDERED, bare), 3)
    flight = fly(scenario)
    assert digest(flight) == digest(fly(Scenario.model_validate_json(scenario.model_dump_json())))
    room, size = scenario.load_room(), (64, 48)
    image = np.zeros((48, 64, 3), np.uint8)
    image[1, 40] = 255
    labels, scores, boxes = load_detector(scenario.detector, room, size)(image)
    assert [room.classes[k] for k in labels] == ["cat"]
    assert scores.tolist() == [0.9]
    assert boxes.tolist() == [[38.0, -0.5, 42.0, 3.0]]  # cut at the border


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ("shape", r"shapes \(1,\), \(1,\), \(4,\): must be"),
        ("label", "must be 0 to 8, the classes"),
        ("score", "scores above 0 and at most 1"),
        ("nothing", "must return labels, scores and boxes, not NoneType"),
    ],
)
def test_what_a_registered_detector_finds_is_checked(bad: str, why: str) -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", (f"detector={{kind: brightest, bad: {bad}}}", *RENDERED))
    detect = load_detector(scenario.detector, scenario.load_room(), (64, 48))
    with pytest.raises(InputError, match=f"^detector.kind: brightest: .*{why}"):
        detect(np.zeros((48, 64, 3), np.uint8))


@pytest.mark.usefixtures("registered")
def test_a_detector_that_nobody_registered_is_answered_with_those_that_are() -> None:
    with pytest.raises(InputError, match=r"detector\.kind: 'brightst' is not one of 'brightest', 'network'"):
        load_scenario("nominal_imu_uwb_yolo", "detector={kind: brightst}")


# --- bad input ------------------------------------------------------------------------------------------------


def fails_in_flight(words: tuple[str, ...], bare: str) -> list[str]:
    return command(*words, "--set", bare, "--out", "new/flight.nc", "--json", "new/flight.json")


@pytest.mark.egl
@needs_torch
@pytest.mark.parametrize("file", ["tiny.cfg", "tiny.weights"])
def test_a_missing_file(refused: Any, bare: str, tmp_path: Path, file: str) -> None:
    words = write_network(tmp_path)
    (tmp_path / file).unlink()
    assert f"{file}: cannot be read" in refused(*fails_in_flight(words, bare))


@pytest.mark.family
@pytest.mark.egl
@needs_torch
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"floats": FLOATS - 1}, ["tiny.weights", f"holds {FLOATS - 1} weights", f"needs {FLOATS}"]),
        ({"floats": FLOATS + 5}, ["tiny.weights", f"holds {FLOATS + 5} weights", f"needs {FLOATS}"]),
        ({"text": TINY.replace("[maxpool]", "[deconv]")}, ["tiny.cfg", "line 12", "[deconv]", "not computed here"]),
        ({"text": TINY.replace("classes=9", "classes=8")}, ["tiny.cfg", "classes", "must have filters 26"]),
        ({"names": NAMES.replace("dog", "wolf")}, ["tiny.names", "'dog'"]),
        ({"names": "cat"}, ["tiny.names", "holds 1 names", "9 classes"]),
        ({"text": "\x00\x01 garbage"}, ["tiny.cfg", "line 1"]),
        ({"text": ""}, ["tiny.cfg", "[net]"]),
    ],
)  # fmt: skip
def test_a_wrong_file(refused: Any, bare: str, tmp_path: Path, changes: dict[str, Any], named: list[str]) -> None:
    line = refused(*fails_in_flight(write_network(tmp_path, **changes), bare))
    for part in named:
        assert part in line


@pytest.mark.egl
@needs_torch
@pytest.mark.parametrize(
    ("content", "named"), [(b"", "header"), (b"\xff" * 4000, "is it a .weights file"), (b"GIF89a" * 700, ".weights")]
)
def test_a_corrupt_file_of_weights(refused: Any, bare: str, tmp_path: Path, content: bytes, named: str) -> None:
    words = write_network(tmp_path)
    (tmp_path / "tiny.weights").write_bytes(content)
    line = refused(*fails_in_flight(words, bare))
    assert "tiny.weights" in line
    assert named in line


def test_a_detector_has_nothing_to_look_at_where_boxes_are_projected(refused: Any, tmp_path: Path) -> None:
    line = refused(*command(*write_network(tmp_path), camera="projected"))
    assert "--detector" in line
    assert "projected" in line


@pytest.mark.parametrize("how", ["rendered", "--set"])
def test_without_egl_it_says_what_to_install(refused: Any, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.world.scenery.rendering._egl_works", lambda: False)
    words = command(camera=how) if how == "rendered" else command("--set", "camera.kind=rendered")
    line = refused(*words, "--out", "flight.nc")
    assert "apt-get install libegl1 libgl1-mesa-dri" in line
    assert "projected" in line


@pytest.mark.parametrize("words", [["render"], ["evaluate"], ["render", "--scale", "0.001", "--workers", "2"]])
def test_without_egl_no_set_is_rendered(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ortilo_drake.world.scenery.rendering._egl_works", lambda: False)
    assert run("detector", *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "apt-get install libegl1" in line
    assert not list(tmp_path.rglob("*.npz"))


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["evaluate", "--detector", "a.cfg", "a.weights"], "a.cfg: cannot be read"),
        (["evaluate", "--backend", "abacus"], "'abacus'"),
        (["evaluate", "--worst", "worst.frog"], "worst.frog"),
        (["evaluate", "--worst", "."], "is a folder"),
        (["render", "--width", "3"], "--width"),
        (["render", "--scale", "0"], "--scale"),
        pytest.param(["train"], "holds no rendered pictures", marks=needs_torch),
        pytest.param(["export"], "ortilo.safetensors: cannot be read", marks=needs_torch),
    ],
)
def test_bad_input_to_the_detectors_own_commands(refused: Any, words: list[str], named: str) -> None:
    assert named in refused("detector", *words)
