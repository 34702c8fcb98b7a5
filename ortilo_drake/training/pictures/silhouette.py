"""The silhouette of a thing: its area in the picture if nothing hid it."""

import numpy as np
from numba import njit


@njit(cache=True)
def silhouette_pixels(uv: np.ndarray, triangles: np.ndarray, width: int, height: int) -> int:
    """Return the number of pixels whose centres a mesh covers, as the renderer counts them.

    Args:
        uv: the vertices in the image [px] (n, 2), a pixel's centre at integers.
        triangles: numbers of three vertices each (m, 3).
        width: image width [px].
        height: image height [px].
    """
    left, top = max(0, int(np.ceil(uv[:, 0].min()))), max(0, int(np.ceil(uv[:, 1].min())))
    right, bottom = min(width - 1, int(np.floor(uv[:, 0].max()))), min(height - 1, int(np.floor(uv[:, 1].max())))
    if right < left or bottom < top:
        return 0
    covered = np.zeros((bottom - top + 1, right - left + 1), dtype=np.bool_)
    for k in range(triangles.shape[0]):
        a, b, c = uv[triangles[k, 0]], uv[triangles[k, 1]], uv[triangles[k, 2]]
        twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if twice == 0.0:
            continue
        for v in range(max(top, int(np.ceil(min(a[1], b[1], c[1])))), min(bottom, int(max(a[1], b[1], c[1]))) + 1):
            for u in range(max(left, int(np.ceil(min(a[0], b[0], c[0])))), min(right, int(max(a[0], b[0], c[0]))) + 1):
                # Inside, the three triangles with the pixel's centre have areas of the sign of the whole triangle.
                p = (b[0] - u) * (c[1] - v) - (b[1] - v) * (c[0] - u)
                q = (c[0] - u) * (a[1] - v) - (c[1] - v) * (a[0] - u)
                if p / twice >= 0.0 and q / twice >= 0.0 and (p + q) / twice <= 1.0:
                    covered[v - top, u - left] = True
    return int(covered.sum())
