"""Writes the pictures of this scene: bricks, their normal map, and a leaf with a cut-out shape.

Run it in this folder: python3 make.py
"""
import math
import random
import struct
import zlib

SIZE = 128
ROWS, COLUMNS, JOINT = 6, 3, 0.06


def png(name, channels, pixel):
    rows = b"".join(
        b"\0" + b"".join(bytes(max(0, min(255, round(c * 255))) for c in pixel(x, y)) for x in range(SIZE))
        for y in range(SIZE)
    )
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2 if channels == 3 else 6, 0, 0, 0)
    with open(name, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def brick(x, y):
    """Row and column of the brick and the distance to its edge, in brick heights."""
    v = (y % SIZE) / SIZE * ROWS
    row = int(v)
    u = (x % SIZE) / SIZE * COLUMNS + 0.5 * (row % 2)
    column = int(u) % COLUMNS
    fu, fv = u % 1.0, v % 1.0
    return row, column, min(min(fu, 1 - fu) * ROWS / COLUMNS, min(fv, 1 - fv))


random.seed(1)
tones = [[random.uniform(0.75, 1.1) for _ in range(COLUMNS)] for _ in range(ROWS)]
grain = [[random.uniform(-1, 1) for _ in range(SIZE)] for _ in range(SIZE)]


def bricks(x, y):
    row, column, edge = brick(x, y)
    if edge < JOINT:
        return [0.72 + 0.03 * grain[y][x]] * 3
    tone = tones[row][column] + 0.05 * grain[y][x]
    return [0.66 * tone, 0.33 * tone, 0.25 * tone]


def height(x, y):
    edge = brick(x, y)[2]
    return 3.5 * min(1.0, max(0.0, (edge - 0.4 * JOINT) / (1.6 * JOINT))) + 0.12 * grain[y % SIZE][x % SIZE]


def normals(x, y):
    # Red is right, green is up: rows run down.
    n = [0.5 * (height(x - 1, y) - height(x + 1, y)), 0.5 * (height(x, y + 1) - height(x, y - 1)), 1.0]
    length = math.sqrt(sum(c * c for c in n))
    return [0.5 + 0.5 * c / length for c in n]


def leaf(x, y):
    u, v = 2 * (x + 0.5) / SIZE - 1, 1 - 2 * (y + 0.5) / SIZE
    angle, radius = math.atan2(u, v + 0.55), math.hypot(u, v + 0.55)
    outline = 1.35 * (0.62 + 0.38 * abs(math.cos(2.5 * angle))) * max(0.0, math.cos(angle * 0.62))
    vein = min(abs(u), abs(abs(angle) - 0.95) * radius, abs(abs(angle) - 0.45) * radius)
    inside = radius < outline or (abs(u) < 0.04 and v < -0.5)
    green = [0.36, 0.62, 0.16] if vein > 0.03 else [0.62, 0.74, 0.34]
    return green + [1.0 if inside else 0.0]


png("bricks.png", 3, bricks)
png("bricks-normal.png", 3, normals)
png("leaf.png", 4, leaf)
