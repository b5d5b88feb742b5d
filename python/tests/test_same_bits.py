"""The package gives the bits of the program."""

import json

import multiscopic
import numpy as np
import pytest
from conftest import assert_same_bits, pixels_of_pfm

RANGE = {"min_disparity": 0, "num_disparities": 40}

VARIANTS = [
    {},
    {"fusion": "mean", "block_size": 7},
    {"fusion": "half", "uniqueness_ratio": 15, "texture_threshold": 40},
    {"disp12_max_diff": 1, "median": 5, "speckle_window_size": 60, "speckle_range": 2},
    {"bilateral": (2.0, 1.5), "min_confidence": 0.5, "fill": "background"},
    {"method": "sgm"},
    {"method": "sgm", "cost": "census2", "census": "7x7", "p1": 5, "paths": 8, "fusion": "min"},
    {"method": "sgm", "cost": "sad", "block_size": 3, "p2": 40, "p2_edge": 20, "uniqueness_ratio": 5},
    {"method": "sgm", "sub_pixel": "lucas-kanade", "smooth": True},
    {"method": "gc", "sweeps": 2, "min_confidence": 0.6},
    {"method": "gc", "sweeps": 1, "occlusion_cost": "auto", "smoothness": "potts", "smooth": True},
    {"method": "gc", "sweeps": 1, "occlusion_cost": 20.0, "lambda1": 5.0, "lambda2": 2.0, "seed": 3, "fusion": "mean"},
    {"method": "mccnn-fast"},
    {"method": "net"},
    {"method": "net", "sub_pixel": "none", "smooth": True},
    {"method": "net", "repair": "none"},
    {"method": "sgm", "repair": "smooth", "min_confidence": 0.6},
]


def words(options) -> list[str]:
    """The options of the program for keyword arguments."""
    words = []
    for keyword, value in options.items():
        option = "--" + keyword.replace("_", "-")
        value = ",".join(map(str, value)) if isinstance(value, tuple) else value
        words += [option] if value is True else [option, str(value)]
    return words


def matched_by_program(program, tmp_path, source, options):
    """The disparities and the confidences that the program finds."""
    disparity, confidence = tmp_path / "disparity.pfm", tmp_path / "confidence.png"
    program("match", *source, *words(options), "-o", disparity, "--confidence", confidence)
    return pixels_of_pfm(disparity), multiscopic.read_image(confidence)


def skip_without_weights(method):
    """The weights of MC-CNN are not part of the program."""
    try:
        multiscopic.match(np.zeros((20, 20), np.uint8), right=np.zeros((20, 20), np.uint8), method=method, num_disparities=2)
    except (OSError, ValueError) as error:
        pytest.skip(str(error).splitlines()[0])


@pytest.mark.parametrize("options", VARIANTS, ids=str)
def test_match(program, tmp_path, rig, images, options):
    if options.get("method", "").startswith("mccnn"):
        skip_without_weights(options["method"])
    options = RANGE | options
    source = [word for name in images for word in (f"--{name}", rig / f"{name}.png")]
    disparity, confidence = matched_by_program(program, tmp_path, source, options)
    result = multiscopic.match(**images, **options)
    assert_same_bits(result.disparity, disparity)
    assert np.array_equal(result.confidence, confidence)
    assert np.isfinite(result.disparity).mean() > 0.2
    without = multiscopic.match(**images, **options, confidence=False, threads=1)
    assert without.confidence is None
    assert np.array_equal(without.disparity, result.disparity, equal_nan=True)


def test_defaults_are_those_of_the_program(program, tmp_path, rig, images):
    for names in [["center", "right"], ["center", "left", "right"], list(images)]:
        source = [word for name in names for word in (f"--{name}", rig / f"{name}.png")]
        disparity, _ = matched_by_program(program, tmp_path, source, {})
        assert_same_bits(multiscopic.match(**{name: images[name] for name in names}).disparity, disparity)


def test_rig(program, tmp_path, rig):
    for options in [{}, {"method": "sgm", "auto_range": True}, {"align": True, "num_disparities": 40}]:
        disparity, confidence = matched_by_program(program, tmp_path, [rig], options)
        result = multiscopic.Rig.load(rig).match(**options)
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)


def test_rig_with_a_lens(program, tmp_path, rig):
    loaded = multiscopic.Rig.load(rig)
    text = (rig / "rig.toml").read_text()
    folder = tmp_path / "rig"
    folder.mkdir()
    for image in rig.glob("*.png"):
        (folder / image.name).write_bytes(image.read_bytes())
    (folder / "rig.toml").write_text('lens = "camera.toml"\nmount_rotation_deg = [0.2, -0.3, 0.1]\n' + text)
    camera = f"focal_px = [{loaded.focal_px}, {loaded.focal_px}]\nprincipal_point = [80.0, 60.0]\n"
    (folder / "camera.toml").write_text(camera + 'model = "plumb_bob"\ncoefficients = [-0.2, 0.05, 0.0, 0.0, 0.0]\n')
    depth = tmp_path / "depth.pfm"
    for options in [RANGE, RANGE | {"align": True}]:
        disparity, confidence = matched_by_program(program, tmp_path, [folder, "--depth", depth], options)
        result = multiscopic.Rig.load(folder).match(**options)
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)
        assert_same_bits(result.depth(), pixels_of_pfm(depth))


def test_depth(program, tmp_path, rig):
    depth = tmp_path / "depth.pfm"
    program("match", rig, "-o", tmp_path / "disparity.pfm", "--depth", depth, "--doffs", "0.5")
    loaded = multiscopic.Rig.load(rig)
    result = loaded.match()
    assert_same_bits(result.depth(doffs=0.5), pixels_of_pfm(depth))
    given = result.depth(focal_px=loaded.focal_px, baseline_mm=loaded.baseline_mm, doffs=0.5)
    assert_same_bits(given, pixels_of_pfm(depth))


def test_corners_of_an_array(program, tmp_path, images, rig):
    views = {(1, -1): images["right"], (-1, 1): images["left"]}
    source = ["--center", rig / "center.png", "--top", rig / "top.png"]
    source += ["--view", f"1,-1={rig / 'right.png'}", "--view", f"-1,1={rig / 'left.png'}"]
    disparity, _ = matched_by_program(program, tmp_path, source, RANGE)
    result = multiscopic.match(images["center"], top=images["top"], views=views, **RANGE)
    assert_same_bits(result.disparity, disparity)


def test_evaluate(program, tmp_path, rig):
    program("evaluate", rig, "--methods", "sgm", "--views", 4, "--json", tmp_path / "metrics.json")
    (record,) = json.loads((tmp_path / "metrics.json").read_text())
    result = multiscopic.Rig.load(rig).match(method="sgm")
    metrics = multiscopic.evaluate(result.disparity, multiscopic.read_pfm(rig / "truth.pfm"), result.confidence)
    errors = ["rms", "avg_err", "bad_0_5", "bad_1", "bad_2", "coverage"]
    assert {name: metrics[name] for name in errors} == {name: record[name] for name in errors}
    assert 0 <= metrics["auc_optimal"] <= metrics["auc"] <= 1 and metrics["roc_auc"] > 0.5


def test_align(program, tmp_path, rig, images):
    program("align", rig, "-o", tmp_path / "aligned")
    rectified = multiscopic.Rig.load(tmp_path / "aligned").frames()
    focal_px = multiscopic.Rig.load(rig).focal_px
    for offset, image in multiscopic.align(**images, focal_px=focal_px).items():
        assert np.array_equal(image, rectified[offset])
