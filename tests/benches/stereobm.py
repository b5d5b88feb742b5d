#!/usr/bin/env python3
"""OpenCV's StereoBM and `multiscopic bench` side by side, in turns, in one run.

    pip install opencv-python-headless
    cargo build --release && tests/benches/stereobm.py

Each turn takes the best of a few runs of one thread; what is printed is the best over all turns, in 10^9 disparity evaluations per
second (a pixel, a disparity, a view), and the ratio to OpenCV. StereoBM is measured with its default filters and with the texture
and uniqueness checks off, which is its fastest setting.
"""

import argparse
import json
import pathlib
import subprocess
import time

import cv2
import numpy as np

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/multiscopic"


def opencv(size, disparities, block, filters, repeat):
    """The best rate of StereoBM on noise that is shifted by 20 pixels."""
    width, height = size
    noise = np.random.default_rng(0).integers(0, 256, (height, width + 20), dtype=np.uint8)
    left, right = np.ascontiguousarray(noise[:, :width]), np.ascontiguousarray(noise[:, 20:])
    matcher = cv2.StereoBM_create(disparities, block)
    if not filters:
        matcher.setTextureThreshold(0)
        matcher.setUniquenessRatio(0)
    best = float("inf")
    for _ in range(repeat):
        start = time.perf_counter()
        matcher.compute(left, right)
        best = min(best, time.perf_counter() - start)
    return width * height * disparities / best / 1e9


def multiscopic(size, disparities, block, options, repeat):
    """The best rate of the project's own matcher."""
    numbers = zip(("width", "height", "num-disparities", "block-size", "threads", "repeat"), (*size, disparities, block, 1, repeat))
    command = [PROGRAM, "bench", "--json", "--hidden=none", *options, *(f"--{name}={value}" for name, value in numbers)]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return report["gde_per_s"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="1282x1110")
    parser.add_argument("--disparities", type=int, default=64)
    parser.add_argument("--block", type=int, default=11)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=5, help="runs in each turn")
    options = parser.parse_args()
    size = tuple(map(int, options.size.split("x")))
    case = (size, options.disparities, options.block)
    cv2.setNumThreads(1)

    ours = ("--views 1", "--views 2 --fusion min", "--views 4 --fusion heuristic")
    best = {}
    for _ in range(options.turns):
        rates = {f"StereoBM, {name}": opencv(*case, filters, options.repeat) for name, filters in (("default", True), ("no filters", False))}
        rates |= {f"multiscopic {name}": multiscopic(*case, name.split(), options.repeat) for name in ours}
        best = {name: max(rate, best.get(name, 0)) for name, rate in rates.items()}

    default, fastest = best["StereoBM, default"], best["StereoBM, no filters"]
    print(f"OpenCV {cv2.__version__}, {options.size}, {options.disparities} disparities, block {options.block}, one thread")
    print(f"{'':40} {'GDE/s':>7} {'/ default':>10} {'/ no filters':>13}")
    for name, rate in best.items():
        print(f"{name:40} {rate:7.3f} {rate / default:9.2f}x {rate / fastest:12.2f}x")


if __name__ == "__main__":
    main()
