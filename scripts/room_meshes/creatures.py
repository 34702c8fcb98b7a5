"""The landmarks that live: person, dog, cat and bird, in about their natural size [m], facing +x."""

import numpy as np
from room_meshes.obj_file import Recipe
from room_meshes.paint import clouds, ellipses, grid, lines, mixed, plaid, plain, striped
from room_meshes.solids import Solid, box, ellipsoid, loft, mirrored, moved

Part = tuple[str, Solid]


def both(name: str, solid: Solid) -> list[Part]:
    """Return a part and its mirror image."""
    return [(name, solid), (name, mirrored(solid))]


def person(rng: np.random.Generator) -> Recipe:
    """Return a person in the middle of a step: plaid shirt, jeans, white shoes, brown hair."""
    skin = plain(rng, (224, 172, 138), 5.0)
    face = ellipses(skin, (250, 250, 250), (0.42, 0.55, 0.035, 0.03), (0.58, 0.55, 0.035, 0.03))
    face = ellipses(face, (40, 30, 25), (0.42, 0.55, 0.018, 0.03), (0.58, 0.55, 0.018, 0.03))
    face = lines(face, (80, 50, 30), 2, (0.37, 0.62, 0.46, 0.63), (0.54, 0.63, 0.63, 0.62))
    face = ellipses(face, (170, 60, 60), (0.5, 0.32, 0.055, 0.022))
    jeans = lines(plain(rng, (52, 76, 130), 12.0), (40, 58, 100), 1, (0.25, 0.0, 0.25, 1.0), (0.75, 0.0, 0.75, 1.0))
    shirt = plaid(rng, (120, 40, 140), (235, 225, 240), 6)
    shirt = lines(shirt, (245, 245, 245), 2, (0.5, 0.0, 0.5, 0.9))
    swatches = {
        "skin": skin,
        "face": face,
        "jeans": jeans,
        "shirt": shirt,
        "sleeve": plaid(rng, (120, 40, 140), (235, 225, 240), 4),
        "hair": striped(rng, (74, 46, 26), (58, 34, 18), 9, 0.5, across=True),
        "shoe": lines(plain(rng, (240, 240, 240), 6.0), (200, 40, 40), 6, (0.3, 0.3, 0.3, 0.8), (0.7, 0.3, 0.7, 0.8)),
        "belt": plain(rng, (60, 38, 22)),
    }
    parts: list[Part] = []
    for side, ankle_x, knee_x, ankle_z, tilt in ((1.0, 0.15, 0.10, 0.10, 0.0), (-1.0, -0.20, -0.05, 0.13, 14.0)):
        y = 0.10 * side
        legs = [(0.0, 0.9 * y, 0.97), (0.03, y, 0.80), (knee_x, y, 0.52), (ankle_x - 0.01, y, ankle_z)]
        parts.append(("jeans", loft(legs, [0.11, 0.10, 0.075, 0.06], 9)))
        sole = [(-0.09, 0, 0.0), (-0.07, 0, 0.0), (0.05, 0, -0.005), (0.15, 0, -0.02), (0.19, 0, -0.03)]
        shoe = loft(sole, [0.02, (0.075, 0.05), (0.065, 0.055), (0.045, 0.05), 0.02], 8)
        parts.append(("shoe", moved(shoe, (ankle_x, y, ankle_z - 0.03), pitch=tilt)))
        elbow_x, hand_x, hand_z = -0.1 * ankle_x / 0.15, 0.4 * -ankle_x, 0.93
        arm = [(0.0, 0.16 * side, 1.50), (0.0, 0.20 * side, 1.47), (elbow_x, 0.235 * side, 1.20)]
        parts.append(("sleeve", loft(arm, [0.05, 0.065, 0.05], 8)))
        fore = [(elbow_x, 0.235 * side, 1.21), (hand_x + 0.02, 0.225 * side, 1.0), (hand_x + 0.03, 0.225 * side, 0.98)]
        parts.append(("skin", loft(fore, [0.046, 0.034, 0.032], 8)))
        parts.append(("skin", ellipsoid((hand_x + 0.05, 0.225 * side, hand_z), (0.045, 0.027, 0.085), 8, 6)))
    trunk = [(0.0, 0.0, z) for z in (0.88, 0.98, 1.12, 1.32, 1.45, 1.53, 1.555)]
    widths = [(0.11, 0.165), (0.125, 0.175), (0.11, 0.155), (0.13, 0.19), (0.115, 0.20), (0.08, 0.13), (0.06, 0.07)]
    parts.append(("shirt", loft(trunk, widths, 14)))
    parts.append(("belt", loft([(0, 0, 0.90), (0, 0, 0.94)], [(0.118, 0.172), (0.127, 0.178)], 14)))
    parts.append(("skin", loft([(0.0, 0.0, 1.52), (0.015, 0.0, 1.64)], [0.058, 0.052], 8)))
    parts.append(("face", ellipsoid((0.03, 0.0, 1.735), (0.100, 0.088, 0.135), 14, 10)))
    parts.append(("skin", loft([(0.12, 0, 1.75), (0.145, 0, 1.705)], [0.008, 0.017], 6)))
    parts += both("skin", ellipsoid((0.02, 0.09, 1.73), (0.022, 0.014, 0.035), 6, 5))
    parts.append(("hair", moved(ellipsoid((0, 0, 0), (0.105, 0.098, 0.105), 12, 8), (-0.015, 0, 1.80), pitch=-25)))
    parts.append(("hair", ellipsoid((-0.055, 0.0, 1.71), (0.065, 0.090, 0.12), 12, 7)))
    return Recipe(swatches, parts)


def dog(rng: np.random.Generator) -> Recipe:
    """Return a standing beagle: black saddle, brown sides and head, white belly, legs, muzzle and tail tip."""
    white, brown, black = (242, 238, 230), (168, 98, 46), (38, 32, 30)
    u, v = grid()
    away = np.abs(u - 0.5) + 0.035 * clouds(rng, 7)  # from the back's middle line
    coat = mixed(plain(rng, white), plain(rng, brown), away < 0.31)
    coat = mixed(coat, plain(rng, black), (away < 0.20) & (v < 0.8))
    head = mixed(plain(rng, brown), plain(rng, white), (np.abs(u - 0.5) < 0.06) & (v > 0.2))
    leg = mixed(plain(rng, white), plain(rng, brown), v + 0.05 * clouds(rng, 6) > 0.72)
    swatches = {
        "coat": coat,
        "head": head,
        "leg": leg,
        "ear": plain(rng, (122, 66, 30), 10.0),
        "white": plain(rng, white),
        "black": plain(rng, (24, 22, 22), 4.0),
        "tail": mixed(plain(rng, black), plain(rng, white), v > 0.65),
        "eye": ellipses(plain(rng, (46, 28, 16), 3.0), (255, 255, 255), (0.5, 0.65, 0.1, 0.1)),
        "tongue": plain(rng, (225, 110, 120)),
        "collar": plain(rng, (40, 90, 200)),
    }
    spine = [(-0.31, 0, 0.40), (-0.28, 0, 0.39), (-0.18, 0, 0.385), (0.0, 0, 0.375), (0.13, 0, 0.37), (0.21, 0, 0.40)]
    parts: list[Part] = [
        ("coat", loft(spine, [0.03, (0.085, 0.08), (0.10, 0.095), (0.105, 0.10), (0.125, 0.11), (0.07, 0.06)], 14)),
        ("coat", loft([(0.15, 0, 0.42), (0.22, 0, 0.49), (0.25, 0, 0.545)], [0.09, 0.07, 0.062], 10)),
        ("collar", loft([(0.195, 0, 0.475), (0.215, 0, 0.495)], [0.082, 0.079], 10)),
        (
            "head",
            loft([(0.17, 0, 0.56), (0.20, 0, 0.57), (0.27, 0, 0.58), (0.33, 0, 0.56)], [0.02, 0.07, 0.078, 0.05], 12),
        ),
        (
            "white",
            loft([(0.30, 0, 0.545), (0.38, 0, 0.53), (0.42, 0, 0.525)], [0.053, (0.042, 0.04), (0.03, 0.032)], 10),
        ),
        ("black", ellipsoid((0.425, 0, 0.54), (0.02, 0.022, 0.018), 8, 6)),
        ("tongue", loft([(0.38, 0, 0.495), (0.405, 0, 0.475), (0.40, 0, 0.45)], [(0.007, 0.018)] * 3, 6)),
        (
            "tail",
            loft(
                [(-0.29, 0, 0.43), (-0.34, 0, 0.52), (-0.35, 0, 0.60), (-0.32, 0, 0.67)], [0.028, 0.024, 0.02, 0.01], 8
            ),
        ),
    ]
    ear = loft(
        [(0.25, 0.06, 0.63), (0.245, 0.088, 0.57), (0.25, 0.092, 0.50), (0.25, 0.085, 0.47)],
        [(0.012, 0.03), (0.012, 0.045), (0.012, 0.045), (0.008, 0.02)],
        8,
        (0, 1, 0),
    )
    parts += both("ear", ear) + both("eye", ellipsoid((0.322, 0.036, 0.592), (0.014, 0.012, 0.015), 8, 6))
    front = loft(
        [(0.17, 0.06, 0.0), (0.15, 0.065, 0.03), (0.14, 0.065, 0.18), (0.14, 0.065, 0.32), (0.14, 0.05, 0.40)],
        [0.03, 0.03, 0.032, 0.052, 0.03],
        9,
    )
    hind = loft(
        [
            (-0.21, 0.065, 0.0),
            (-0.235, 0.065, 0.03),
            (-0.25, 0.065, 0.16),
            (-0.195, 0.065, 0.25),
            (-0.2, 0.055, 0.36),
            (-0.2, 0.03, 0.43),
        ],
        [0.03, 0.03, 0.032, 0.06, 0.065, 0.03],
        9,
    )
    parts += both("leg", front) + both("leg", hind)
    parts += both("white", ellipsoid((0.17, 0.065, 0.02), (0.05, 0.036, 0.022), 8, 5))
    parts += both("white", ellipsoid((-0.205, 0.065, 0.02), (0.05, 0.036, 0.022), 8, 5))
    return Recipe(swatches, parts)


def cat(rng: np.random.Generator) -> Recipe:
    """Return a sitting grey tabby, its tail laid round its left side."""
    grey, dark = (150, 150, 155), (72, 72, 80)
    u, v = grid()
    tabby = striped(rng, grey, dark, 7, 0.3)
    coat = mixed(tabby, plain(rng, (225, 222, 218)), (np.abs(u - 0.5) < 0.10) & (v > 0.35))
    face = striped(rng, grey, dark, 7, 0.2, across=True)
    face = mixed(face, plain(rng, grey), v < 0.55)
    face = ellipses(face, (235, 232, 228), (0.46, 0.36, 0.055, 0.10), (0.54, 0.36, 0.055, 0.10))
    face = ellipses(face, (190, 215, 60), (0.41, 0.58, 0.042, 0.055), (0.59, 0.58, 0.042, 0.055))
    face = ellipses(face, (10, 10, 10), (0.41, 0.58, 0.013, 0.05), (0.59, 0.58, 0.013, 0.05))
    face = ellipses(face, (225, 120, 130), (0.5, 0.44, 0.025, 0.025))
    face = lines(face, (60, 50, 50), 1, (0.5, 0.42, 0.46, 0.34), (0.5, 0.42, 0.54, 0.34))
    swatches = {
        "coat": coat,
        "tabby": tabby,
        "face": face,
        "ear": mixed(plain(rng, grey), plain(rng, (230, 165, 165)), np.abs(u - 0.5) < 0.2),
        "paw": mixed(striped(rng, grey, dark, 6, 0.2), plain(rng, (235, 232, 228)), v < 0.2),
        "white": plain(rng, (235, 232, 228)),
        "tail": striped(rng, grey, dark, 8, 0.1),
    }
    trunk = [(-0.08, 0, 0.0), (-0.075, 0, 0.04), (-0.06, 0, 0.12), (-0.02, 0, 0.22), (0.03, 0, 0.30), (0.05, 0, 0.36)]
    parts: list[Part] = [
        (
            "coat",
            loft(trunk, [(0.11, 0.10), (0.13, 0.125), (0.125, 0.12), (0.105, 0.10), (0.085, 0.085), (0.05, 0.05)], 14),
        ),
        ("face", ellipsoid((0.075, 0, 0.39), (0.085, 0.088, 0.075), 16, 10)),
        ("white", ellipsoid((0.15, 0, 0.365), (0.025, 0.038, 0.025), 8, 6)),
    ]
    parts += both(
        "ear",
        loft(
            [(0.05, 0.052, 0.43), (0.055, 0.062, 0.47), (0.06, 0.07, 0.515)],
            [(0.022, 0.036), (0.014, 0.024), (0.002, 0.003)],
            8,
            (1, 0, 0),
        ),
    )
    parts += both(
        "paw",
        loft(
            [(0.13, 0.045, 0.0), (0.105, 0.045, 0.03), (0.09, 0.045, 0.14), (0.06, 0.055, 0.25)],
            [0.03, 0.032, 0.034, 0.05],
            9,
        ),
    )
    parts += both("white", ellipsoid((0.13, 0.045, 0.02), (0.048, 0.034, 0.022), 8, 5))
    parts += both("tabby", ellipsoid((-0.04, 0.10, 0.085), (0.115, 0.06, 0.09), 10, 8))
    parts += both("white", ellipsoid((0.06, 0.125, 0.02), (0.055, 0.03, 0.022), 8, 5))
    tail = [
        (-0.19, 0.0, 0.03),
        (-0.21, 0.08, 0.03),
        (-0.17, 0.155, 0.03),
        (-0.06, 0.19, 0.03),
        (0.05, 0.19, 0.03),
        (0.12, 0.17, 0.03),
    ]
    parts.append(("tail", loft(tail, [0.03, 0.03, 0.03, 0.029, 0.027, 0.012], 8)))
    return Recipe(swatches, parts)


def bird(rng: np.random.Generator) -> Recipe:
    """Return a standing parrot: blue back and wings, yellow breast, red crown, orange beak."""
    blue, yellow = (20, 90, 215), (250, 205, 30)
    u, v = grid()
    feathers = striped(rng, blue, (60, 170, 235), 7, 0.6)
    body = mixed(feathers, plain(rng, yellow, 12.0), np.abs(u - 0.5) > 0.24)
    head = mixed(plain(rng, yellow, 8.0), plain(rng, (30, 150, 70)), (v > 0.62) | (np.abs(u - 0.5) > 0.3))
    head = ellipses(head, (255, 255, 255), (0.36, 0.56, 0.07, 0.11), (0.64, 0.56, 0.07, 0.11))
    head = ellipses(head, (10, 10, 10), (0.37, 0.56, 0.035, 0.06), (0.63, 0.56, 0.035, 0.06))
    swatches = {
        "body": body,
        "wing": mixed(feathers, striped(rng, (20, 50, 130), (10, 30, 90), 8, 0.2), v < 0.35),
        "head": head,
        "beak": plain(rng, (250, 130, 20), 6.0),
        "tail": striped(rng, blue, (15, 50, 140), 5, 0.1, across=True),
        "foot": plain(rng, (220, 130, 60)),
    }
    spine = [(-0.09, 0, 0.12), (-0.07, 0, 0.135), (-0.02, 0, 0.18), (0.03, 0, 0.24), (0.055, 0, 0.29), (0.065, 0, 0.33)]
    parts: list[Part] = [
        ("body", loft(spine, [0.02, 0.05, 0.085, 0.085, 0.065, 0.05], 14, (-1, 0, 1))),
        ("head", ellipsoid((0.07, 0, 0.345), (0.065, 0.058, 0.058), 14, 9)),
        (
            "beak",
            loft(
                [(0.115, 0, 0.352), (0.15, 0, 0.348), (0.172, 0, 0.325), (0.170, 0, 0.305)],
                [(0.03, 0.026), (0.024, 0.02), (0.014, 0.012), 0.002],
                8,
            ),
        ),
        (
            "tail",
            loft(
                [(-0.06, 0, 0.14), (-0.13, 0, 0.075), (-0.19, 0, 0.02)],
                [(0.015, 0.035), (0.012, 0.042), (0.007, 0.05)],
                8,
            ),
        ),
    ]
    wing = loft(
        [(-0.14, 0.05, 0.085), (-0.09, 0.075, 0.13), (-0.02, 0.095, 0.20), (0.03, 0.088, 0.27), (0.045, 0.06, 0.30)],
        [(0.006, 0.012), (0.012, 0.035), (0.018, 0.06), (0.018, 0.05), (0.01, 0.02)],
        8,
        (0, 1, 0),
    )
    parts += both("wing", wing)
    parts += both("foot", loft([(0.0, 0.04, 0.15), (0.01, 0.045, 0.08), (0.01, 0.045, 0.01)], [0.022, 0.012, 0.011], 7))
    for yaw in (-30.0, 0.0, 30.0):
        parts += both("foot", moved(box((0.03, 0, 0.008), (0.07, 0.014, 0.016)), (0.01, 0.045, 0.0), yaw=yaw))
    parts += both("foot", box((-0.02, 0.045, 0.008), (0.05, 0.014, 0.016)))
    return Recipe(swatches, parts)
