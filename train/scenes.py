"""Makes scenes with the program, and the features of them.

Each set is rendered once (`multiscopic scene --random`). Each of its uses is the network's view of some of the scenes: by some of
the neighbours and in a range of disparities (`multiscopic match --features`). Scenes and features that are there are kept, so that
a run that was stopped goes on.

Scenes in the field are noisy, as seen by a small camera; those in the studio are clean, and have large plain areas. Sets that are
`halved` are rendered at twice the size: their images have less noise and finer details, like photographs at a part of their size.
"""

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image


@dataclass(frozen=True)
class Use:
    name: str
    views: tuple
    least: int
    count: int
    scenes: range


@dataclass(frozen=True)
class SceneSet:
    name: str
    seed: int
    count: int
    views: int
    size: str
    uses: tuple
    halved: bool = False
    setting: str = "field"
    # Kinds of objects, by turns; any if there are none.
    objects: str = ""


STEREO, TWO, FOUR = ("right",), ("left", "right"), ("left", "right", "top", "bottom")
EIGHT = (*FOUR, "-1,-1", "1,-1", "-1,1", "1,1")
HARD = "slits,shiny,thin,slits,repeating,blank"

HELD_BACK = [
    SceneSet(
        "held", 91, 48, 4, "256x192",
        (Use("two", TWO, 1, 32, range(48)), Use("stereo", STEREO, 1, 32, range(0, 48, 3)), Use("four", FOUR, 1, 32, range(1, 48, 3))),
    ),
    SceneSet("held_fine", 92, 24, 2, "512x384", (Use("fine", TWO, 1, 32, range(24)),), halved=True),
    SceneSet("held_studio", 93, 32, 2, "256x192", (Use("studio", TWO, 1, 32, range(32)),), setting="studio"),
    SceneSet(
        "held_eight", 94, 32, 8, "256x192",
        (Use("eight", EIGHT, 1, 32, range(32)), Use("four_of_eight", FOUR, 1, 32, range(32))), setting="studio",
    ),
    SceneSet(
        "held_hard", 95, 32, 8, "256x192",
        (Use("hard_8", EIGHT, 1, 32, range(32)), Use("hard_4", FOUR, 1, 32, range(32)), Use("hard_2", TWO, 1, 32, range(0, 32, 2))),
        objects=HARD,
    ),
]  # fmt: skip
TRAINING = [
    SceneSet(
        "eight", 21, 300, 8, "256x192",
        (Use("eight", EIGHT, 1, 32, range(300)), Use("four", FOUR, 1, 32, range(0, 300, 2))),
    ),
    SceneSet(
        "eight_studio", 22, 400, 8, "256x192",
        (
            Use("eight", EIGHT, 1, 32, range(400)), Use("four", FOUR, 1, 32, range(0, 400, 2)),
            Use("two", TWO, 1, 32, range(1, 400, 2)),
        ), setting="studio",
    ),
    SceneSet(
        "hard", 23, 400, 8, "256x192",
        (
            Use("eight", EIGHT, 1, 32, range(0, 400, 2)), Use("four", FOUR, 1, 32, range(1, 400, 2)),
            Use("two", TWO, 1, 32, range(400)), Use("stereo", STEREO, 1, 32, range(0, 400, 2)),
        ), setting="studio", objects=HARD,
    ),
    SceneSet(
        "hard_field", 24, 200, 8, "256x192",
        (Use("eight", EIGHT, 1, 32, range(200)), Use("two", TWO, 1, 32, range(200)), Use("four", FOUR, 1, 32, range(0, 200, 2))),
        objects=HARD,
    ),
    SceneSet("two_a", 12, 300, 2, "256x192", (Use("two", TWO, 1, 32, range(300)), Use("stereo", STEREO, 1, 32, range(100)))),
    SceneSet(
        "four", 11, 200, 4, "256x192",
        (Use("four", FOUR, 1, 32, range(200)), Use("two", TWO, 1, 32, range(200)), Use("stereo", STEREO, 0, 48, range(0, 200, 4))),
    ),
    SceneSet(
        "two_b", 14, 400, 2, "256x192",
        (Use("two", TWO, 1, 32, range(400)), Use("stereo", STEREO, 1, 32, range(0, 400, 2)), Use("wide", TWO, 0, 64, range(1, 400, 8))),
    ),
    SceneSet(
        "fine", 15, 200, 2, "512x384",
        (Use("two", TWO, 1, 32, range(200)), Use("stereo", STEREO, 1, 32, range(0, 200, 3))), halved=True,
    ),
    SceneSet("large", 13, 100, 2, "384x288", (Use("two", TWO, 1, 48, range(100)),)),
    SceneSet(
        "studio", 16, 600, 2, "256x192",
        (Use("two", TWO, 1, 32, range(600)), Use("stereo", STEREO, 1, 32, range(0, 600, 2))), setting="studio",
    ),
    SceneSet(
        "studio_four", 17, 200, 4, "256x192",
        (Use("four", FOUR, 1, 32, range(0, 200, 2)), Use("two", TWO, 1, 32, range(200))), setting="studio",
    ),
    SceneSet(
        "studio_fine", 18, 400, 2, "512x384",
        (Use("two", TWO, 1, 32, range(400)), Use("stereo", STEREO, 1, 32, range(0, 400, 2))), halved=True, setting="studio",
    ),
]  # fmt: skip


def read_pfm(path):
    """An image of one channel of floats, whose rows are bottom-up in the file."""
    with open(path, "rb") as file:
        kind, size, scale = file.readline(), file.readline().split(), float(file.readline())
        assert kind.strip() == b"Pf", path
        pixels = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4")
    return pixels.reshape(int(size[1]), int(size[0]))[::-1].astype(np.float32)


def write_pfm(path, image):
    with open(path, "wb") as file:
        file.write(b"Pf\n%d %d\n-1.0\n" % image.shape[::-1])
        file.write(image[::-1].astype("<f4").tobytes())


def render(program, folder, scenes):
    target = folder / scenes.name
    if all((target / f"{number:04}").exists() for number in range(scenes.count)):
        return
    rendered = target.with_suffix(".new")
    for unfinished in (target, rendered):
        shutil.rmtree(unfinished, ignore_errors=True)
    options = ["--setting", scenes.setting, "--seed", scenes.seed, "--count", scenes.count, "--views", scenes.views]
    if scenes.objects:
        options += ["--objects", scenes.objects]
    command = [program, "scene", "--random", *options, "--size", scenes.size, "-o", rendered]
    subprocess.run([*map(str, command)], check=True)
    if scenes.halved:
        for scene in rendered.iterdir():
            halve(scene)
    rendered.rename(target)


def halve(scene):
    """Halves the images and the disparities of a scene."""
    for path in scene.glob("*.png"):
        image = blocks_of_two(np.asarray(Image.open(path)))
        Image.fromarray(image.mean(2).round().astype(np.uint8)).save(path)
    four = np.sort(blocks_of_two(read_pfm(scene / "truth.pfm")), 2)
    # Where surfaces meet, a pixel belongs to one of them.
    is_edge = four[:, :, 3] - four[:, :, 0] > 1.5
    write_pfm(scene / "truth.pfm", np.where(is_edge, four[:, :, 2], four.mean(2)) / 2)


def blocks_of_two(image):
    """The four pixels of each block of 2 x 2: height/2 x width/2 x 4 x channels."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    blocks = image.reshape(h, 2, w, 2, *image.shape[2:]).swapaxes(1, 2)
    return blocks.reshape(h, w, 4, *image.shape[2:])


def features(program, folder, scenes, use, number):
    """The folder with what the network sees of a scene; it is made if it is not there."""
    target = folder / "features" / f"{scenes.name}-{use.name}" / f"{number:04}"
    if target.exists():
        return target
    scene = folder / scenes.name / f"{number:04}"
    target.parent.mkdir(parents=True, exist_ok=True)
    option = lambda frame, path: (f"--{frame}", path) if frame.isalpha() else ("--view", f"{frame}={path}")
    images = [word for frame in ("center", *use.views) for word in option(frame, scene / f"{frame}.png")]
    search = ["--min-disparity", use.least, "--num-disparities", use.count, "--method", "sgm", "--threads", 1]
    command = [program, "match", *images, *search, "--features", target, "-o", "/dev/null"]
    subprocess.run([*map(str, command)], check=True, stderr=subprocess.DEVNULL)
    return target


def all_features(program, folder, sets, threads=2):
    """The features of all scenes of `sets`, as (scene set, use, scene number, folder)."""
    jobs = [(scenes, use, number) for scenes in sets for use in scenes.uses for number in use.scenes]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda job: (*job, features(program, folder, *job)), jobs))


def make(program, folder, threads=2):
    """Everything to train with: two lists of features, for training and for selection."""
    program, folder = str(program), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for scenes in [*HELD_BACK, *TRAINING]:
        render(program, folder, scenes)
    return all_features(program, folder, TRAINING, threads), all_features(program, folder, HELD_BACK, threads)
