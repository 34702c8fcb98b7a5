"""Clutter: things in the room that are no landmarks, z = 0 at their foot [m]."""

import math

import numpy as np
from room_meshes.creatures import Part, both
from room_meshes.obj_file import Recipe
from room_meshes.objects import rod
from room_meshes.paint import ellipses, grid, lettered, lines, mixed, plain, spotted, striped, wood
from room_meshes.solids import box, ellipsoid, loft, moved, prism, ring, turned

SIZE = {  # extents [m]
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
}


def bookshelf(rng: np.random.Generator) -> Recipe:
    """Return a shelf of books, open in front (+y, as its model in the room's source)."""
    swatches = {"wood": wood(rng, (140, 98, 58)), "back": wood(rng, (105, 72, 42), 4)}
    colours = [(150, 30, 35), (30, 70, 120), (40, 110, 60), (205, 170, 60), (90, 60, 110), (220, 215, 200)]
    for k, colour in enumerate(colours):
        swatches[f"book{k}"] = lines(plain(rng, colour), (240, 225, 160), 2, (0.2, 0.8, 0.8, 0.8), (0.2, 0.7, 0.8, 0.7))
    parts: list[Part] = [("back", box((0, -0.19, 1.0), (0.9, 0.02, 2.0)))]
    parts += [("wood", box((x, 0, 1.0), (0.03, 0.4, 2.0))) for x in (-0.435, 0.435)]
    for shelf in range(6):
        z = 0.04 + 0.385 * shelf
        parts.append(("wood", box((0, 0, z), (0.86, 0.38, 0.03))))
        x = -0.41
        while shelf < 5 and x < 0.30:
            width, height = rng.uniform(0.03, 0.06), rng.uniform(0.22, 0.33)
            name = f"book{rng.integers(len(colours))}"
            if rng.random() < 0.85:
                parts.append((name, box((x + width / 2, 0.04, z + 0.015 + height / 2), (width, 0.22, height))))
            x += width + 0.004
    return Recipe(swatches, parts)


def cardboard_box(rng: np.random.Generator) -> Recipe:
    """Return a closed cardboard box with a strip of tape."""
    _, v = grid()
    card = striped(rng, (186, 142, 92), (180, 136, 86), 16)
    tape = mixed(card, plain(rng, (222, 200, 150)), np.abs(v - 0.5) < 0.08)
    side = lines(card, (90, 60, 35), 2, (0.12, 0.2, 0.12, 0.45), (0.08, 0.38, 0.12, 0.45), (0.16, 0.38, 0.12, 0.45))
    return Recipe(
        {"card": side, "tape": tape},
        [("card", box((0, 0, 0.15), (0.5, 0.4, 0.298))), ("tape", box((0, 0, 0.15), (0.498, 0.398, 0.3)))],
    )


def table(rng: np.random.Generator) -> Recipe:
    """Return a wooden table."""
    parts: list[Part] = [("top", box((0, 0, 0.78), (1.5, 0.8, 0.04)))]
    parts += both("leg", box((0, 0.33, 0.71), (1.36, 0.03, 0.10)))
    parts += [("leg", box((x, 0, 0.71), (0.03, 0.66, 0.10))) for x in (-0.68, 0.68)]
    for x in (-0.68, 0.68):
        parts += both("leg", box((x, 0.33, 0.38), (0.07, 0.07, 0.76)))
    return Recipe({"top": wood(rng, (176, 128, 78), 5), "leg": wood(rng, (130, 88, 50))}, parts)


def euro_pallet(rng: np.random.Generator) -> Recipe:
    """Return a pallet of boards on nine blocks, its long side along y."""
    parts: list[Part] = [("board", box((x, 0, 0.133), (0.12, 1.2, 0.022))) for x in (-0.34, -0.17, 0, 0.17, 0.34)]
    for y in (-0.53, 0.0, 0.53):
        parts.append(("cross", box((0, y, 0.111), (0.8, 0.14, 0.022))))
        parts += [("cross", box((x, y, 0.061), (0.12, 0.14, 0.078))) for x in (-0.34, 0.0, 0.34)]
    parts += [("board", box((x, 0, 0.011), (0.12, 1.2, 0.022))) for x in (-0.34, 0.0, 0.34)]
    board = np.swapaxes(wood(rng, (196, 158, 106)), 0, 1)
    return Recipe({"board": board, "cross": wood(rng, (178, 138, 90))}, parts)


def stop_sign(rng: np.random.Generator) -> Recipe:
    """Return a stop sign: its red octagon looks along +x, its back and post are grey."""
    plate = lettered(plain(rng, (200, 16, 24), 4.0), "STOP", (255, 255, 255), 0.75, 2)
    u, v = grid()
    a, b = np.abs(u - 0.5), np.abs(v - 0.5)
    edge = np.maximum(np.maximum(a, b), (a + b) / math.sqrt(2.0))
    plate = mixed(plate, np.full(plate.shape, 250.0), (edge > 0.44) & (edge < 0.475))
    steel = plain(rng, (150, 152, 156))
    corners = [(math.cos(math.pi * (k + 0.5) / 4), math.sin(math.pi * (k + 0.5) / 4)) for k in range(8)]
    r = 0.3 / math.cos(math.pi / 8)
    octagon = [(r * c, r * s) for c, s in corners]
    parts: list[Part] = [
        ("plate", moved(prism(octagon, 0.012), (0.014, 0, 1.55))),
        ("steel", moved(prism(octagon, 0.008), (0.004, 0, 1.55))),
        ("steel", box((-0.01, 0, 0.85), (0.02, 0.05, 1.70))),
    ]
    return Recipe({"plate": plate, "steel": steel}, parts)


def ball(rng: np.random.Generator) -> Recipe:
    """Return a beach ball in six colours."""
    u, v = grid()
    image = plain(rng, (245, 245, 245), 2.0)
    for k, colour in enumerate([(225, 40, 40), (40, 90, 210), (250, 210, 40)]):
        image = mixed(image, plain(rng, colour, 2.0), (np.floor(u * 6) == 2 * k) & (v < 0.93))
    return Recipe({"ball": image}, [("ball", ellipsoid((0, 0, 0), (1, 1, 1), 20, 13))])


def tennis_racket(rng: np.random.Generator) -> Recipe:
    """Return a racket lying along x, its head ahead."""
    hoop = ring((0, 0, 0), 1.0, 0.08, 24, 6)
    scaled = hoop._replace(vertices=hoop.vertices * np.array([0.17, 0.18, 0.13]))
    parts: list[Part] = [("frame", moved(scaled, (0.18, 0, 0), roll=90))]
    for k in range(-4, 5):
        y, x = 0.13 * math.sin(k * 0.33), 0.17 * math.sin(k * 0.33)
        reach, width = 0.165 * math.cos(k * 0.33), 0.125 * math.cos(k * 0.33)
        parts.append(("string", box((0.18, y, 0), (2 * reach, 0.004, 0.004))))
        parts.append(("string", box((0.18 + x, 0, 0), (0.004, 2 * width, 0.004))))
    parts += both("frame", rod((0.05, 0.09, 0), (-0.10, 0.012, 0), 0.011))
    parts.append(("grip", rod((-0.08, 0, 0), (-0.33, 0, 0), 0.02, 8)))
    swatches = {
        "frame": plain(rng, (30, 60, 170)),
        "string": plain(rng, (235, 235, 220)),
        "grip": striped(rng, (60, 60, 62), (40, 40, 42), 8, 0.0),
    }
    return Recipe(swatches, parts)


def baseball_bat(rng: np.random.Generator) -> Recipe:
    """Return a bat lying along x, its thick end ahead."""
    x = [-0.43, -0.42, -0.405, -0.40, -0.15, 0.10, 0.36, 0.41, 0.43]
    r = [0.015, 0.026, 0.026, 0.014, 0.015, 0.027, 0.035, 0.032, 0.012]
    grained = np.swapaxes(wood(rng, (206, 164, 104)), 0, 1)
    _, v = grid()
    return Recipe(
        {"wood": mixed(grained, plain(rng, (40, 36, 36)), (v > 0.06) & (v < 0.3))},
        [("wood", loft([(a, 0, 0) for a in x], r, 12))],
    )


def traffic_cone(rng: np.random.Generator) -> Recipe:
    """Return an orange cone with two white bands."""
    _, v = grid()
    image = mixed(
        plain(rng, (245, 98, 20)), plain(rng, (245, 245, 245)), (np.abs(v - 0.42) < 0.09) | (np.abs(v - 0.75) < 0.06)
    )
    parts: list[Part] = [
        ("foot", box((0, 0, 0.015), (0.36, 0.36, 0.03))),
        ("cone", turned([(0.13, 0.03), (0.02, 0.7)], 16)),
    ]
    return Recipe({"cone": image, "foot": plain(rng, (200, 76, 20))}, parts)


def barrel(rng: np.random.Generator) -> Recipe:
    """Return a blue steel drum."""
    profile = [(0.285, 0), (0.29, 0.02), (0.28, 0.04), (0.28, 0.28), (0.29, 0.30), (0.28, 0.32)]
    profile += [(0.28, 0.56), (0.29, 0.58), (0.28, 0.60), (0.28, 0.84), (0.29, 0.86), (0.285, 0.88)]
    swatches = {"drum": spotted(rng, (30, 70, 130), (120, 72, 44), 1.6, 10), "lid": plain(rng, (24, 56, 104))}
    parts: list[Part] = [("drum", turned(profile, 20)), ("lid", turned([(0.27, 0.87), (0.265, 0.881)], 20))]
    return Recipe(swatches, parts)


def suitcase(rng: np.random.Generator) -> Recipe:
    """Return an upright suitcase with wheels and a drawn handle."""
    shell = lines(striped(rng, (95, 30, 50), (80, 22, 42), 7, 0.0, across=True), (40, 12, 20), 2, (0.0, 0.5, 1.0, 0.5))
    parts: list[Part] = [("shell", box((0, 0, 0.31), (0.25, 0.47, 0.52)))]
    parts += both("black", rod((-0.10, 0.12, 0.57), (-0.10, 0.12, 0.75), 0.01))
    parts.append(("black", rod((-0.10, -0.13, 0.75), (-0.10, 0.13, 0.75), 0.015)))
    for x in (-0.09, 0.09):
        parts += both("black", ellipsoid((x, 0.19, 0.03), (0.03, 0.02, 0.03), 8, 5))
    return Recipe({"shell": shell, "black": plain(rng, (34, 34, 36))}, parts)


def bucket(rng: np.random.Generator) -> Recipe:
    """Return a grey bucket with its bail up."""
    parts: list[Part] = [
        ("zinc", turned([(0.10, 0.0), (0.14, 0.25), (0.15, 0.25), (0.15, 0.265), (0.13, 0.265), (0.12, 0.22)], 18)),
        (
            "bail",
            loft(
                [(0, -0.145, 0.255), (0, -0.10, 0.35), (0, 0, 0.38), (0, 0.10, 0.35), (0, 0.145, 0.255)],
                [0.008] * 5,
                6,
                (1, 0, 0),
            ),
        ),
    ]
    return Recipe({"zinc": striped(rng, (150, 156, 160), (132, 138, 142), 12), "bail": plain(rng, (70, 72, 76))}, parts)


def crate(rng: np.random.Generator) -> Recipe:
    """Return a closed crate of boards with a brace on each side."""
    side = wood(rng, (172, 126, 74), 5)
    side = lines(side, (110, 74, 40), 7, (0.05, 0.05, 0.95, 0.95))
    frame = [(0.03, 0.03, 0.97, 0.03), (0.97, 0.03, 0.97, 0.97), (0.97, 0.97, 0.03, 0.97), (0.03, 0.97, 0.03, 0.03)]
    side = ellipses(
        lines(side, (128, 88, 48), 6, *frame), (60, 60, 60), (0.05, 0.05, 0.02, 0.02), (0.95, 0.95, 0.02, 0.02)
    )
    return Recipe({"side": side}, [("side", box((0, 0, 0.25), (0.5, 0.5, 0.5)))])
