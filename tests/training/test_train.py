"""Training on a tiny set: it learns, and an interruption leaves no trace."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import ortilo_drake
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_cfg import parse_cfg
from ortilo_drake.training.pictures.labels import LABEL_SIZE, MAX_OBJECTS, Frames

torch = pytest.importorskip("torch", reason="torch is not installed: nothing can be trained")

from ortilo_drake.onboard.detector.darknet_network import DarknetNetwork  # noqa: E402
from ortilo_drake.training.network.train import RARE, batch_of, initialize, train  # noqa: E402

pytestmark = pytest.mark.training

CFG = """[net]\nwidth=64\nheight=48\nchannels=3
[convolutional]\nbatch_normalize=1\nfilters=8\nsize=3\nstride=2\npad=1\nactivation=leaky
[convolutional]\nbatch_normalize=1\nfilters=16\nsize=3\nstride=2\npad=1\nactivation=leaky
[convolutional]\nbatch_normalize=1\nfilters=16\nsize=3\nstride=2\npad=1\nactivation=leaky
[convolutional]\nfilters=14\nsize=1\nstride=1\nactivation=linear
[yolo]\nmask=0,1\nanchors=12,12,24,20\nclasses=2\nnum=2
"""
EPOCHS, BATCH = 3, 4


def made(seed: int = 0) -> DarknetNetwork:
    torch.manual_seed(seed)
    network = DarknetNetwork(parse_cfg(CFG, "tiny.cfg"))
    initialize(network)
    return network


def coloured_rectangles(n: int) -> Frames:
    """Pictures of a red or a blue rectangle on grey, its class its colour."""
    rng = np.random.default_rng(0)
    images = rng.integers(100, 140, (n, 48, 64, 3), dtype=np.uint8)
    labels = np.full((n, MAX_OBJECTS, LABEL_SIZE), -1.0, dtype=np.float32)
    for i in range(n):
        label, (w, h) = i % 2, rng.integers(10, 22, 2)
        u, v = rng.integers(4, 60 - w), rng.integers(4, 44 - h)
        images[i, v : v + h, u : u + w] = [[230, 20, 20], [20, 20, 230]][label]
        labels[i, 0] = [label, u - 0.5, v - 0.5, u + w - 0.5, v + h - 0.5, 1.0, 0, 3.0]
    return Frames(images, labels)


FRAMES = coloured_rectangles(18)


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def same(one: DarknetNetwork, other: DarknetNetwork) -> bool:
    return all(torch.equal(value, other.state_dict()[key]) for key, value in one.state_dict().items())


def test_the_loss_falls_and_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.training.network.train.WARM_UP", 20)  # of 120 steps
    network, seen = made(), []
    history = train(network, coloured_rectangles(40), 12, 0, tmp_path, lambda *told: seen.append(told), batch=BATCH)
    assert len(history) == 12
    assert set(history[0]) == {"loss", "box", "object", "class"}
    assert history[-1]["loss"] < 0.7 * history[0]["loss"]
    assert json.loads((tmp_path / "losses.json").read_text()) == history
    assert [told[:2] for told in seen] == [(epoch, step) for epoch in range(12) for step in range(10)]
    assert seen[-1][2] == pytest.approx(history[-1]["loss"])
    assert not network.training
    assert sorted(path.name for path in tmp_path.iterdir()) == ["checkpoint.pt", "losses.json"]


class Interruption(Exception):
    pass


@pytest.mark.parametrize("where", [(1, 0), (2, 3)])
def test_an_interrupted_training_goes_on_as_if_it_had_not_been(where: tuple[int, int], tmp_path: Path) -> None:
    whole, resumed = made(), made()
    expected = train(whole, FRAMES, EPOCHS, 5, tmp_path / "whole", batch=BATCH)

    def interrupt(epoch: int, step: int, loss: float) -> None:
        if (epoch, step) == where:
            raise Interruption

    with pytest.raises(Interruption):
        train(resumed, FRAMES, EPOCHS, 5, tmp_path / "resumed", interrupt, batch=BATCH)
    again = made(seed=99)  # another process would not have the same weights at hand
    np.random.default_rng().random(7)
    torch.rand(7)
    assert train(again, FRAMES, EPOCHS, 5, tmp_path / "resumed", batch=BATCH) == expected
    assert same(again, whole)
    assert not same(made(), whole)


def test_the_same_seed_trains_the_same_network_and_another_another(tmp_path: Path) -> None:
    networks = [made() for _ in range(3)]
    for i, seed in enumerate((5, 5, 6)):
        train(networks[i], FRAMES, 1, seed, tmp_path / str(i), batch=BATCH)
    assert same(networks[0], networks[1])
    assert not same(networks[0], networks[2])


def test_a_finished_training_is_not_trained_further(tmp_path: Path) -> None:
    one, other = made(), made(seed=1)
    history = train(one, FRAMES, 1, 0, tmp_path, batch=BATCH)
    assert train(other, FRAMES, 1, 0, tmp_path, lambda *_: pytest.fail("trained"), batch=BATCH) == history
    assert same(one, other)


@pytest.mark.parametrize(("seed", "epochs", "n"), [(1, 2, 18), (0, 3, 18), (0, 2, 17)])
def test_a_checkpoint_of_another_training_is_refused(seed: int, epochs: int, n: int, tmp_path: Path) -> None:
    train(made(), FRAMES, 2, 0, tmp_path, batch=BATCH)
    with pytest.raises(InputError, match=r"checkpoint\.pt: is of a training with .*take another folder"):
        train(made(), Frames(FRAMES.images[:n], FRAMES.labels[:n]), epochs, seed, tmp_path, batch=BATCH)


def test_a_damaged_checkpoint_or_one_of_another_network_is_refused(tmp_path: Path) -> None:
    train(made(), FRAMES, 1, 0, tmp_path, batch=BATCH)
    other = DarknetNetwork(parse_cfg(CFG.replace("filters=8", "filters=6"), "other.cfg"))
    with pytest.raises(InputError, match=r"checkpoint\.pt: not a checkpoint of this network: "):
        train(other, FRAMES, 1, 0, tmp_path, batch=BATCH)
    whole = (tmp_path / "checkpoint.pt").read_bytes()
    at = len(whole) // 2  # among the weights, of which torch does not check the ZIP's own sums
    flipped = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
    for content in (b"", b"\x80\x04.", whole[:at], flipped):
        (tmp_path / "checkpoint.pt").write_bytes(content)
        with pytest.raises(InputError, match=r"checkpoint\.pt: not a checkpoint"):
            train(made(), FRAMES, 1, 0, tmp_path, batch=BATCH)


def test_a_checkpoint_that_holds_code_does_not_run_it(tmp_path: Path) -> None:
    class Code:
        def __reduce__(self) -> tuple:
            return (Path.touch, (tmp_path / "ran",))

    torch.save(Code(), tmp_path / "checkpoint.pt")
    with pytest.raises(InputError, match=r"checkpoint\.pt: not a checkpoint"):
        train(made(), FRAMES, 1, 0, tmp_path, batch=BATCH)
    assert not (tmp_path / "ran").exists()


def test_too_few_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pictures: 18 given, a step of training needs 32"):
        train(made(), FRAMES, 1, 0, tmp_path)


def test_no_file_of_weights_is_loaded_that_may_hold_code() -> None:
    found = []
    for path in Path(ortilo_drake.__file__).parent.rglob("*.py"):
        found += re.findall(r"torch\.load\(.*", path.read_text(encoding="utf-8"))
    assert found  # else the pattern is wrong
    assert all("weights_only=True" in line for line in found)


def test_at_first_objects_are_rare() -> None:
    with torch.inference_mode():
        (head,) = made().eval()(torch.zeros(1, 3, 48, 64))
    assert head.shape == (1, 14, 6, 8)
    assert torch.all(head[0, [4, 11]] < RARE + 1.0)


def test_a_batch_holds_pixels_in_0_to_1_and_boxes_from_the_corner() -> None:
    frames = coloured_rectangles(6)
    hidden, small = frames.labels.copy(), frames.labels.copy()
    hidden[:, 0, 5], small[:, 0, 5] = 0.3, 0.01
    for labels, (there, wanted) in ((frames.labels, (True, True)), (hidden, (True, False)), (small, (False, None))):
        rng = np.random.default_rng(0)
        pixels, boxes, classes, keep = batch_of(Frames(frames.images, labels), np.arange(6), rng)
        assert pixels.shape == (6, 3, 48, 64)
        assert pixels.dtype == torch.float32
        assert 0.0 <= float(pixels.min()) < float(pixels.max()) <= 1.0
        assert torch.all(classes[:, 1:] == -1)
        for i in range(6):
            if not there:
                assert classes[i, 0] == -1
                continue
            assert classes[i, 0] == i % 2
            assert bool(keep[i, 0]) is wanted
            x, y, w, h = boxes[i, 0].tolist()
            red, _, blue = pixels[i, :, int(y), int(x)].tolist()  # the pixel that holds the centre
            assert (blue > red + 0.2) if i % 2 else (red > blue + 0.2)
            assert x - w / 2 >= 0.0
            assert x + w / 2 <= 64.0
            assert y - h / 2 >= 0.0
            assert y + h / 2 <= 48.0
