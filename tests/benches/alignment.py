#!/usr/bin/env python3
"""The errors that `match --align` leaves of those that are injected into real images.

    pip install numpy scipy pillow
    cargo build --release && tests/benches/alignment.py DATA --scenes middlebury2006-third --errors rolled,mount,together

DATA holds the data sets of `multiscopic evaluate`. Each image is resampled by cubic splines as a turned, scaled, distorting
camera would have taken it, and matched: as it was, as injected, aligned, and undone. "Undone" resamples the injected images by
the exact inverse: the most that an alignment can reach. All are compared on the pixels whose matches are inside all of the
images.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/multiscopic"
NAMES = "center", "left", "right", "top", "bottom"
# Half of a block, and a pixel for interpolation.
MARGIN = 6
K1 = -0.25


@dataclass
class Error:
    """Degrees about the axes to the right, down and ahead of all views; of each view beside the centre; its scale; a lens."""

    mount: tuple = (0, 0, 0)
    rolls: tuple = (0, 0, 0, 0)
    scales: tuple = (1, 1, 1, 1)
    k1: float = 0


ROLLS, SCALES = (1, -1, 0.7, -0.8), (1.01, 0.99, 1.008, 0.993)
ERRORS = {
    "rolled": Error(rolls=ROLLS),
    "scaled": Error(scales=SCALES),
    "mount": Error(mount=(3, 3, 3)),
    "lens": Error(k1=K1),
    "together": Error(mount=(3, -3, 3), rolls=ROLLS, scales=SCALES, k1=K1),
}


@dataclass
class Scenes:
    """Scenes of a data set: the focal length in pixels, the search range, the views' images, and the true disparities."""

    names: tuple
    focal: float
    minimum: int
    disparities: int
    images: tuple
    truth: str
    unit: float
    fusion: str = "min"

    def load(self, folder):
        truth = folder / self.truth
        if truth.suffix == ".pfm":
            disparities = read_pfm(truth) * self.unit
        else:
            disparities = np.array(Image.open(truth)) / self.unit
            disparities[disparities == 0] = np.nan
        return [np.array(Image.open(folder / name).convert("RGB"), float) for name in self.images], disparities


MIDDLEBURY = "view1.png", "view0.png", "view2.png"
LIGHT_FIELD = tuple(f"input_Cam{camera}.png" for camera in ("040", "036", "044", "004", "076"))
DATA_SETS = {
    "middlebury2006-third": Scenes(
        ("Aloe", "Baby1", "Cloth1", "Flowerpots", "Rocks1", "Wood1"), 1246.7, 0, 30, MIDDLEBURY, "disp1.png", 12
    ),
    "middlebury2005-full": Scenes(("Art", "Dolls"), 3740, 0, 76, MIDDLEBURY, "disp1.png", 4),
    # Neither the light field's focal length nor its principal point is stated: these are assumed.
    "hci4d": Scenes(("cotton",), 1000, -8, 16, LIGHT_FIELD, "gt_disp_lowres.pfm", 4, "heuristic"),
}


def read_pfm(path):
    """The samples of a grey PFM file, from the top."""
    with open(path, "rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return np.frombuffer(file.read(), order).reshape(height, width)[::-1].astype(float)


def apply(homography, points):
    x, y, w = np.tensordot(homography, np.stack([*points, np.ones_like(points[0])]), 1)
    return np.stack([x, y]) / w


class Camera:
    """A pinhole camera whose principal point is the middle of the image, behind a lens that distorts by k1."""

    def __init__(self, shape, focal, k1):
        height, width = shape
        self.middle = np.array([(width - 1) / 2, (height - 1) / 2])[:, None, None]
        self.focal, self.k1 = focal, k1

    def matrix(self, scale=1):
        x, y = self.middle.ravel()
        return np.array([[self.focal * scale, 0, x], [0, self.focal * scale, y], [0, 0, 1]])

    def distort(self, points):
        ideal = (points - self.middle) / self.focal
        return ideal * (1 + self.k1 * (ideal**2).sum(0)) * self.focal + self.middle

    def undistort(self, points):
        distorted = (points - self.middle) / self.focal
        ideal = distorted
        for _ in range(20):
            ideal = distorted / (1 + self.k1 * (ideal**2).sum(0))
        return ideal * self.focal + self.middle

    def calibration(self, path):
        """Writes ROS's `camera_info`."""
        height, width = (2 * self.middle.ravel()[::-1] + 1).astype(int)
        data = ", ".join(map(str, self.matrix().ravel()))
        path.write_text(
            f"image_width: {width}\nimage_height: {height}\ncamera_name: camera\n"
            f"camera_matrix: {{rows: 3, cols: 3, data: [{data}]}}\ndistortion_model: plumb_bob\n"
            f"distortion_coefficients: {{rows: 1, cols: 5, data: [{self.k1}, 0, 0, 0, 0]}}\n"
        )


def resample(image, points):
    channels = [map_coordinates(channel, points[::-1], order=3, mode="nearest") for channel in np.moveaxis(image, 2, 0)]
    return np.clip(np.rint(np.stack(channels, 2)), 0, 255).astype(np.uint8)


def write_rig(folder, images, focal):
    folder.mkdir()
    names = NAMES[: len(images)]
    for name, image in zip(names, images):
        Image.fromarray(image.astype(np.uint8)).save(folder / f"{name}.png")
    listed = "\n".join(f'{name} = "{name}.png"' for name in names)
    (folder / "rig.toml").write_text(f"focal_px = {focal}\n[images]\n{listed}\n")
    return folder


def inside(points, shape, margin):
    (x, y), (height, width) = points, shape
    x_margin, y_margin = margin
    return (x >= x_margin) & (x < width - x_margin) & (y >= y_margin) & (y < height - y_margin)


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def measure(scenes, source, error, folder):
    """Bad1 in percent and AvgErr, as they are, injected, aligned and undone."""
    images, truth = scenes.load(source)
    shape, views = truth.shape, len(images) - 1
    camera = Camera(shape, scenes.focal, error.k1)
    pixels = np.stack(np.meshgrid(range(shape[1]), range(shape[0]))).astype(float)
    reach = max(abs(scenes.minimum), scenes.minimum + scenes.disparities) - 1
    margin = MARGIN + reach, MARGIN + (reach if views > 2 else 0)
    seen = inside(pixels, shape, margin)

    mount = Rotation.from_euler("xyz", error.mount, degrees=True).as_matrix()
    injected, undone = [], []
    for image, roll, scale in zip(images, (0, *error.rolls), (1, *error.scales)):
        turn = mount @ Rotation.from_euler("z", roll, degrees=True).as_matrix()
        to_ideal = camera.matrix() @ turn @ np.linalg.inv(camera.matrix(scale))
        from_ideal = np.linalg.inv(to_ideal)
        injected.append(resample(image, apply(to_ideal, camera.undistort(pixels))))
        undone.append(resample(injected[-1].astype(float), camera.distort(apply(from_ideal, pixels))))
        for shift in [(0, 0), (reach, 0), (-reach, 0), *([(0, reach), (0, -reach)] if views > 2 else [])]:
            moved = pixels + np.array(shift)[:, None, None]
            seen &= inside(camera.distort(apply(from_ideal, moved)), shape, (MARGIN, MARGIN))
    truth = np.where(seen, truth, np.nan)

    injected = write_rig(folder / "injected", injected, scenes.focal)
    lens = []
    if error.k1:
        camera.calibration(folder / "camera.yaml")
        lens = ["--lens", folder / "camera.yaml"]
    search = ["--min-disparity", scenes.minimum, "--num-disparities", scenes.disparities]

    def errors(truth, *arguments):
        run("match", "--method", "bm", *arguments, *search, "--fusion", scenes.fusion, "-o", folder / "disparity.pfm")
        error = np.abs(read_pfm(folder / "disparity.pfm") - truth)
        error = error[np.isfinite(error)]
        return 100 * np.mean(error > 1), np.mean(error)

    def truth_of(undistorted):
        """The truth of the pixels of a turned camera: that of the ideal pixels from which they came."""
        ideal = np.rint(apply(camera.matrix() @ mount @ np.linalg.inv(camera.matrix()), undistorted)).astype(int)
        x, y = (np.clip(ideal[axis], 0, shape[1 - axis] - 1) for axis in (0, 1))
        return np.where(inside(ideal, shape, (0, 0)), truth[y, x], np.nan)

    found = json.loads(run("align", injected, *lens, *search, "--json"))["center"] or {}
    rectified = apply(np.array(found.get("homography", np.eye(3))), pixels)
    return (
        errors(truth, write_rig(folder / "clean", images, scenes.focal)),
        errors(truth_of(camera.undistort(pixels)), injected),
        errors(truth_of(rectified), injected, *lens, "--align"),
        errors(truth, write_rig(folder / "undone", undone, scenes.focal)),
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--scenes", default="middlebury2006-third,middlebury2005-full,hci4d")
    parser.add_argument("--errors", default=",".join(ERRORS))
    arguments = parser.parse_args()
    print("| scenes | injected | clean | as injected | `--align` | undone |\n| --- | --- | --- | --- | --- | --- |")
    for data_set in arguments.scenes.split(","):
        scenes = DATA_SETS[data_set]
        for name in arguments.errors.split(","):
            rows = []
            for scene in scenes.names:
                with tempfile.TemporaryDirectory() as folder:
                    rows.append(measure(scenes, arguments.data / data_set / scene, ERRORS[name], pathlib.Path(folder)))
            cells = " | ".join(f"{bad:.2f} %, {average:.3f}" for bad, average in np.mean(rows, 0))
            print(f"| {data_set} | {name} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
