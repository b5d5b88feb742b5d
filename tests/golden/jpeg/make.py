#!/usr/bin/env python3
"""Makes the JPEG files beside this script, with Pillow 13 and its libjpeg: each way to code blocks once."""

import math
from pathlib import Path

from PIL import Image

FOLDER = Path(__file__).parent


def wave(color, x, y):
    return int(127 + 100 * math.sin(0.3 * x * (color + 1) * 0.7 + 0.5 * y + color) * math.cos(0.2 * y - color * 0.11 * x))


image = Image.new("RGB", (61, 45))
for y in range(45):
    for x in range(61):
        image.putpixel((x, y), tuple(wave(color, x, y) for color in range(3)))

image.save(FOLDER / "baseline.jpg", quality=60, optimize=True, subsampling=2)
image.save(FOLDER / "progressive.jpg", quality=60, progressive=True, subsampling=1)
image.save(FOLDER / "restarts.jpg", quality=60, optimize=True, subsampling=0, restart_marker_blocks=5)
image.convert("L").save(FOLDER / "gray-progressive.jpg", quality=80, progressive=True, restart_marker_blocks=7)
