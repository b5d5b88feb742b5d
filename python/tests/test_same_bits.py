"""The package gives the bits of the program."""

import json
import shutil

import multiscopic
import numpy as np
import pytest
from conftest import assert_same_bits, images_of, pixels_of_pfm

RANGE = {"min_disparity": 0, "num_disparities": 16}

VARIANTS = [
    {},
    {"method": "bm", "fusion": "mean", "block_size": 7},
    {"method": "bm", "fusion": "half", "uniqueness_ratio": 15, "texture_threshold": 40},
    {"method": "bm", "disp12_max_diff": 1, "median": 5, "speckle_window_size": 60, "speckle_range": 2},
    {"method": "bm", "bilateral": (2.0, 1.5), "min_confidence": 0.5, "fill": "background"},
    {"method": "sgm"},
    {"method": "sgm", "cost": "census2", "census": "7x7", "p1": 5, "paths": 8, "fusion": "min"},
    {"method": "sgm", "cost": "sad", "block_size": 3, "p2": 40, "p2_edge": 20, "uniqueness_ratio": 5},
    {"method": "sgm", "sub_pixel": "lucas-kanade", "smooth": True},
    {"method": "gc", "sweeps": 2, "min_confidence": 0.6},
    {"method": "gc", "sweeps": 1, "occlusion_cost": "auto", "smoothness": "potts", "smooth": True, "gray": True},
    {"method": "net"},
    {"method": "net", "sub_pixel": "none", "repair": "none", "smooth": True},
    {"method": "sgm", "repair": "smooth", "min_confidence": 0.6},
    {"method": "sgm", "simd": "baseline", "max_memory": 100},
]


def words(options) -> list[str]:
    """The options of the program for keyword arguments."""
    words = []
    for keyword, value in options.items():
        option = "--" + keyword.replace("_", "-")
        value = ",".join(map(str, value)) if isinstance(value, tuple) else value
        match value:
            case True:
                words += [option]
            case False:
                words += [option.replace("--", "--no-")]
            case _:
                words += [f"{option}={value}"]
    return words


def files(rig, names) -> list:
    """The options of the program for images of a rig."""
    return [word for name in names for word in (f"--{name}", rig / f"{name}.png")]


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
    options = RANGE | options
    disparity, confidence = matched_by_program(program, tmp_path, files(rig, images), options)
    result = multiscopic.match(**images, **options)
    assert_same_bits(result.disparity, disparity)
    assert np.array_equal(result.confidence, confidence)
    assert np.isfinite(result.disparity).mean() > 0.2
    without = multiscopic.match(**images, **options, confidence=False, threads=1)
    assert without.confidence is None
    assert np.array_equal(without.disparity, result.disparity, equal_nan=True)


@pytest.mark.parametrize(
    "options",
    [
        {"occlusion_cost": 20.0, "lambda1": 5.0, "lambda2": 2.0, "theta": 20, "cutoff": 1, "seed": 3},
        {"occlusions": "unique", "keep_occluded": True, "refine": False},
        {"occlusions": "capped", "upsample": 2, "num_disparities": 8},
    ],
    ids=str,
)
def test_graph_cuts_without_confidences(program, tmp_path, rig, images, options):
    options = RANGE | {"method": "gc", "sweeps": 1} | options
    disparity = tmp_path / "disparity.pfm"
    program("match", *files(rig, ["center", "right"]), *words(options), "-o", disparity)
    result = multiscopic.match(images["center"], right=images["right"], **options, confidence=False)
    assert_same_bits(result.disparity, pixels_of_pfm(disparity))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sgm_p1": 2.0, "sgm_p2": 6.0, "sgm_q1": 3.0, "sgm_q2": 6.0, "sgm_v": 1.25, "sgm_d": 0.1}
        | {"cbca_intensity": 0.5, "cbca_distance": 5, "cbca_iterations_1": 1, "cbca_iterations_2": 2},
    ],
    ids=str,
)
def test_mc_cnn(program, tmp_path, images, options):
    options = {"method": "mccnn-fast", "num_disparities": 12} | options
    skip_without_weights(options["method"])
    cut = {name: np.ascontiguousarray(images[name][:40, :50]) for name in ["center", "right"]}
    for name, image in cut.items():
        multiscopic.write_png(tmp_path / f"{name}.png", image)
    disparity, confidence = matched_by_program(program, tmp_path, files(tmp_path, cut), options)
    result = multiscopic.match(**cut, **options)
    assert_same_bits(result.disparity, disparity)
    assert np.array_equal(result.confidence, confidence)


def test_prior(program, tmp_path, rig, images):
    raw, found, disparity = tmp_path / "prior.png", tmp_path / "prior.pfm", tmp_path / "disparity.pfm"
    program("match", rig, "--min-confidence", 0.5, *words(RANGE), "--raw16", raw, "-o", found)
    prior = pixels_of_pfm(found)
    assert np.isinf(prior).any()
    for options in [{}, {"prior_disparities": 3, "prior_median": 5, "sub_pixel": "lucas-kanade"}, {"prior_median": 0}]:
        program("match", rig, "--prior", raw, *words(options), "-o", disparity)
        result = multiscopic.Rig.load(rig).match(prior=prior, **options)
        assert result.confidence is None
        assert_same_bits(result.disparity, pixels_of_pfm(disparity))
        # They are rounded to the steps of the file.
        unrounded = np.where(np.isinf(prior), np.nan, prior + 0.004)
        assert_same_bits(multiscopic.match(**images, prior=unrounded, **options).disparity, pixels_of_pfm(disparity))


def test_several_baselines(program, tmp_path, images):
    # What is matched does not matter, only that it is the same.
    images = {"center": images["center"], "right": images["right"], "far": np.roll(images["right"], -6, axis=1)}
    for name, image in images.items():
        multiscopic.write_png(tmp_path / f"{name}.png", image)
    source = [*files(tmp_path, ["center", "right"]), "--view", f"2,0={tmp_path / 'far.png'}"]
    maps = []
    blocks = {"method": "bm"}
    for options in [{}, {"together": True}, blocks, blocks | {"prior_disparities": 4, "prior_median": 7}]:
        disparity, confidence = matched_by_program(program, tmp_path, source, RANGE | options)
        views = {(2, 0): images["far"]}
        result = multiscopic.match(images["center"], right=images["right"], views=views, **RANGE, **options)
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)
        maps.append(disparity)
    assert not np.array_equal(maps[0], maps[1]) and not np.array_equal(maps[2], maps[3])


@pytest.mark.parametrize("options", [{}, {"min_disparity": 1, "num_disparities": 9, "min_confidence": 0.8}], ids=str)
def test_sweep(program, tmp_path, sweep, options):
    disparity, confidence = matched_by_program(program, tmp_path, [sweep], options)
    slide = multiscopic.Rig.load(sweep)
    center, frames, offsets_mm = slide.sweep()
    # The order of the frames does not matter.
    mixed = [frames[::-1], offsets_mm[::-1]] if len(set(map(abs, offsets_mm))) == len(offsets_mm) else [frames, offsets_mm]
    of_arrays = multiscopic.match_sweep(center, *mixed, baseline_mm=slide.baseline_mm, **options)
    for result in [slide.match(**options), of_arrays]:
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)
    assert np.array_equal(of_arrays.depth(focal_px=slide.focal_px), slide.match(**options).depth(), equal_nan=True)


def with_12_bits(image):
    """An image of uint16 that needs all of 12 bits."""
    return image * np.uint16(16) + np.arange(image.size, dtype=np.uint16).reshape(image.shape) % 16


def test_sixteen_bits(program, tmp_path, small_rig):
    images = {name: with_12_bits(image) for name, image in images_of(small_rig).items()}
    assert 1023 < max(image.max() for image in images.values()) < 4096
    shutil.copy(small_rig / "rig.toml", tmp_path)
    for name, image in images.items():
        multiscopic.write_png(tmp_path / f"{name}.png", image)
    maps = []
    for options in [{}, {"bits": 12}, {"bits": 14}]:
        disparity, confidence = matched_by_program(program, tmp_path, [tmp_path], RANGE | options)
        for result in [multiscopic.match(**images, **RANGE, **options), multiscopic.Rig.load(tmp_path).match(**RANGE, **options)]:
            assert_same_bits(result.disparity, disparity)
            assert np.array_equal(result.confidence, confidence)
        maps.append(disparity)
    assert np.array_equal(maps[0], maps[1]) and not np.array_equal(maps[1], maps[2])
    program("match", tmp_path, "--bits", 10, "-o", tmp_path / "never.pfm", code=2)
    for match in [lambda: multiscopic.match(**images, bits=10), lambda: multiscopic.Rig.load(tmp_path).match(bits=10)]:
        with pytest.raises(ValueError, match="a sample of .* at most 1023, the maximum of 10 bits"):
            match()


@pytest.mark.parametrize(
    "options",
    [
        {"speckle_range": 2},
        {"auto_range": True, "num_disparities": 5},
        {"bits": 11},
        {"occlusions": "unique", "method": "gc"},
        {"upsample": 5},
        {"lambda2": -1.0},
        {"sgm_v": 0.0},
        {"cbca_intensity": -1.0},
        {"prior_median": 4},
        {"smoothness": "cubic"},
        {"cost": "ssd"},
        {"max_memory": 0},
        {"simd": "mmx"},
    ],
    ids=str,
)
def test_both_refuse(program, tmp_path, rig, images, options):
    program("match", rig, *words(options), "-o", tmp_path / "never.pfm", code=2)
    with pytest.raises(ValueError):
        multiscopic.match(**images, **options)


def test_defaults_are_those_of_the_program(program, tmp_path, rig, images):
    for names in [["center", "right"], ["center", "left", "right"], list(images)]:
        disparity, _ = matched_by_program(program, tmp_path, files(rig, names), {})
        assert_same_bits(multiscopic.match(**{name: images[name] for name in names}).disparity, disparity)


def test_rig(program, tmp_path, rig):
    for options in [{}, {"method": "sgm", "auto_range": True}]:
        disparity, confidence = matched_by_program(program, tmp_path, [rig], options)
        result = multiscopic.Rig.load(rig).match(**options)
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)


def test_rig_with_a_lens(program, tmp_path, small_rig):
    loaded = multiscopic.Rig.load(small_rig)
    text = (small_rig / "rig.toml").read_text()
    folder = shutil.copytree(small_rig, tmp_path / "rig")
    (folder / "rig.toml").write_text('lens = "camera.toml"\nmount_rotation_deg = [0.2, -0.3, 0.1]\n' + text)
    camera = f"focal_px = [{loaded.focal_px}, {loaded.focal_px}]\nprincipal_point = [46.0, 37.0]\n"
    (folder / "camera.toml").write_text(camera + 'model = "plumb_bob"\ncoefficients = [-0.2, 0.05, 0.0, 0.0, 0.0]\n')
    depth, sigma = tmp_path / "depth.pfm", tmp_path / "sigma.pfm"
    points, ours = tmp_path / "points.ply", tmp_path / "ours.ply"
    for options in [RANGE, RANGE | {"align": True}]:
        source = [folder, "--depth", depth, "--sigma", sigma, "--ply", points]
        disparity, confidence = matched_by_program(program, tmp_path, source, options)
        result = multiscopic.Rig.load(folder).match(**options)
        assert_same_bits(result.disparity, disparity)
        assert np.array_equal(result.confidence, confidence)
        assert_same_bits(result.depth(), pixels_of_pfm(depth))
        # The program writes millimetres.
        assert_same_bits(np.float32(1000) * result.sigma(), pixels_of_pfm(sigma))
        result.write_ply(ours)
        assert ours.read_bytes() == points.read_bytes()


def test_points_of_arrays(program, tmp_path, rig, images):
    points, ours = tmp_path / "points.ply", tmp_path / "ours.ply"
    camera = {"focal_px": 250.0, "baseline_mm": 12.5, "doffs": 1.0, "principal_point": (45.5, 36.0)}
    program("match", *files(rig, images), *words(RANGE | camera), "--ply", points, "--ply-ascii")
    result = multiscopic.match(**images, **RANGE, confidence=False)
    result.write_ply(ours, **camera, ascii=True)
    assert ours.read_bytes() == points.read_bytes()
    program("match", *files(rig, images), *words(RANGE), "--focal-px", 250, "--baseline-mm", 12.5, "--ply", points)
    result.write_ply(ours, focal_px=250, baseline_mm=12.5)
    assert ours.read_bytes() == points.read_bytes()


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
    program("evaluate", rig, "--methods", "sgm", "--views", 4, *words(RANGE), "--json", tmp_path / "metrics.json")
    (record,) = json.loads((tmp_path / "metrics.json").read_text())
    result = multiscopic.Rig.load(rig).match(method="sgm", **RANGE)
    metrics = multiscopic.evaluate(result.disparity, multiscopic.read_pfm(rig / "truth.pfm"), result.confidence)
    errors = ["rms", "avg_err", "bad_0_5", "bad_1", "bad_2", "coverage"]
    assert {name: metrics[name] for name in errors} == {name: record[name] for name in errors}
    assert 0 <= metrics["auc_optimal"] <= metrics["auc"] <= 1 and metrics["roc_auc"] > 0.5


def test_align(program, tmp_path, small_rig):
    images = images_of(small_rig)
    disparity, _ = matched_by_program(program, tmp_path, files(small_rig, images), RANGE | {"align": True})
    assert_same_bits(multiscopic.match(**images, **RANGE, align=True).disparity, disparity)


def test_align_sixteen_bits(program, tmp_path, small_rig):
    images = {name: with_12_bits(image) for name, image in images_of(small_rig).items()}
    folder = shutil.copytree(small_rig, tmp_path / "rig")
    for name, image in images.items():
        multiscopic.write_png(folder / f"{name}.png", image)
    program("align", folder, "-o", tmp_path / "aligned", "--bits", 12)
    rectified = multiscopic.Rig.load(tmp_path / "aligned").frames()
    focal_px = multiscopic.Rig.load(folder).focal_px
    aligned = multiscopic.align(**images, focal_px=focal_px, bits=12)
    assert aligned.keys() == rectified.keys()
    for offset, image in aligned.items():
        assert image.dtype == np.uint16 and np.any(image % 257)
        assert np.array_equal((image.astype(np.uint32) + 128) // 257, rectified[offset])
