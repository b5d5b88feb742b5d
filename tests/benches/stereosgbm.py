#!/usr/bin/env python3
"""OpenCV's StereoSGBM and `multiscopic bench --method sgm` side by side, in turns, in one run.

    pip install opencv-python-headless
    cargo build --release && tests/benches/stereosgbm.py [--data DIR]

Each turn takes the best of a few runs of one thread; what is printed is the best over all turns, in milliseconds, and how many times
as fast multiscopic is. StereoSGBM has blocks of 3 and 5 pixels, P1 and P2 of 8 and 32 times their area, and its filters off.

With the folder of the data sets, both are compared with ground truth too, in stereo: the mean share of pixels off by more than one
pixel or invalid.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import cv2
import numpy as np

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/multiscopic"
MODES = {4: cv2.STEREO_SGBM_MODE_HH4, 5: cv2.STEREO_SGBM_MODE_SGBM, 8: cv2.STEREO_SGBM_MODE_HH}
# The grey value of a pixel of disparity in the ground truth, and the disparities.
DATA_SETS = {"middlebury2006-third": (12, 20), "middlebury2005-full": (4, 60)}


def matcher(disparities, block, paths, least=0):
    """StereoSGBM without filters."""
    area = block * block
    return cv2.StereoSGBM_create(least, disparities, block, 8 * area, 32 * area, -1, 63, 0, 0, 0, MODES[paths])


def opencv(size, disparities, block, paths, repeat):
    """The best time of StereoSGBM on noise that is shifted by 20 pixels."""
    width, height = size
    noise = np.random.default_rng(0).integers(0, 256, (height, width + 20), dtype=np.uint8)
    left, right = np.ascontiguousarray(noise[:, :width]), np.ascontiguousarray(noise[:, 20:])
    sgbm = matcher(disparities, block, paths)
    best = float("inf")
    for _ in range(repeat):
        start = time.perf_counter()
        sgbm.compute(left, right)
        best = min(best, time.perf_counter() - start)
    return best


def multiscopic(size, disparities, options, repeat, threads=1):
    """The best time of the project's own."""
    names = ("width", "height", "num-disparities", "threads", "repeat")
    numbers = zip(names, (*size, disparities, threads, repeat))
    command = [PROGRAM, "bench", "--json", "--method=sgm", "--hidden=none", *options]
    command += [f"--{name}={value}" for name, value in numbers]
    report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return report["seconds"]


def grey(path):
    """A picture in the grey that multiscopic matches."""
    blue, green, red = cv2.split(cv2.imread(str(path)).astype(np.int32))
    return ((77 * red + 150 * green + 29 * blue + 128) >> 8).astype(np.uint8)


def bad_1(data, name):
    """Prints the mean share of bad pixels of both in stereo."""
    levels, disparities = DATA_SETS[name]
    shares = {}
    scenes = sorted(path.parent for path in (data / name).glob("*/disp1.*"))
    for scene in scenes:
        truth = cv2.imread(str(scene / "disp1.png"), cv2.IMREAD_GRAYSCALE) / levels
        center, right = (grey(next(scene.glob(f"view{i}.*"))) for i in (1, 2))
        for block in (3, 5):
            found = matcher(-(-disparities // 16) * 16, block, 5, 1).compute(center, right) / 16
            bad = (found < 1) | (abs(found - truth) > 1)
            shares.setdefault(f"StereoSGBM, block {block}", []).append(100 * bad[truth > 0].mean())
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "records.json"
        command = [PROGRAM, "evaluate", data, "--dataset", name, "--methods", "sgm", "--views", "1", "--json", file]
        subprocess.run(command, check=True, capture_output=True)
        shares["multiscopic --method sgm"] = [record["bad_1"] for record in json.loads(file.read_text())]
    print(f"\n{name}, {len(scenes)} scenes, stereo: Bad1 in percent")
    for method, values in shares.items():
        print(f"{method:40} {np.mean(values):7.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="1282x1110")
    parser.add_argument("--disparities", type=int, default=64)
    parser.add_argument("--paths", type=int, choices=MODES, default=5)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=3, help="runs in each turn")
    parser.add_argument("--data", type=pathlib.Path, metavar="DIR")
    options = parser.parse_args()
    size = tuple(map(int, options.size.split("x")))
    cv2.setNumThreads(1)

    ours = ("--views 1", "--views 2 --fusion min", "--views 4 --fusion heuristic")
    best = {}
    for _ in range(options.turns):
        times = {f"StereoSGBM, block {block}": opencv(size, options.disparities, block, options.paths, options.repeat) for block in (3, 5)}
        paths = f"--paths={options.paths}"
        times |= {f"multiscopic {name}": multiscopic(size, options.disparities, [paths, *name.split()], options.repeat) for name in ours}
        best = {name: min(seconds, best.get(name, seconds)) for name, seconds in times.items()}

    print(f"OpenCV {cv2.__version__}, {options.size}, {options.disparities} disparities, {options.paths} paths, one thread")
    print(f"{'':40} {'ms':>7} {'block 3 /':>10} {'block 5 /':>10}")
    for name, seconds in best.items():
        ratios = (f"{best[f'StereoSGBM, block {block}'] / seconds:9.2f}x" for block in (3, 5))
        print(f"{name:40} {1e3 * seconds:7.0f} {' '.join(ratios)}")
    if options.data:
        for name in DATA_SETS:
            bad_1(options.data, name)


if __name__ == "__main__":
    main()
