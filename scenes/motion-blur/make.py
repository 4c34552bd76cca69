"""Writes flag.brmesh: a flag whose wave moves on while the shutter is open.

The format is that of `brolly convert`: a magic word, then each array as a count and its numbers,
little-endian. Run it in this folder: python3 make.py
"""
import math
import struct

COLUMNS, ROWS = 24, 14
TIMES = [0.0, 0.25, 0.5, 0.75, 1.0]


def vertex(i, j, time):
    u, v = i / COLUMNS, j / ROWS
    # The wave grows away from the pole, at u = 0, which holds the cloth.
    phase = 9.0 * u + 1.2 * v - 3.2 * time
    z = 0.17 * u * (math.sin(phase) - math.sin(1.2 * v - 3.2 * time) * (1.0 - u))
    y = 0.62 * v - 0.05 * u * u + 0.03 * u * math.sin(phase + 1.0)
    return (0.95 * u, y, z)


def rows(out, table):
    out += struct.pack("<Q", len(table))
    for row in table:
        out += struct.pack(f"<{len(row)}f", *row)


def positions(time):
    return [vertex(i, j, time) for j in range(ROWS + 1) for i in range(COLUMNS + 1)]


indices = []
for j in range(ROWS):
    for i in range(COLUMNS):
        a = j * (COLUMNS + 1) + i
        b, c, d = a + 1, a + COLUMNS + 2, a + COLUMNS + 1
        indices += [(a, b, c), (a, c, d)]

out = bytearray(b"brmesh01")
rows(out, positions(TIMES[0]))
rows(out, [])  # normals
rows(out, [])  # tangents
rows(out, [])  # colours
out += struct.pack("<Q", 1)
rows(out, [(i / COLUMNS, j / ROWS) for j in range(ROWS + 1) for i in range(COLUMNS + 1)])
out += struct.pack("<Q", len(indices))
for triangle in indices:
    out += struct.pack("<3I", *triangle)
out += struct.pack("<Qd", len(TIMES), TIMES[0])
for time in TIMES[1:]:
    out += struct.pack("<d", time)
    rows(out, positions(time))
    rows(out, [])
with open("flag.brmesh", "wb") as file:
    file.write(out)
