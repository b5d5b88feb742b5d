"""The program, and scenes that it makes."""

import os
import signal
import subprocess
from pathlib import Path

import multiscopic
import numpy as np
import pytest


@pytest.fixture(scope="session")
def program():
    """Runs the program, which the variable MULTISCOPIC_BINARY names. It ends with an exit code, 2 if it refuses its options."""
    path = os.environ["MULTISCOPIC_BINARY"]

    def run(*arguments, code=0):
        command = [path, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == code, f"{command}: {done.stderr}"

    return run


def scene(program, folder, views) -> Path:
    """A made-up scene in colour with so many neighbours and known disparities."""
    program("scene", "--random", "--seed", 7, "--size", "96x72", "--views", views, "-o", folder / "set")
    return folder / "set" / "0000"


@pytest.fixture(scope="session")
def rig(program, tmp_path_factory) -> Path:
    """A scene with four neighbours."""
    return scene(program, tmp_path_factory.mktemp("scenes"), 4)


@pytest.fixture(scope="session")
def small_rig(program, tmp_path_factory) -> Path:
    """A scene with two neighbours, which are rectified in half the time."""
    return scene(program, tmp_path_factory.mktemp("scenes"), 2)


@pytest.fixture(scope="session")
def sweep(program, tmp_path_factory) -> Path:
    """The frames of a simulated camera that slides over 12 mm."""
    folder = tmp_path_factory.mktemp("sweep") / "sweep"
    slide = "--camera sim --stage sim --sweep 12 --speed 12 --size 120x90 -o"
    program("capture", *slide.split(), folder)
    return folder


def images_of(rig) -> dict[str, np.ndarray]:
    """The images of a rig by their names."""
    names = ["center", "left", "right", "top", "bottom"]
    return {name: multiscopic.read_image(rig / f"{name}.png") for name in names if (rig / f"{name}.png").exists()}


@pytest.fixture(scope="session")
def images(rig) -> dict[str, np.ndarray]:
    """The images of the rig by their names."""
    return images_of(rig)


@pytest.fixture
def control_c():
    """Control-C as in a terminal: the background jobs of a shell ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def pixels_of_pfm(path) -> np.ndarray:
    """The numbers of a PFM file, by numpy alone."""
    with open(path, "rb") as file:
        assert file.readline() == b"Pf\n"
        width, height = map(int, file.readline().split())
        assert float(file.readline()) < 0, "little-endian"
        return np.fromfile(file, "<f4").reshape(height, width)[::-1]


def assert_same_bits(ours, program_map):
    """Both have the same numbers, and none where the other has none."""
    assert np.array_equal(np.isnan(ours), np.isinf(program_map))
    valid = np.isfinite(program_map)
    assert np.array_equal(ours[valid].view(np.uint32), program_map[valid].view(np.uint32))
