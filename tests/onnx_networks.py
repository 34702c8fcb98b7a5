"""Small ONNX networks with the heads of YOLOv5, v8 and v11, and their results by NumPy and OpenCV alone.

Each head has the layers of Ultralytics: v5 has sigmoid, grid and anchors; v8 and v11 have distances as means of
distributions (DFL); v11 has class scores behind a convolution by channels. One convolution for each stride, with random
weights and a kernel as large as the stride, replaces the backbone.
"""

from pathlib import Path

import cv2
import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

STRIDES = (8, 16, 32)
BINS = 16  # number of bins in the distribution of a distance
ANCHORS = np.array(
    [[[10, 13], [16, 30], [33, 23]], [[30, 61], [62, 45], [59, 119]], [[116, 90], [156, 198], [373, 326]]]
)


def sigmoid(x: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-x))


class Network:
    """A network with a head 'v5', 'v8' or 'v11', with c classes, for an input of this width and height [px].

    The same weights are written to an ONNX file (`write`) and computed by NumPy (`rows`).
    """

    def __init__(self, head: str, classes: int, size: tuple[int, int], seed: int = 0, kind: type = np.float32):
        self.head, self.classes, self.size, self.kind = head, classes, size, kind
        rng = np.random.default_rng(seed)
        channels = 3 * (5 + classes) if head == "v5" else 4 * BINS + classes
        # Random kernels respond to a picture's mean and slopes; with this spread some scores pass and most do not.
        self.weights = [rng.normal(0.0, 3.0 / s, (channels, 3, s, s)).astype(np.float32) for s in STRIDES]
        self.biases = [rng.normal(-1.5 if head != "v5" else -0.5, 0.5, channels).astype(np.float32) for _ in STRIDES]
        self.by_channel = [rng.normal(1.0, 0.3, (classes, 1, 1, 1)).astype(np.float32) for _ in STRIDES]

    # --- as ONNX ----------------------------------------------------------------------------------------------

    def write(self, path: Path, metadata: dict[str, str] | None = None, **options) -> Path:
        """Write the ONNX file with metadata; options: shapes of `extra` outputs, `open_sides` for open input sizes."""
        nodes, given = [], []

        def constant(name: str, value) -> str:
            array = np.asarray(value)
            given.append(
                numpy_helper.from_array(array.astype(self.kind if array.dtype.kind == "f" else np.int64), name)
            )
            return name

        def node(kind: str, inputs: list[str], *names: str, **attributes) -> str:
            nodes.append(helper.make_node(kind, inputs, [*names], **attributes))
            return names[0]

        parts = []
        width, height = self.size
        for i, s in enumerate(STRIDES):
            n_x, n_y = width // s, height // s
            kernel, bias = constant(f"w{i}", self.weights[i]), constant(f"b{i}", self.biases[i])
            raw = node("Conv", ["images", kernel, bias], f"raw{i}", strides=[s, s], kernel_shape=[s, s])
            grid = np.stack(np.meshgrid(np.arange(n_x), np.arange(n_y)), axis=-1).astype(np.float32)
            parts.append((self._v5 if self.head == "v5" else self._v8)(i, s, n_x, n_y, raw, grid, constant, node))
        axis = 1 if self.head == "v5" else 2
        node("Concat", parts, "output0", axis=axis)
        n = sum((width // s) * (height // s) for s in STRIDES)
        shape = (1, 3 * n, 5 + self.classes) if self.head == "v5" else (1, 4 + self.classes, n)
        of = TensorProto.FLOAT16 if self.kind is np.float16 else TensorProto.FLOAT
        outputs = [helper.make_tensor_value_info("output0", of, shape)]
        for k, extra in enumerate(options.get("extra", ())):
            constant(f"extra{k}", np.zeros(extra, dtype=np.float32))
            node("Identity", [f"extra{k}"], f"output{k + 1}")
            outputs.append(helper.make_tensor_value_info(f"output{k + 1}", of, extra))
        sides = ["height", "width"] if options.get("open_sides") else [height, width]
        batch = "batch" if options.get("open_sides") else 1
        images = helper.make_tensor_value_info("images", of, [batch, 3, *sides])
        graph = helper.make_graph(nodes, "net", [images], outputs, given)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        helper.set_model_props(model, metadata or {})
        onnx.save(model, path)
        return path

    def _v5(self, i, s, n_x, n_y, raw, grid, constant, node) -> str:
        c = 5 + self.classes
        shape = constant(f"shape{i}", [1, 3, c, n_y, n_x])
        rows = node("Transpose", [node("Reshape", [raw, shape], f"r{i}")], f"t{i}", perm=[0, 1, 3, 4, 2])
        y = node("Sigmoid", [rows], f"y{i}")
        node("Split", [y, constant(f"sizes{i}", [2, 2, c - 4])], f"xy{i}", f"wh{i}", f"conf{i}", axis=4)
        xy = node("Add", [node("Mul", [f"xy{i}", constant(f"two{i}", np.float32(2.0))], f"a{i}"),
                          constant(f"grid{i}", grid[None, None] - np.float32(0.5))], f"c{i}")  # fmt: skip
        xy = node("Mul", [xy, constant(f"stride{i}", np.float32(s))], f"d{i}")
        wh = node("Mul", [f"wh{i}", f"two{i}"], f"e{i}")
        wh = node("Mul", [wh, wh], f"f{i}")
        wh = node("Mul", [wh, constant(f"anchors{i}", ANCHORS[i].astype(np.float32).reshape(1, 3, 1, 1, 2))], f"g{i}")
        whole = node("Concat", [xy, wh, f"conf{i}"], f"h{i}", axis=4)
        return node("Reshape", [whole, constant(f"flat{i}", [1, 3 * n_x * n_y, c])], f"out{i}")

    def _v8(self, i, s, n_x, n_y, raw, grid, constant, node) -> str:
        c, n = self.classes, n_x * n_y
        node("Split", [raw, constant(f"sizes{i}", [4 * BINS, c])], f"box{i}", f"cls{i}", axis=1)
        scores = f"cls{i}"
        if self.head == "v11":
            scores = node("Conv", [scores, constant(f"dw{i}", self.by_channel[i])], f"dwo{i}", group=c)
        scores = node("Reshape", [node("Sigmoid", [scores], f"sig{i}"), constant(f"fc{i}", [1, c, n])], f"sc{i}")
        bins = node("Reshape", [f"box{i}", constant(f"fb{i}", [1, 4, BINS, n])], f"bins{i}")
        chance = node("Softmax", [node("Transpose", [bins], f"tb{i}", perm=[0, 2, 1, 3])], f"p{i}", axis=1)
        mean = constant(f"dfl{i}", np.arange(BINS, dtype=np.float32).reshape(1, BINS, 1, 1))
        far = node("Reshape", [node("Conv", [chance, mean], f"dist{i}"), constant(f"ff{i}", [1, 4, n])], f"far{i}")
        node("Split", [far, constant(f"halves{i}", [2, 2])], f"lt{i}", f"rb{i}", axis=1)
        at = constant(f"at{i}", (grid + np.float32(0.5)).reshape(-1, 2).T[None])
        low, high = node("Sub", [at, f"lt{i}"], f"low{i}"), node("Add", [at, f"rb{i}"], f"high{i}")
        two = constant(f"two{i}", np.float32(2.0))
        center = node("Div", [node("Add", [low, high], f"sum{i}"), two], f"center{i}")
        box = node("Concat", [center, node("Sub", [high, low], f"extent{i}")], f"cwh{i}", axis=1)
        box = node("Mul", [box, constant(f"stride{i}", np.float32(s))], f"scaled{i}")
        return node("Concat", [box, scores], f"out{i}", axis=1)

    # --- by NumPy ---------------------------------------------------------------------------------------------

    def rows(self, pixels: np.ndarray) -> np.ndarray:
        """Return the rows x, y, w, h [px] and the scores by class (n x 4 + c), for an input (3 x height x width)."""
        found = []
        for i, s in enumerate(STRIDES):
            _, height, width = pixels.shape
            n_x, n_y = width // s, height // s
            patches = pixels.reshape(3, n_y, s, n_x, s).transpose(1, 3, 0, 2, 4).reshape(n_y * n_x, -1)
            raw = patches.astype(float) @ self.weights[i].reshape(len(self.weights[i]), -1).T.astype(float)
            raw += self.biases[i]
            x, y = (a.ravel() for a in np.meshgrid(np.arange(n_x), np.arange(n_y)))
            if self.head == "v5":
                for a in range(3):
                    t = sigmoid(raw[:, a * (5 + self.classes) : (a + 1) * (5 + self.classes)])
                    b = np.column_stack([2 * t[:, 0] - 0.5 + x, 2 * t[:, 1] - 0.5 + y]) * s
                    found.append(np.hstack([b, (2 * t[:, 2:4]) ** 2 * ANCHORS[i][a], t[:, 5:] * t[:, 4:5]]))
                continue
            e = np.exp(raw[:, : 4 * BINS].reshape(-1, 4, BINS))
            left, top, right, bottom = ((e / e.sum(axis=2, keepdims=True)) @ np.arange(BINS)).T
            logits = raw[:, 4 * BINS :]
            if self.head == "v11":
                logits = logits * self.by_channel[i].reshape(-1).astype(float)
            b = np.column_stack(
                [x + 0.5 + (right - left) / 2, y + 0.5 + (bottom - top) / 2, left + right, top + bottom]
            )
            found.append(np.hstack([b * s, sigmoid(logits)]))
        return np.vstack(found)


def seen_by(
    network: Network, image: np.ndarray, threshold: float, overlap: float
) -> list[tuple[int, float, np.ndarray]]:
    """Return the detections (class, score, box) in a picture, best first: Ultralytics' letterbox, OpenCV's NMS."""
    height, width = image.shape[:2]
    r = min(network.size[0] / width, network.size[1] / height)
    new = round(width * r), round(height * r)
    dw, dh = (network.size[0] - new[0]) / 2, (network.size[1] - new[1]) / 2
    left, top = round(dw - 0.1), round(dh - 0.1)
    if new != (width, height):
        image = cv2.resize(image, new, interpolation=cv2.INTER_LINEAR)
    sides = top, round(dh + 0.1), left, round(dw + 0.1)
    whole = cv2.copyMakeBorder(image, *sides, cv2.BORDER_CONSTANT, value=(114, 114, 114))
    rows = network.rows(whole.transpose(2, 0, 1).astype(np.float32) / np.float32(255))
    found = []
    best = rows[:, 4:].argmax(axis=1)
    for k in range(network.classes):
        its = rows[best == k]
        corner = its[:, :2] - its[:, 2:4] / 2
        boxes = np.hstack([corner, its[:, 2:4]])
        for j in np.ravel(cv2.dnn.NMSBoxes(boxes.tolist(), its[:, 4 + k].tolist(), threshold, overlap)):
            u = its[j, 0] + its[j, 2] * np.array([-0.5, 0.5]) - left
            v = its[j, 1] + its[j, 3] * np.array([-0.5, 0.5]) - top
            u, v = u * width / new[0] - 0.5, v * height / new[1] - 0.5
            box = np.array([u[0], v[0], u[1], v[1]]).clip(-0.5, np.array([width, height] * 2) - 0.5)
            found.append((k, float(its[j, 4 + k]), box))
    return sorted(found, key=lambda row: -row[1])
