"""Training of the detector: seeded and resumable; the loss curve is saved and drawn."""

import io
import json
import math
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from ortilo_drake.flight.files import write_bytes, write_text
from ortilo_drake.flight.store import sealed, unsealed
from ortilo_drake.model.input_files import read_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.darknet_layers import Yolo
from ortilo_drake.onboard.detector.darknet_network import Convolution, DarknetNetwork
from ortilo_drake.training.network.augment import augment
from ortilo_drake.training.network.loss import yolo_loss
from ortilo_drake.training.pictures.labels import BOX, CLASS, VISIBLE, Frames, is_to_be_found
from ortilo_drake.views.pictures import save_picture

LEARNING_RATE, WEIGHT_DECAY, WARM_UP = 2.0e-3, 1.0e-3, 500
AVERAGING = 0.998  # decay of the averaged weights
BATCH = 32  # pictures per step
_OF = "checkpoint of a training"  # kind of sealed file for flight/store.py
RARE = -6.0  # logit of an object in a cell before training


def batch_of(frames: Frames, chosen: np.ndarray, rng: np.random.Generator) -> tuple[torch.Tensor, ...]:
    """Return augmented pictures (n x 3 x h x w) in [0, 1], and boxes (n x m x 4), classes and `keep` of yolo_loss."""
    images, boxes, classes, keep = [], [], [], []
    for i in chosen:
        labels = frames.labels[i]
        image, box = augment(frames.images[i], labels[:, BOX].astype(float), rng)
        labels = labels.copy()
        labels[:, BOX] = box
        side = np.minimum(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1])
        gone = (labels[:, CLASS] < 0) | (labels[:, VISIBLE] <= 0.02) | (side < 1.0)
        images.append(image)
        # Centers relative to the image's corner, not to the first pixel's centre.
        boxes.append(np.column_stack([(box[:, :2] + box[:, 2:]) / 2 + 0.5, np.maximum(box[:, 2:] - box[:, :2], 1e-3)]))
        classes.append(np.where(gone, -1, labels[:, CLASS]))
        keep.append(is_to_be_found(labels))
    pixels = torch.from_numpy(np.stack(images)).permute(0, 3, 1, 2).float().div_(255.0)
    noise = torch.from_numpy(rng.uniform(0.0, 0.03, len(chosen)).astype(np.float32)).view(-1, 1, 1, 1)
    generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
    pixels = (pixels + noise * torch.randn(pixels.shape, generator=generator)).clamp_(0.0, 1.0)
    as_tensor = [torch.from_numpy(np.array(x)) for x in (boxes, classes, keep)]
    return pixels.contiguous(memory_format=torch.channels_last), as_tensor[0].float(), as_tensor[1], as_tensor[2]


def initialize(network: DarknetNetwork) -> None:
    """Set the biases of the heads so that objects are rare at first; otherwise empty cells would dominate the loss."""
    for layer, after in zip(network.layers, network.cfg.layers[1:], strict=False):
        if isinstance(after, Yolo) and isinstance(layer, Convolution) and layer.convolution.bias is not None:
            bias = layer.convolution.bias.data.view(len(after.anchors), -1)
            bias[:, 4] = RARE


def train(
    network: DarknetNetwork,
    frames: Frames,
    epochs: int,
    seed: int,
    folder: Path,
    progress: Callable[[int, int, float], None] | None = None,
    batch: int = BATCH,
) -> list[dict[str, float]]:
    """Train an initialised network in place on labelled pictures for a number of epochs; return each epoch's losses.

    After every epoch, weights, averaged weights and the optimiser's state are saved in folder/checkpoint.pt, and the
    loss curve in losses.json. An interrupted training continues from there with the same result. At the end the network
    has the averaged weights. The seed decides the order of the pictures, `batch` per step, and their augmentation.
    `progress` is called with epoch, step and running loss. InputError if there are too few pictures, or the checkpoint
    is damaged or from another training.
    """
    count, width = len(frames.images), frames.images.shape[2]
    if count < batch:
        raise InputError(f"pictures: {count} given, a step of training needs {batch}")
    pictures = zlib.crc32(np.ascontiguousarray(frames.labels).tobytes())
    of = {"seed": seed, "epochs": epochs, "pictures": pictures, "count": count, "batch": batch}
    steps = epochs * (count // batch)
    network.train().to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs miss it
    decayed = [p for p in network.parameters() if p.ndim > 1]
    plain = [p for p in network.parameters() if p.ndim <= 1]
    groups = [{"params": decayed, "weight_decay": WEIGHT_DECAY}, {"params": plain, "weight_decay": 0.0}]
    optimizer = torch.optim.AdamW(groups, lr=LEARNING_RATE)
    average = {key: value.detach().clone() for key, value in network.state_dict().items()}
    history: list[dict[str, float]] = []
    checkpoint = folder / "checkpoint.pt"
    if checkpoint.exists():
        try:
            data = unsealed(read_bytes(checkpoint), _OF)
            kept = torch.load(io.BytesIO(data), weights_only=True)
            same = kept["of"] == of
            if same:
                network.load_state_dict(kept["network"])
                optimizer.load_state_dict(kept["optimizer"])
                average, history = kept["average"], kept["history"]
        except Exception as error:  # pickle, zipfile and torch raise a dozen kinds of errors for damaged files
            reason = " ".join(str(error).split())[:120]
            raise InputError(f"{checkpoint}: not a checkpoint of this network: {reason}") from None
        if not same:
            raise InputError(f"{checkpoint}: is of a training with {kept['of']}, not {of}: take another folder")
    anchors = tuple(torch.as_tensor(a, dtype=torch.float32) for a in (head.anchors for head in network.cfg.heads))
    for epoch in range(len(history), epochs):
        rng = np.random.default_rng([seed, epoch])
        order = rng.permutation(count)
        sums = np.zeros(4)
        for step in range(count // batch):
            k = epoch * (count // batch) + step
            falling = 0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * k / steps))
            rate = LEARNING_RATE * min(1.0, (k + 1) / WARM_UP) * falling
            for group in optimizer.param_groups:
                group["lr"] = rate
            images, boxes, classes, keep = batch_of(frames, order[step * batch : (step + 1) * batch], rng)
            with torch.autocast("cpu", dtype=torch.bfloat16):
                heads = network(images)
            loss, parts = yolo_loss(heads, anchors, boxes, classes, keep, width)
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 20.0)
            optimizer.step()
            with torch.no_grad():
                a = min(AVERAGING, (k + 1) / (k + 10))
                for key, value in network.state_dict().items():
                    if value.is_floating_point():
                        average[key].lerp_(value, 1.0 - a)
                    else:
                        average[key].copy_(value)
            sums += [float(loss.detach()), *parts.tolist()]
            if progress:
                progress(epoch, step, sums[0] / (step + 1))
        names = ("loss", "box", "object", "class")  # the last three without their weights
        history.append(dict(zip(names, (sums / (count // batch)).tolist(), strict=True)))
        state = {"of": of, "network": network.state_dict(), "optimizer": optimizer.state_dict()}
        packed = io.BytesIO()
        torch.save({**state, "average": average, "history": history}, packed)
        write_bytes(checkpoint, sealed(packed.getvalue(), _OF))
        write_text(folder / "losses.json", json.dumps(history, indent=2) + "\n")
    network.load_state_dict(average)
    network.eval()
    return history


def losses_figure(history: list[dict[str, float]], path: Path) -> Path:
    """Draw each epoch's loss and its parts to a picture file; return the path."""
    figure = Figure(figsize=(6.0, 3.6), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    epochs = range(1, len(history) + 1)
    for name in ("loss", "box", "object", "class"):
        axes.semilogy(epochs, [row[name] for row in history], "k" if name == "loss" else "", label=name, marker=".")
    axes.set(xlabel="epoch", ylabel="loss a picture")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    return save_picture(figure, path)
