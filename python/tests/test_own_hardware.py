"""Captures by stages and cameras that are Python's objects."""

import _thread
import runpy
import threading
import time

import multiscopic
import numpy as np
import pytest
import tomllib
from test_package import PACKAGE

#: Pixels for each millimetre of the camera.
PX_PER_MM = 0.4
WALL = np.random.default_rng(3).integers(0, 256, (160, 200, 3), dtype=np.uint8)


class Slide:
    """A stage that tells where it was sent, and fails at one of its moves."""

    def __init__(self, failing_move=None):
        self.places, self.stops, self.failing_move, self.failure = [], 0, failing_move, None

    def move_to(self, right_mm, down_mm):
        if len(self.places) == self.failing_move:
            self.failure = ConnectionError("the slide is gone")
            raise self.failure
        self.places.append((right_mm, down_mm))

    def stop(self):
        self.stops += 1


class CountingSlide(Slide):
    """It goes one percent too far, and counts it."""

    def position(self):
        return 1.01 * self.places[-1][0], 1.01 * self.places[-1][1]


class Arm(Slide):
    """Its tool looks down from 700 mm."""

    def pose(self):
        right, down = self.places[-1]
        return 400 + right, -200 - down, 700, 180, 0, 0


class Eye:
    """A camera before a wall, which fails at one of its pictures."""

    def __init__(self, slide, failing_picture=None, image=WALL):
        self.slide, self.failing_picture, self.image = slide, failing_picture, image
        self.taken, self.failure = 0, None

    def grab(self):
        if self.taken == self.failing_picture:
            self.failure = TimeoutError("no picture")
            raise self.failure
        self.taken += 1
        right, down = (round(PX_PER_MM * mm) for mm in self.slide.places[-1])
        return self.image[30 + down : 90 + down, 50 + right : 130 + right]


def capture(slide, eye, folder, **options):
    return multiscopic.capture(slide, eye, folder, **{"baseline_mm": 20, "focal_px": 200, "settle": 0} | options)


def test_a_capture_is_that_of_the_program(program, tmp_path):
    slide = Slide()
    rig = capture(slide, Eye(slide), tmp_path / "ours")
    assert rig.path == tmp_path / "ours" and rig.views == [(-1, 0), (1, 0), (0, -1), (0, 1)]
    assert sorted(slide.places) == sorted([(0, 0), (-20, 0), (20, 0), (0, -20), (0, 20), (0, 0)])
    # The centre comes first, and the stage is back there in the end.
    assert slide.places[0] == slide.places[-1] == (0, 0)
    assert np.array_equal(rig.frames()[0, 0], WALL[30:90, 50:130])
    assert np.array_equal(rig.frames()[1, 0], WALL[30:90, 58:138]), "8 pixels, and in colour"
    result = rig.match(method="bm", num_disparities=16)
    inner = result.disparity[16:-16, 16:-16]
    assert np.mean(inner == 8) > 0.99
    assert np.nanmedian(result.depth()) == pytest.approx(200 * 0.02 / 8)

    # The files are those of the program, and say the same.
    simulated = "--camera sim --stage sim --size 64x48 --settle 0 --speed 250 --acceleration 1200".split()
    program("capture", *simulated, "--baseline", 20, "-o", tmp_path / "its")
    names = [{file.name for file in (tmp_path / folder).iterdir()} for folder in ["ours", "its"]]
    assert names[0] == names[1] - {"truth.pfm"}
    ours, its = (tomllib.loads((tmp_path / folder / "rig.toml").read_text()) for folder in ["ours", "its"])
    assert ours.keys() == its.keys() and ours["images"] == its["images"]
    assert ours["capture"].keys() == its["capture"].keys() and ours["poses"].keys() == its["poses"].keys()
    assert all(pose["asked_mm"] == its["poses"][name]["asked_mm"] for name, pose in ours["poses"].items())
    assert ours["capture"]["stage"] == "python:test_own_hardware.Slide"
    steps = [
        [line.split("  ")[-1] for line in (tmp_path / folder / "capture.log").read_text().splitlines() if " s  " in line]
        for folder in ["ours", "its"]
    ]
    assert steps[0] == steps[1] and "captured the left frame" in steps[0]


def test_what_is_measured_counts(tmp_path):
    slide = CountingSlide()
    rig = capture(slide, Eye(slide), tmp_path / "rig", layout="1x3", tolerance_um=250)
    assert rig.baseline_mm == pytest.approx(20.2)
    written = tomllib.loads((tmp_path / "rig" / "rig.toml").read_text())
    assert written["poses"]["right"]["counted_mm"] == [20.2, 0]
    with pytest.raises(RuntimeError, match=r"the stage measures to be at \(-?20200, 0\) um"):
        capture(slide, Eye(slide), tmp_path / "other")

    (tmp_path / "hand_eye.toml").write_text("translation_mm = [50.0, 0.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.0]\n")
    arm = Arm()
    rig = capture(arm, Eye(arm), tmp_path / "arm", hand_eye=tmp_path / "hand_eye.toml")
    x, y, z = np.nanmedian(rig.match(method="bm", num_disparities=16).points(frame="base"), axis=(0, 1))
    assert [x, y, z] == pytest.approx([0.45, -0.2, 0.7 - 0.5], abs=0.005)


def test_pictures_of_12_bits(tmp_path):
    slide = Slide()
    deep = WALL.astype(np.uint16) * 16
    rig = capture(slide, Eye(slide, image=deep), tmp_path / "rig", views=1, bits=12)
    assert np.abs(rig.frames()[0, 0].astype(int) - WALL[30:90, 50:130]).max() <= 1
    with pytest.raises(ValueError, match=r"what camera.grab\(\) returned has a sample of \d+, it must be at most 1023"):
        capture(slide, Eye(slide, image=deep), tmp_path / "other", views=1, bits=10)


def test_what_the_objects_raise_is_raised(tmp_path):
    slide = Slide()
    eye = Eye(slide, failing_picture=2)
    with pytest.raises(TimeoutError) as raised:
        capture(slide, eye, tmp_path / "rig")
    assert raised.value is eye.failure and eye.taken == 2
    assert slide.places[-1] == (0, 0) and slide.places[-2] != (0, 0), "it was brought back"

    slide = Slide(failing_move=2)
    with pytest.raises(ConnectionError) as raised:
        capture(slide, Eye(slide), tmp_path / "rig")
    assert raised.value is slide.failure
    assert len(slide.places) == 2 and slide.stops >= 1, "it moves no more"
    assert list(tmp_path.iterdir()) == [], "nothing is left"

    # All pictures are there, but the stage does not come back.
    slide = Slide(failing_move=5)
    with pytest.raises(ConnectionError) as raised:
        capture(slide, Eye(slide), tmp_path / "rig")
    assert raised.value is slide.failure
    assert len(multiscopic.Rig.load(tmp_path / "rig").frames()) == 5
    assert "the slide is gone" in (tmp_path / "rig" / "capture.log").read_text()


@pytest.mark.usefixtures("control_c")
def test_control_c_brings_the_stage_back(tmp_path):
    slide = Slide()
    threading.Timer(0.3, _thread.interrupt_main).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        capture(slide, Eye(slide), tmp_path / "rig", settle=30)
    assert time.monotonic() - start < 10
    assert slide.places == [(0, 0), (0, 0)] and list(tmp_path.iterdir()) == []


def test_refused_objects_and_arguments(tmp_path):
    class Still:
        pass

    class Sideways:
        def move_to(self, right_mm):
            pass

    class Numb:
        move_to = 5

    class Lost(Slide):
        def position(self):
            return "left"

    class Wild(Slide):
        def position(self):
            return float("nan"), 0

    class Blind:
        def grab(self):
            return None

    class Zoom(Eye):
        def grab(self):
            return super().grab()[self.taken :]

    class Slow:
        def grab(self, seconds):
            pass

    slide, folder = Slide(), tmp_path / "rig"
    eye = Eye(slide)
    for error, message, stage, camera, options in [
        (TypeError, r"the stage is of <class .*Still'>, which has no method move_to\(right_mm, down_mm\)", Still(), eye, {}),
        (TypeError, r"move_to of .*Sideways'> must be a method move_to\(right_mm, down_mm\): too many", Sideways(), eye, {}),
        (TypeError, "move_to of .*: found 5", Numb(), eye, {}),
        (TypeError, "move_to of .*: missing a required argument: 'down_mm'", Slide, eye, {}),
        (TypeError, r"the camera is of .*Slide'>, which has no method grab\(\)", slide, slide, {}),
        (TypeError, "grab of .*: missing a required argument: 'seconds'", slide, Slow(), {}),
        (TypeError, "what camera.grab.. returned: an image is an array of uint8 or uint16, not .*NoneType", slide, Blind(), {}),
        (ValueError, "has 80x5. pixels, its first picture had 80x59", slide, Zoom(slide), {}),
        (ValueError, "what camera.grab.. returned has the shape", slide, Eye(slide, image=WALL[..., :2]), {}),
        (TypeError, r"stage.position\(\) returned left, it must return \(right_mm, down_mm\) or None", Lost(), eye, {}),
        (ValueError, r"stage.position\(\) returned \(nan, 0\)", Wild(), eye, {}),
        (ValueError, "baseline_mm is 0 mm, it must be from 0.001 to 1000", slide, eye, {"baseline_mm": 0}),
        (ValueError, "focal_px is -1", slide, eye, {"focal_px": -1}),
        (ValueError, "settle is -1 s", slide, eye, {"settle": -1}),
        (ValueError, "views is 5, it must be from 1 to 4, or 8", slide, eye, {"views": 5}),
        (ValueError, "views cannot be used with layout", slide, eye, {"views": 4, "layout": "cross"}),
        (ValueError, "the layout 2x2", slide, eye, {"layout": "2x2"}),
        (FileNotFoundError, "hand_eye.toml", slide, eye, {"hand_eye": tmp_path / "hand_eye.toml"}),
        (FileExistsError, "is there already", slide, eye, {"path": PACKAGE}),
    ]:
        if isinstance(stage, Slide) and isinstance(camera, Eye):
            camera.slide = stage
        with pytest.raises(error, match=message):
            capture(stage, camera, options.pop("path", folder), **options)
    assert not folder.exists()


def test_example(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["own_hardware.py", str(tmp_path / "rig")])
    runpy.run_path(str(PACKAGE / "examples" / "own_hardware.py"), run_name="__main__")
    assert "5 pictures, the wall is 500 mm away" in capsys.readouterr().out
