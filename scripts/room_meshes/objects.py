"""The landmarks that do not live: hydrant, potted plant, chair, bicycle and clock, facing +x [m]."""

import math

import numpy as np
from room_meshes.creatures import Part, both
from room_meshes.obj_file import Recipe
from room_meshes.paint import ellipses, grid, lines, mixed, plain, spotted, striped
from room_meshes.solids import Solid, box, ellipsoid, loft, moved, prism, ring, turned


def rod(a: tuple[float, float, float], b: tuple[float, float, float], radius: float, sides: int = 8) -> Solid:
    """Return a round bar from a to b."""
    return loft([a, b], [radius, radius], sides)


def fire_hydrant(rng: np.random.Generator) -> Recipe:
    """Return a red hydrant with a yellow bonnet, three yellow caps and dark nuts."""
    red, yellow = (205, 25, 25), (250, 200, 20)
    swatches = {
        "red": spotted(rng, red, (170, 15, 20), 0.9),
        "barrel": plain(rng, red, 10.0),
        "bonnet": striped(rng, yellow, (225, 165, 10), 8, 0.0, across=True),
        "cap": plain(rng, yellow),
        "iron": plain(rng, (40, 40, 44)),
    }
    parts: list[Part] = [
        ("red", turned([(0.135, 0.0), (0.135, 0.05), (0.10, 0.05)], 8)),
        ("barrel", turned([(0.10, 0.04), (0.095, 0.06), (0.095, 0.40)], 16)),
        ("red", turned([(0.112, 0.40), (0.118, 0.41), (0.118, 0.435), (0.11, 0.445)], 16)),
        ("bonnet", turned([(0.102, 0.445), (0.098, 0.47), (0.083, 0.51), (0.055, 0.545), (0.035, 0.555)], 16)),
        ("cap", turned([(0.038, 0.55), (0.034, 0.60)], 4)),
        ("red", rod((0.05, 0, 0.29), (0.125, 0, 0.29), 0.062, 12)),
        ("cap", loft([(0.12, 0, 0.29), (0.15, 0, 0.29), (0.158, 0, 0.29)], [0.072, 0.07, 0.05], 8)),
        ("iron", rod((0.15, 0, 0.29), (0.17, 0, 0.29), 0.026, 4)),
    ]
    parts += both("red", rod((0, 0.05, 0.32), (0, 0.125, 0.32), 0.048, 12))
    parts += both("cap", loft([(0, 0.12, 0.32), (0, 0.145, 0.32), (0, 0.153, 0.32)], [0.056, 0.054, 0.04], 8))
    parts += both("iron", rod((0, 0.145, 0.32), (0, 0.165, 0.32), 0.022, 4))
    for k in range(8):
        c, s = math.cos(math.pi * (k + 0.5) / 4), math.sin(math.pi * (k + 0.5) / 4)
        parts.append(("iron", rod((0.115 * c, 0.115 * s, 0.05), (0.115 * c, 0.115 * s, 0.068), 0.012, 6)))
    return Recipe(swatches, parts)


def potted_plant(rng: np.random.Generator) -> Recipe:
    """Return a bush of long arched leaves in a terracotta pot."""
    u, v = grid()
    green = striped(rng, (140, 180, 110), (50, 90, 45), 12, 0.2)
    pot = mixed(plain(rng, (190, 92, 52), 10.0), plain(rng, (166, 78, 46)), v < 0.1)
    vein = np.abs((u % 0.5) - 0.25) < 0.025
    swatches = {
        "pot": pot,
        "rim": plain(rng, (222, 130, 86), 8.0),
        "soil": spotted(rng, (62, 42, 28), (30, 20, 14), 0.3, 16),
        "leaf": mixed(green, plain(rng, (200, 230, 160)), vein),
        "dark": mixed(plain(rng, (30, 95, 40), 10.0), plain(rng, (40, 70, 38)), vein),
    }
    parts: list[Part] = [
        ("pot", turned([(0.10, 0.0), (0.145, 0.17)], 8)),
        ("rim", turned([(0.158, 0.165), (0.162, 0.21)], 8)),
        ("soil", turned([(0.14, 0.205), (0.10, 0.225)], 14)),
    ]
    tiers = [(8, 0.24, 0.10, 0.12), (8, 0.185, 0.19, 0.20), (6, 0.12, 0.27, 0.32), (3, 0.05, 0.30, 0.35)]
    for tier, (count, reach, rise, tip) in enumerate(tiers):
        for k in range(count):
            angle = 2 * math.pi * (k + 0.5 * (tier % 2)) / count + rng.uniform(-0.06, 0.06)
            c, s = math.cos(angle), math.sin(angle)
            r, h = reach * rng.uniform(0.92, 1.06), rng.uniform(0.95, 1.05)
            shape = [(0.02, 0.0), (0.25 * r, 0.6 * rise * h), (0.6 * r, rise * h), (0.85 * r, 0.5 * (rise + tip) * h)]
            shape.append((r, min(tip, rise * 1.3) * h if tier > 1 else tip * h * 0.7))
            points = [(a * c, a * s, 0.215 + b) for a, b in shape]
            leaf = loft(points, [(0.006, 0.012), (0.006, 0.04), (0.006, 0.055), (0.005, 0.038), (0.002, 0.004)], 6)
            parts.append(("leaf" if (k + tier) % 3 else "dark", leaf))
    return Recipe(swatches, parts)


def chair(rng: np.random.Generator) -> Recipe:
    """Return an office chair: turquoise cushions, black arms, column and five-legged base on castors."""
    cloth = striped(rng, (20, 160, 165), (14, 130, 140), 10)
    cloth = lines(
        cloth,
        (8, 90, 100),
        2,
        (0.05, 0.05, 0.95, 0.05),
        (0.95, 0.05, 0.95, 0.95),
        (0.95, 0.95, 0.05, 0.95),
        (0.05, 0.95, 0.05, 0.05),
    )
    swatches = {
        "cloth": cloth,
        "black": plain(rng, (38, 38, 42), 6.0),
        "steel": striped(rng, (180, 182, 188), (150, 152, 158), 6, 0, True),
    }
    seat = [(0.0, 0.0, 0.38), (0.0, 0.0, 0.39), (0.0, 0.0, 0.45), (0.0, 0.0, 0.465)]
    back = prism([(0.23 * c, 0.24 * s) for c, s in _rounded()], 0.06)
    parts: list[Part] = [
        ("cloth", loft(seat, [0.24, 0.27, 0.275, 0.25], 12)),
        ("cloth", moved(back, (-0.25, 0.0, 0.74), pitch=-8.0)),
        ("black", moved(prism([(0.21 * c, 0.22 * s) for c, s in _rounded()], 0.03), (-0.285, 0.0, 0.74), pitch=-8.0)),
        (
            "black",
            loft([(-0.10, 0, 0.37), (-0.30, 0, 0.39), (-0.315, 0, 0.55), (-0.295, 0, 0.70)], [(0.02, 0.045)] * 4, 6),
        ),
        ("black", turned([(0.09, 0.36), (0.09, 0.38)], 10)),
        ("steel", turned([(0.035, 0.12), (0.035, 0.36)], 10)),
        ("black", turned([(0.06, 0.07), (0.05, 0.14)], 10)),
    ]
    parts += both(
        "black",
        loft([(-0.03, 0.20, 0.38), (-0.03, 0.305, 0.42), (-0.03, 0.305, 0.62)], [(0.018, 0.03)] * 3, 6, (0, 1, 0)),
    )
    parts += both("black", box((-0.01, 0.305, 0.635), (0.28, 0.07, 0.035)))
    for k in range(5):
        c, s = math.cos(2 * math.pi * k / 5), math.sin(2 * math.pi * k / 5)
        parts.append(
            (
                "steel",
                loft([(0.03 * c, 0.03 * s, 0.11), (0.29 * c, 0.29 * s, 0.075)], [(0.03, 0.035), (0.018, 0.025)], 6),
            )
        )
        parts.append(("black", ellipsoid((0.29 * c, 0.29 * s, 0.033), (0.035, 0.035, 0.033), 8, 5)))
    return Recipe(swatches, parts)


def _rounded() -> list[tuple[float, float]]:
    """Return a square of half side 1 with bevelled corners, anticlockwise."""
    return [(1, -0.7), (1, 0.7), (0.7, 1), (-0.7, 1), (-1, 0.7), (-1, -0.7), (-0.7, -1), (0.7, -1)]


def bicycle(rng: np.random.Generator) -> Recipe:
    """Return a bicycle: blue frame of 4 cm tubes, black tyres, bright rims and spokes, brown saddle."""
    swatches = {
        "frame": lines(plain(rng, (25, 80, 225), 6.0), (255, 255, 255), 5, (0.0, 0.5, 1.0, 0.5)),
        "tyre": plain(rng, (30, 30, 32), 6.0),
        "steel": plain(rng, (205, 208, 214), 8.0),
        "leather": plain(rng, (130, 72, 34), 10.0),
        "red": plain(rng, (230, 30, 30)),
    }
    rear, front, crank = (-0.50, 0.0, 0.36), (0.56, 0.0, 0.36), (-0.08, 0.0, 0.33)
    seat, head, stem = (-0.22, 0.0, 0.80), (0.36, 0.0, 0.78), (0.33, 0.0, 0.88)
    parts: list[Part] = []
    for center in (rear, front):
        parts.append(("tyre", ring(center, 0.335, 0.026, 28, 6)))
        parts.append(("steel", ring(center, 0.305, 0.012, 24, 4)))
        parts.append(("steel", rod((center[0], -0.05, center[2]), (center[0], 0.05, center[2]), 0.028, 8)))
        for k in range(12):
            a = 2 * math.pi * k / 12
            tip = (center[0] + 0.30 * math.cos(a), 0.0, center[2] + 0.30 * math.sin(a))
            parts.append(("steel", rod((center[0], 0.03 * (-1) ** k, center[2]), tip, 0.006, 4)))
    tubes = [
        (crank, seat, 0.021),
        (crank, head, 0.023),
        ((-0.21, 0, 0.76), (0.35, 0, 0.80), 0.021),
        (head, stem, 0.025),
    ]
    parts += [("frame", rod(a, b, radius)) for a, b, radius in tubes]
    for a, b in ((rear, crank), (rear, (-0.205, 0.0, 0.74)), (front, (0.385, 0.0, 0.74))):
        parts += both("frame", rod((a[0], 0.045, a[2]), (b[0], 0.03, b[2]), 0.016, 7))
    parts.append(("frame", loft([(0.40, 0, 0.69), (0.365, 0, 0.75), (0.35, 0, 0.82)], [0.03, 0.035, 0.026], 8)))
    parts.append(("steel", rod(seat, (-0.245, 0, 0.90), 0.016)))
    saddle = [(-0.38, 0, 0.925), (-0.36, 0, 0.925), (-0.25, 0, 0.92), (-0.14, 0, 0.92), (-0.09, 0, 0.915)]
    parts.append(
        ("leather", loft(saddle, [(0.015, 0.05), (0.035, 0.085), (0.03, 0.06), (0.025, 0.03), (0.012, 0.015)], 10))
    )
    parts.append(("steel", rod(stem, (0.34, 0, 0.97), 0.018)))
    parts += both("steel", loft([(0.34, 0, 0.97), (0.37, 0.12, 0.985), (0.32, 0.24, 0.985)], [0.017] * 3, 7))
    parts += both("leather", rod((0.325, 0.20, 0.985), (0.265, 0.27, 0.985), 0.023, 7))
    parts.append(("steel", rod((-0.08, 0.035, 0.33), (-0.08, 0.055, 0.33), 0.10, 14)))
    for side in (1.0, -1.0):
        pedal = (-0.08 + 0.12 * side, 0.085 * side, 0.33 - 0.12 * side)
        parts.append(("steel", rod((-0.08, 0.075 * side, 0.33), pedal, 0.014, 6)))
        parts.append(("tyre", box((pedal[0], 0.13 * side, pedal[2]), (0.09, 0.09, 0.03))))
    parts.append(("red", box((-0.40, 0.0, 0.86), (0.03, 0.06, 0.05))))
    return Recipe(swatches, parts)


def clock(rng: np.random.Generator) -> Recipe:
    """Return a round clock that shows ten past ten on both sides."""
    at = [(math.sin(math.pi * k / 6), math.cos(math.pi * k / 6)) for k in range(12)]
    face = plain(rng, (250, 250, 244), 2.0)
    for k, (s, c) in enumerate(at):
        strokes = (0.5 + 0.36 * s, 0.5 + 0.36 * c, 0.5 + 0.45 * s, 0.5 + 0.45 * c)
        face = lines(face, (15, 15, 20), 4 if k % 3 == 0 else 2, strokes)
    ten, ten_past = math.radians(305), math.radians(60)
    face = lines(face, (10, 10, 15), 5, (0.5, 0.5, 0.5 + 0.22 * math.sin(ten), 0.5 + 0.22 * math.cos(ten)))
    face = lines(face, (10, 10, 15), 3, (0.5, 0.5, 0.5 + 0.35 * math.sin(ten_past), 0.5 + 0.35 * math.cos(ten_past)))
    face = lines(face, (210, 20, 20), 1, (0.5, 0.58, 0.5, 0.12))
    face = ellipses(face, (210, 20, 20), (0.5, 0.5, 0.04, 0.04))
    swatches = {"face": face, "rim": plain(rng, (120, 72, 36), 8.0), "black": plain(rng, (25, 25, 28), 4.0)}
    smooth = [(math.cos(2 * math.pi * k / 48), math.sin(2 * math.pi * k / 48)) for k in range(48)]
    depth, r = [-0.05, -0.06, -0.06, 0.06, 0.06, 0.05], [0.155, 0.162, 0.175, 0.175, 0.162, 0.155]
    z, x = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    rim = loft([(d, 0.0, 0.0) for d in depth], r, 12, z, x)  # twelve corners: a hull of 24 points
    parts: list[Part] = [
        ("rim", rim),
        ("black", prism([(0.160 * c, 0.160 * s) for c, s in smooth], 0.113)),
        ("face", prism([(0.15 * c, 0.15 * s) for c, s in smooth], 0.116)),
    ]
    return Recipe(swatches, parts)
