"""The loss of a YOLOv3 head.

Redmon, Farhadi, "YOLOv3: an incremental improvement" (2018), section 2: logistic objectness and independent logistic
classes, boxes relative to anchors. There are two differences. The box loss is the complete IoU (Zheng et al.,
"Distance-IoU loss", 2020), because localisation is judged by IoU. An object trains every anchor of about its shape at
every scale, not only the best anchor, because that learns faster from few pictures.
"""

import math

import torch

Tensor = torch.Tensor

SAME_SHAPE = 3.0  # an object trains anchors whose width and height are within this ratio of the object's
IGNORE_IOU = 0.6  # a prediction with a greater IoU with an object is not trained as empty
W_BOX, W_OBJECT, W_CLASS = 4.0, 1.0, 0.5


def complete_iou(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Return IoU and complete IoU (...) of paired boxes (..., 4), each center x, center y, width, height."""
    a_low, a_high, b_low, b_high = (x[..., :2] + s * x[..., 2:] / 2 for x in (a, b) for s in (-1, 1))
    overlap = (torch.minimum(a_high, b_high) - torch.maximum(a_low, b_low)).clamp(min=0).prod(-1)
    union = a[..., 2:].prod(-1) + b[..., 2:].prod(-1) - overlap + 1e-7
    iou = overlap / union
    hull = torch.maximum(a_high, b_high) - torch.minimum(a_low, b_low)
    distance = (a[..., :2] - b[..., :2]).square().sum(-1) / (hull.square().sum(-1) + 1e-7)
    turn = torch.atan(b[..., 2] / b[..., 3]) - torch.atan(a[..., 2] / (a[..., 3] + 1e-7))
    v = 4.0 / math.pi**2 * turn.square()
    with torch.no_grad():
        alpha = v / (1.0 - iou + v + 1e-7)
    return iou, iou - distance - alpha * v


def predicted_boxes(head: Tensor, anchors: Tensor, stride: float) -> Tensor:
    """Return the boxes (n x a x h x w x 4), center x, center y, width, height [px], of a head (n x a x h x w x c)."""
    _, _, h, w, _ = head.shape
    y, x = torch.meshgrid(torch.arange(h), torch.arange(w), indexing="ij")
    center = (torch.sigmoid(head[..., 0:2]) + torch.stack([x, y], dim=-1)) * stride
    size = anchors[None, :, None, None, :] * torch.exp(head[..., 2:4].clamp(max=6.0))
    return torch.cat([center, size], dim=-1)


def yolo_loss(
    heads: tuple[Tensor, ...], anchors: tuple[Tensor, ...], boxes: Tensor, classes: Tensor, keep: Tensor, width: int
) -> tuple[Tensor, Tensor]:
    """Return the loss of a batch of n pictures and its parts box, object, class (3).

    `heads` are raw outputs (n x a (5 + c) x h x w), `anchors` the width and height of each head's anchors (a x 2) [px].
    Objects have `boxes` (n x m x 4), center x, center y, width, height [px from the corner of the input], and `classes`
    (n x m), -1 for no object. Detections of objects with `keep` (n x m) false do not count. `width` is the width of the
    input [px], and all pixels are pixels of the input.
    """
    bce = torch.nn.functional.binary_cross_entropy_with_logits
    parts = torch.zeros(3)
    batch = boxes.shape[0]
    for raw, anchor in zip(heads, anchors, strict=True):
        n, channels, h, w = raw.shape
        a = len(anchor)
        head = raw.float().view(n, a, channels // a, h, w).permute(0, 1, 3, 4, 2)
        stride = width / w
        found = predicted_boxes(head, anchor, stride)
        # Indices of image, object and anchor for each trained cell.
        ratio = boxes[:, :, None, 2:] / anchor[None, None]
        fits = torch.maximum(ratio, 1.0 / ratio.clamp(min=1e-6)).amax(-1) < SAME_SHAPE
        fits &= ((classes >= 0) & keep)[:, :, None]
        image, which, k = torch.nonzero(fits, as_tuple=True)
        cell = (boxes[image, which, :2] / stride).long()
        column, row = cell[:, 0].clamp(0, w - 1), cell[:, 1].clamp(0, h - 1)
        target = torch.zeros(n, a, h, w)
        target[image, k, row, column] = 1.0
        if len(image):
            chosen = head[image, k, row, column]
            iou, ciou = complete_iou(found[image, k, row, column], boxes[image, which])
            parts[0] = parts[0] + (1.0 - ciou).sum() / batch
            wanted = torch.nn.functional.one_hot(classes[image, which].long(), channels // a - 5).float()
            parts[2] = parts[2] + bce(chosen[:, 5:], wanted, reduction="sum") / batch
        with torch.no_grad():
            taught = torch.ones_like(target, dtype=torch.bool)
            for i in range(n):
                there = classes[i] >= 0
                if there.any():
                    iou, _ = complete_iou(found[i].reshape(-1, 1, 4), boxes[i, there][None])
                    bar = torch.where(keep[i, there], IGNORE_IOU, 0.3)
                    taught[i] = ~(iou > bar).any(1).view(a, h, w)
            taught |= target > 0
        parts[1] = parts[1] + bce(head[..., 4][taught], target[taught], reduction="sum") / batch
    return W_BOX * parts[0] + W_OBJECT * parts[1] + W_CLASS * parts[2], parts.detach()
