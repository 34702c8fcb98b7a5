"""Painted swatches, the pieces of a texture: SIDE x SIDE x 3 arrays, RGB in [0, 255], row 0 at the top."""

import cv2
import numpy as np

SIDE = 64  # [px] of a swatch; a texture is a square of swatches
Colour = tuple[int, int, int]


def clouds(rng: np.random.Generator, cells: int = 8, side: int = SIDE) -> np.ndarray:
    """Return smooth noise (side, side) of about unit size, which repeats at its borders."""
    x = np.arange(side) * cells / side
    i, share = x.astype(int), x - x.astype(int)
    blend = np.zeros((side, cells))
    blend[np.arange(side), i] += 1.0 - share
    blend[np.arange(side), (i + 1) % cells] += share
    return blend @ rng.normal(size=(cells, cells)) @ blend.T


def plain(rng: np.random.Generator, colour: Colour, spread: float = 8.0, side: int = SIDE) -> np.ndarray:
    """Return a colour with clouds of the given strength."""
    return np.array(colour, dtype=float) + spread * clouds(rng, 8, side)[:, :, None]


def mixed(a: np.ndarray, b: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return a where the mask is false, b where it is true."""
    return np.where(mask[:, :, None], b, a)


def grid(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """Return the texture coordinates (u, v) of every pixel's centre, v upwards."""
    at = (np.arange(side) + 0.5) / side
    return np.meshgrid(at, at[::-1])


def spotted(rng: np.random.Generator, a: Colour, b: Colour, level: float = 0.7, cells: int = 6) -> np.ndarray:
    """Return patches of b on a; the higher the level, the fewer."""
    return mixed(plain(rng, a), plain(rng, b), clouds(rng, cells) > level)


def striped(rng: np.random.Generator, a: Colour, b: Colour, count: float, wave: float = 0.0, across=False):
    """Return level stripes of b on a (upright if ``across``), wavy by a share of their width."""
    u, v = grid()
    phase = (u if across else v) * count + wave * clouds(rng, 5)
    return mixed(plain(rng, a), plain(rng, b), phase % 1.0 > 0.55)


def plaid(rng: np.random.Generator, a: Colour, b: Colour, count: int) -> np.ndarray:
    """Return a checked cloth."""
    u, v = grid()
    weight = 0.5 * ((u * count) % 1.0 > 0.5) + 0.5 * ((v * count) % 1.0 > 0.5)
    return plain(rng, a, 5.0) * (1.0 - weight[:, :, None]) + plain(rng, b, 5.0) * weight[:, :, None]


def wood(rng: np.random.Generator, colour: Colour, boards: int = 1, side: int = SIDE) -> np.ndarray:
    """Return wood with its grain along u, sawn into boards."""
    u, v = grid(side)
    grain = np.sin(2 * np.pi * (v * 9 + 0.35 * clouds(rng, 4, side))) * 10.0 + 5.0 * clouds(rng, 16, side)
    image = np.array(colour, dtype=float) + grain[:, :, None]
    gap = (v * boards) % 1.0 < 2.0 * boards / side
    return image * (1.0 - 0.55 * (gap & (boards > 1)))[:, :, None] + 0.0 * u[:, :, None]


def ellipses(image: np.ndarray, colour: Colour, *marks: tuple[float, float, float, float]) -> np.ndarray:
    """Return the image with filled ellipses (u, v, half width, half height)."""
    u, v = grid(len(image))
    for center_u, center_v, a, b in marks:
        inside = ((u - center_u) / a) ** 2 + ((v - center_v) / b) ** 2 < 1.0
        image = mixed(image, np.broadcast_to(np.array(colour, dtype=float), image.shape), inside)
    return image


def lines(image: np.ndarray, colour: Colour, width: int, *strokes: tuple[float, float, float, float]) -> np.ndarray:
    """Return the image with straight strokes (u, v, u, v)."""
    n = len(image)
    canvas = np.ascontiguousarray(np.clip(image, 0, 255).astype(np.uint8))
    for a, b, c, d in strokes:
        cv2.line(canvas, (int(a * n), int((1 - b) * n)), (int(c * n), int((1 - d) * n)), colour, width)
    return canvas.astype(float)


def lettered(image: np.ndarray, text: str, colour: Colour, scale: float, width: int = 2) -> np.ndarray:
    """Return the image with a word in its middle."""
    canvas = np.ascontiguousarray(np.clip(image, 0, 255).astype(np.uint8))
    (a, b), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, width)
    n = len(image)
    cv2.putText(canvas, text, ((n - a) // 2, (n + b) // 2), cv2.FONT_HERSHEY_SIMPLEX, scale, colour, width)
    return canvas.astype(float)
