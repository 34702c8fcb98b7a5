"""Make tests/data/darknet_references.json: what OpenCV's Darknet importer computes for the tests' networks.

OpenCV 5 no longer has the importer: run this where opencv-python-headless 4 is, it needs NumPy beside and nothing of
this package. For each network it stores sampled entries and the norm of every raw head, and the strongest boxes of
OpenCV's own decoding.

    python scripts/make_darknet_references.py
"""

import json
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "onboard"))

from darknet_architectures import ANCHORS, architecture, seeded_image, write_seeded_weights  # noqa: E402

SAMPLES = 200


def strongest(regions: list[np.ndarray]) -> tuple[float, list[list[float]]]:
    """Return a threshold and the boxes above it as (class, score, x, y, width, height), shares of the image.

    The threshold lies in the widest gap between the 30th and the 60th score, so that rounding moves no box over it.
    """
    rows = np.concatenate(regions).astype(float)
    scores = rows[:, 5:].max(axis=1)
    order = np.argsort(-scores)
    gaps = scores[order[30:60]] - scores[order[31:61]]
    n = 31 + int(np.argmax(gaps))
    threshold = 0.5 * (scores[order[n - 1]] + scores[order[n]])
    boxes = [[int(rows[i, 5:].argmax()), scores[i], *rows[i, :4]] for i in order[:n]]
    return float(threshold), [[float(f"{value:.8g}") for value in box] for box in boxes]


def reference(name: str) -> dict[str, object]:
    """Return what OpenCV computes for a network."""
    with tempfile.TemporaryDirectory() as folder:
        cfg, weights = Path(folder) / "net.cfg", Path(folder) / "net.weights"
        cfg.write_text(architecture(name).text)
        checksum = write_seeded_weights(weights, name)
        net = cv2.dnn.readNetFromDarknet(str(cfg), str(weights))
    net.enableWinograd(False)
    yolos = [layer for layer in net.getLayerNames() if layer.startswith("yolo_")]
    # OpenCV names a layer after its number in the .cfg, and the convolution comes right before its yolo.
    raw = [f"conv_{int(layer.removeprefix('yolo_')) - 1}" for layer in yolos]
    net.setInput(seeded_image(name))
    outputs = net.forward([*raw, *yolos])
    rng = np.random.default_rng(1)
    heads = []
    for head in outputs[: len(raw)]:
        indices = np.sort(rng.choice(head.size, SAMPLES, replace=False))
        values = [float(f"{value:.8g}") for value in head.ravel()[indices]]
        norm = float(np.linalg.norm(head.astype(float)))
        heads.append({"shape": head.shape, "norm": norm, "indices": indices.tolist(), "values": values})
    threshold, boxes = strongest(outputs[len(raw) :])
    print(
        name,
        [(head["shape"], round(head["norm"] / float(np.prod(head["shape"])) ** 0.5, 3)) for head in heads],
        threshold,
        len(boxes),
    )
    return {"opencv": cv2.__version__, "crc32": checksum, "heads": heads, "threshold": threshold, "boxes": boxes}


if __name__ == "__main__":
    references = {name: reference(name) for name in ANCHORS}
    (ROOT / "tests" / "data" / "darknet_references.json").write_text(json.dumps(references) + "\n")
