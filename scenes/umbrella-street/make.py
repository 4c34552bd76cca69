"""Writes scene.json: a street at night in the rain, hundreds of lamps, umbrellas that walk by.

Everything that is random is drawn from one seed. Run it in this folder: python3 make.py
"""
import json
import math
import random

random.seed(22)
WARM, COOL, RED, GREEN = (1.0, 0.68, 0.36), (0.55, 0.75, 1.0), (1.0, 0.18, 0.1), (0.25, 1.0, 0.55)


def translate(*by):
    return {"translate": list(by)}


def scale(*by):
    return {"scale": list(by) if len(by) == 3 else list(by) * 3}


def rotate(axis, degrees):
    return {"rotate": {"axis": [int(axis == a) for a in "xyz"], "degrees": degrees}}


def shape(what, material, *steps, **more):
    return {"shape": what, "material": material, "transform": list(steps), **more}


def glow(color, strength):
    return {"emission": {"radiance": [round(c * strength, 3) for c in color]}}


def pick(*colors):
    return random.choice(colors)


def canopy(ribs=8, rings=4):
    """An umbrella's cloth: a spherical cap whose panels sag between the ribs."""
    points, faces, around = [[0, 0, 0]], [], 2 * ribs
    for ring in range(1, rings + 1):
        t = ring / rings
        for i in range(around):
            angle = 2 * math.pi * i / around
            sag = 0.94 if i % 2 else 1.0
            r, y = math.sin(1.15 * t) * sag, math.cos(1.15 * t) - 1 - (0.05 * t if i % 2 else 0)
            points.append([round(v, 4) for v in (r * math.cos(angle), y, r * math.sin(angle))])
    for i in range(around):
        k = (i + 1) % around
        faces.append([0, 1 + k, 1 + i])
        for ring in range(rings - 1):
            a, b = 1 + ring * around + i, 1 + ring * around + k
            faces += [[a, b, b + around], [a, b + around, a + around]]
    return {"positions": points, "indices": faces}


primitives = [
    shape("rectangle", "asphalt", scale(40, 60, 1), rotate("x", -90), translate(0, 0, -40)),
]
# Houses: dark walls along both sides, most of their windows lit.
for side in (-1, 1):
    for house in range(7):
        z, height = -3.0 - 6.2 * house, random.uniform(5.5, 9.5)
        turn = rotate("y", -90 * side)
        wall = pick("plaster", "brick")
        primitives.append(shape("rectangle", wall, scale(3.0, height / 2, 1), turn, translate(4.6 * side, height / 2, z)))
        for floor in range(int(height / 1.5) - 1):
            for window in range(4):
                if random.random() < 0.55:
                    color = pick(WARM, WARM, WARM, COOL)
                    at = translate(round(4.58 * side, 3), round(2.4 + 1.45 * floor, 2), round(z - 2.1 + 1.4 * window, 2))
                    light = glow(color, random.uniform(0.6, 2.2))
                    primitives.append(shape("rectangle", "dark", scale(0.32, 0.45, 1), turn, at, **light))
        # A shop's window and sign.
        color = pick(WARM, COOL, GREEN, RED, WARM)
        front = translate(round(4.57 * side, 3), 1.0, z)
        primitives.append(shape("rectangle", "dark", scale(2.2, 0.75, 1), turn, front, **glow(WARM, random.uniform(0.6, 1.6))))
        sign = translate(round(4.0 * side, 2), 2.2, round(z + 1.5, 2))
        primitives.append(shape("rectangle", "dark", scale(0.4, 0.22, 1), sign, **glow(color, 6)))
# Street lamps, and strings of bulbs across the street.
for row in range(8):
    for side in (-1, 1):
        at = translate(3.1 * side, 3.5, round(-2.0 - 5.0 * row, 2))
        primitives.append(shape({"sphere": {"radius": 0.13}}, "dark", at, **glow(WARM, 75)))
    z = -4.5 - 5.0 * row
    for bulb in range(15):
        x = -3.9 + 7.8 * bulb / 14
        y = 4.3 - 0.75 * (1 - (x / 3.9) ** 2)
        color = pick(WARM, WARM, RED, GREEN, COOL)
        at = translate(round(x, 2), round(y, 2), z)
        primitives.append(shape({"sphere": {"radius": 0.05}}, "dark", at, **glow(color, 45)))
# Tail lights and headlights of cars far down the street.
for car in range(9):
    z, x, color = random.uniform(-34, -14), pick(-1.6, 1.5), None
    color = RED if x > 0 else (0.95, 0.97, 1.0)
    for side in (-0.45, 0.45):
        speed = 0.9 if x > 0 else -1.1
        keys = [
            {"time": t, "transform": [translate(round(x + side, 2), 0.62, round(z - speed * t, 2))]} for t in (0, 1)
        ]
        lamp = shape({"sphere": {"radius": 0.09}}, "dark", **glow(color, 60))
        lamp["transform"] = {"keys": keys}
        primitives.append(lamp)
# Rain: thin streaks that fall through the picture while the shutter is open.
for drop in range(150):
    x, y, z = random.uniform(-2.2, 2.2), random.uniform(0.3, 3.2), random.uniform(-5, 2.2)
    keys = [{"time": t, "transform": [translate(round(x + 0.02 * t, 3), round(y - 0.4 * t, 3), round(z, 3))]} for t in (0, 1)]
    primitives.append({"shape": {"sphere": {"radius": 0.006}}, "material": "rain", "transform": {"keys": keys}})

cloths = {"blue": "srgb(#1f5fd0)", "red": "srgb(#d23a2e)", "mustard": "srgb(#d9a520)", "green": "srgb(#2c8a5b)", "grey": "srgb(#5b626c)"}
groups = {}
for name in cloths:
    groups[name] = {
        "primitives": [
            shape({"mesh": "canopy"}, f"cloth-{name}", scale(0.62)),
            shape({"mesh": "cone"}, "coat", scale(0.26, 1.15, 0.26), translate(0, -1.62, 0)),
            shape({"sphere": {"radius": 0.13}}, "skin", translate(0, -0.5, 0)),
            shape({"mesh": "cone"}, "handle", scale(0.015, 0.75, 0.015), translate(0, -0.7, 0)),
        ]
    }
ring = [[round(math.cos(2 * math.pi * i / 14), 4), 0, round(math.sin(2 * math.pi * i / 14), 4)] for i in range(14)]
cone = {"positions": ring + [[0, 1, 0]], "indices": [[(i + 1) % 14, i, 14] for i in range(14)]}

# Who walks where: cloth, place, step while the shutter is open, sway.
walkers = [
    ("blue", (-0.35, -0.6), (0.0, 0.02), 1),
    ("red", (0.75, -1.7), (0.10, -0.12), 4),
    ("mustard", (-1.75, -2.6), (-0.06, 0.22), 5),
    ("grey", (1.9, -3.8), (-0.02, -0.2), 4),
    ("green", (-0.6, -5.2), (0.12, 0.2), 5),
    ("red", (-2.4, -7.0), (0.05, 0.3), 6),
    ("grey", (0.6, -8.4), (0.25, -0.1), 6),
    ("mustard", (2.5, -9.5), (0.0, -0.3), 6),
]
instances = []
for cloth, (x, z), (dx, dz), sway in walkers:
    keys = []
    for t in (0, 1):
        lean = rotate("z", 4 + sway * (t - 0.5))
        place = translate(round(x + dx * t, 3), 1.66, round(z + dz * t, 3))
        keys.append({"time": t, "transform": [rotate("y", 20 * sway), lean, place]})
    instances.append({"group": cloth, "transform": {"keys": keys}})


def diffuse(color):
    return {"bsdf": {"diffuse": {"reflectance": color}}}


materials = {
    "asphalt": {
        "bsdf": {
            "coated_diffuse": {"reflectance": [0.045, 0.048, 0.055], "coat": {"ior": 1.33, "roughness": {"u": 0.09, "v": 0.09}}}
        }
    },
    "plaster": diffuse([0.28, 0.26, 0.24]),
    "brick": diffuse([0.22, 0.11, 0.08]),
    "dark": diffuse(0.05),
    "coat": diffuse([0.05, 0.05, 0.07]),
    "skin": diffuse([0.4, 0.25, 0.18]),
    "handle": diffuse([0.2, 0.12, 0.06]),
    "rain": {"bsdf": {"diffuse_transmission": {"reflectance": 0.5, "transmittance": 0.4}}},
}
for name, color in cloths.items():
    materials[f"cloth-{name}"] = diffuse(color)

scene = {
    "brolly": 1,
    "camera": {
        "look_from": [0.15, 1.35, 3.4],
        "look_at": [-0.1, 1.25, -4],
        "vfov": 37,
        "lens": {"radius": 0.055, "focus_distance": 4.1, "aperture": {"blades": {"count": 7, "rotation": 8}}},
        "shutter": [0, 1],
        "shutter_curve": {"trapezoid": {"open": 0.1, "close": 0.1}},
    },
    "film": {"size": [384, 216]},
    "integrator": {"name": "path", "max_depth": 6},
    "spp": 256,
    "materials": materials,
    "meshes": {"canopy": canopy(), "cone": cone},
    "groups": groups,
    "primitives": primitives,
    "instances": instances,
    "lights": [{"environment": {"radiance": [0.012, 0.018, 0.035]}}],
}


def write(scene):
    """One line for each shape, so that the file can be read."""
    parts = []
    for key, value in scene.items():
        if isinstance(value, list):
            text = "[\n" + ",\n".join("    " + json.dumps(v) for v in value) + "\n  ]"
        elif key in ("materials", "meshes", "groups"):
            text = "{\n" + ",\n".join(f'    "{k}": {json.dumps(v)}' for k, v in value.items()) + "\n  }"
        else:
            text = json.dumps(value)
        parts.append(f'  "{key}": {text}')
    with open("scene.json", "w") as file:
        file.write("{\n" + ",\n".join(parts) + "\n}\n")


write(scene)
lamps = sum("emission" in p for p in primitives)
print(f"{len(primitives)} shapes, {lamps} of them lamps")
