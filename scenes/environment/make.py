"""Writes sky.hdr: a small evening sky with a sun, as Radiance RGBE in plain rows.

Run it in this folder: python3 make.py
"""
import math

WIDTH, HEIGHT = 96, 48
SUN = (0.62, 0.36, -0.70)  # towards the sun


def radiance(x, y):
    # Latitude and longitude: u = 0.5 + atan2(z, x) / 2 pi, v = acos(y) / pi from the top.
    phi, theta = ((x + 0.5) / WIDTH - 0.5) * 2 * math.pi, (y + 0.5) / HEIGHT * math.pi
    d = (math.sin(theta) * math.cos(phi), math.cos(theta), math.sin(theta) * math.sin(phi))
    up = d[1]
    if up < 0:
        return [0.10 + 0.03 * up, 0.09 + 0.03 * up, 0.08 + 0.03 * up]
    length = math.sqrt(sum(s * s for s in SUN))
    towards = sum(a * b for a, b in zip(d, SUN)) / length
    glow = math.exp((towards - 1) * 14)
    low = math.exp(-up * 5)
    sky = [0.16 + 0.42 * low, 0.27 + 0.24 * low, 0.52 - 0.02 * low]
    sun = 140.0 if towards > math.cos(math.radians(3.2)) else 0.0
    return [s + w * glow + sun * k for s, w, k in zip(sky, (1.6, 0.9, 0.35), (1.0, 0.82, 0.55))]


def rgbe(rgb):
    most = max(rgb)
    if most < 1e-32:
        return bytes(4)
    mantissa, exponent = math.frexp(most)
    scale = mantissa * 256.0 / most
    return bytes([int(c * scale) for c in rgb] + [exponent + 128])


with open("sky.hdr", "wb") as file:
    file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (HEIGHT, WIDTH))
    for y in range(HEIGHT):
        for x in range(WIDTH):
            file.write(rgbe(radiance(x, y)))
