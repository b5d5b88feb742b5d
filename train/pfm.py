"""Images of one channel of floats, rows bottom-up."""

import numpy as np


def read_pfm(path):
    with open(path, "rb") as file:
        kind, size, scale = file.readline(), file.readline().split(), float(file.readline())
        assert kind.strip() == b"Pf", path
        pixels = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4")
    return pixels.reshape(int(size[1]), int(size[0]))[::-1].astype(np.float32)


def write_pfm(path, image):
    with open(path, "wb") as file:
        file.write(b"Pf\n%d %d\n-1.0\n" % image.shape[::-1])
        file.write(image[::-1].astype("<f4").tobytes())
