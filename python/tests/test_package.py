"""What the package takes and refuses, its documentation, and the notebook."""

import _thread
import ast
import doctest
import inspect
import sys
import threading
import time
import types
import warnings
from importlib import resources
from pathlib import Path

import multiscopic
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

PACKAGE = Path(__file__).parents[1]
NOISE = np.random.default_rng(1).integers(0, 256, (60, 80, 3), dtype=np.uint8)
GRAY = np.ascontiguousarray(NOISE[..., 0])
LARGE = np.kron(GRAY, np.ones((2, 2), np.uint8))


def moved(image, columns):
    """The right view of a plane at this disparity."""
    return np.roll(image, -columns, axis=1)


def test_documentation():
    # Functions belong to the compiled module within the package.
    outcomes = [doctest.testmod(module) for module in [multiscopic, multiscopic.multiscopic]]
    assert sum(outcome.failed for outcome in outcomes) == 0
    assert sum(outcome.attempted for outcome in outcomes) >= 20


def test_stubs_and_signature_name_the_same_options():
    stubs = ast.parse((PACKAGE / "multiscopic.pyi").read_text())
    classes = {node.name: node for node in stubs.body if isinstance(node, ast.ClassDef)}
    options = [field.target.id for field in classes["_Options"].body if isinstance(field, ast.AnnAssign)]
    keywords = [
        name for name, parameter in inspect.signature(multiscopic.match).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name != "views"
    ]
    assert keywords == options
    # Each may be given, as its default.
    defaults = {name: inspect.signature(multiscopic.match).parameters[name].default for name in options}
    center, right = GRAY[:30, :40], moved(GRAY, 5)[:30, :40]
    for method in ["bm", "sgm", "gc"]:
        with_defaults = multiscopic.match(center, right=right, **defaults | {"method": method})
        without = multiscopic.match(center, right=right, method=method)
        assert np.array_equal(with_defaults.disparity, without.disparity, equal_nan=True)
    functions = {node.name for node in stubs.body if isinstance(node, ast.FunctionDef)}
    public = {name for name in dir(multiscopic) if not name.startswith("_") and name != "multiscopic"}
    assert public == functions | {name for name in classes if not name.startswith("_")}
    for name in ["Result", "Rig"]:
        stubbed = {node.name for node in classes[name].body if isinstance(node, ast.FunctionDef)}
        assert {member for member in dir(getattr(multiscopic, name)) if not member.startswith("_")} == stubbed


def test_the_package_is_typed():
    installed = resources.files(multiscopic)
    assert (installed / "py.typed").is_file() and (installed / "__init__.pyi").is_file()


@pytest.mark.parametrize("layout", [np.asfortranarray, lambda image: np.repeat(image, 2, axis=1)[:, ::2]])
def test_any_order_of_memory(layout):
    expected = multiscopic.match(NOISE, right=moved(NOISE, 5), method="gc", sweeps=1)
    result = multiscopic.match(layout(NOISE), right=layout(moved(NOISE, 5)), method="gc", sweeps=1)
    assert np.array_equal(result.disparity, expected.disparity, equal_nan=True)


def test_colours_become_grey_as_the_program_makes_them():
    red, green, blue = np.moveaxis(NOISE.astype(np.uint32), 2, 0)
    gray = ((77 * red + 150 * green + 29 * blue + 128) >> 8).astype(np.uint8)
    of_colours = multiscopic.match(NOISE, left=moved(NOISE, -5), method="bm")
    assert np.array_equal(of_colours.disparity, multiscopic.match(gray, left=moved(gray, -5), method="bm").disparity, equal_nan=True)
    assert np.nanmedian(of_colours.disparity) == 5


def test_refused_arguments():
    for error, message, arguments, options in [
        (ValueError, "there is no neighbour to match", [GRAY], {}),
        (ValueError, "the left view has 79x60 pixels, the centre has 80x60", [GRAY, GRAY[:, 1:]], {}),
        (ValueError, "center has the shape", [NOISE[..., :2], NOISE], {}),
        (ValueError, "two images of the left view", [GRAY, GRAY], {"views": {(-1, 0): GRAY}}),
        (ValueError, "the offset", [GRAY, GRAY], {"views": {(0, 0): GRAY}}),
        (TypeError, "array of uint8 or uint16, not float32", [GRAY.astype(np.float32), GRAY], {}),
        (TypeError, "array of uint8 or uint16, not <class 'list'>", [GRAY.tolist(), GRAY], {}),
        (ValueError, "the left view has a sample of 1024, it must be at most 1023", [GRAY, np.full_like(GRAY, 1024, np.uint16)],
         {"bits": 10}),
        (ValueError, "bits is 11, it must be one of 10, 12, 14, 16", [GRAY, GRAY], {"bits": 11}),
        (ValueError, "bits is 300", [GRAY, GRAY], {"bits": 300}),
        (TypeError, "no keyword argument blocksize", [GRAY, GRAY], {"blocksize": 5}),
        (TypeError, "median is wide", [GRAY, GRAY], {"median": "wide"}),
        (ValueError, "method is sift, it must be one of bm, gc", [GRAY, GRAY], {"method": "sift"}),
        (ValueError, "block_size is 300", [GRAY, GRAY], {"block_size": 300}),
        (ValueError, "block size", [GRAY, GRAY], {"method": "bm", "block_size": 8}),
        (ValueError, "block_size has no effect on net", [GRAY, GRAY], {"method": "net", "block_size": 7}),
        (ValueError, "min_confidence is 1.5", [GRAY, GRAY], {"min_confidence": 1.5}),
        (ValueError, "uniqueness_ratio is 101", [GRAY, GRAY], {"uniqueness_ratio": 101}),
        (ValueError, "occlusion_cost is -1", [GRAY, GRAY], {"method": "gc", "occlusion_cost": -1}),
        (ValueError, "need matching costs", [GRAY, GRAY], {"method": "gc", "disp12_max_diff": 1}),
        (ValueError, "auto_range cannot be used with num_disparities", [GRAY, GRAY], {"auto_range": True, "num_disparities": 5}),
        (ValueError, "theta is 300", [GRAY, GRAY], {"theta": 300}),
        (ValueError, "upsample is 5, it must be one of 1, 2, 3, 4", [GRAY, GRAY], {"upsample": 5}),
        (ValueError, "sgm_q1 is 0, it must be a number above 0", [GRAY, GRAY], {"sgm_q1": 0}),
        (ValueError, "prior cannot be used with method", [GRAY, GRAY], {"prior": GRAY, "method": "sgm"}),
        (ValueError, "prior cannot be used with together", [GRAY, GRAY], {"prior": GRAY, "together": True}),
        (ValueError, "prior cannot be used with confidence", [GRAY, GRAY], {"prior": GRAY, "confidence": True}),
        (ValueError, "the prior has 79x60 pixels, the frames have 80x60", [GRAY, GRAY], {"prior": GRAY[:, 1:]}),
        (ValueError, "no pixel of the prior has a disparity", [GRAY, GRAY], {"prior": np.full(GRAY.shape, np.nan)}),
        (TypeError, "prior is ", [GRAY, GRAY], {"prior": NOISE}),
        (ValueError, "threads are too many", [GRAY, GRAY], {"threads": 1000}),
        (ValueError, "simd is mmx, it must be one of .*baseline", [GRAY, GRAY], {"simd": "mmx"}),
        (ValueError, "and 1 MB may be taken", [GRAY, GRAY], {"method": "gc", "max_memory": 1}),
        (ValueError, "aligning takes about 2 MB", [LARGE, LARGE], {"align": True, "max_memory": 1}),
    ]:
        with pytest.raises(error, match=message):
            multiscopic.match(*arguments, **options)
    result = multiscopic.match(GRAY, GRAY)
    with pytest.raises(ValueError, match="depth needs the focal length and the baseline"):
        result.depth(focal_px=500)
    with pytest.raises(ValueError, match="baseline_mm is 0"):
        result.depth(focal_px=500, baseline_mm=0)
    with pytest.raises(ValueError, match="principal_point is NaN"):
        result.write_ply("never.ply", focal_px=500, baseline_mm=20, principal_point=(np.nan, 0))
    with pytest.raises(ValueError, match="the deviations are unknown: match with confidences"):
        multiscopic.match(GRAY, GRAY, method="bm", confidence=False).sigma(focal_px=500, baseline_mm=20)
    with pytest.raises(ValueError, match="no disparity of the truth is known"):
        multiscopic.evaluate(result.disparity, np.full_like(result.disparity, np.nan))
    with pytest.raises(ValueError, match="disparity has the shape"):
        multiscopic.evaluate(result.disparity[1:], result.disparity)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is available")
def test_more_memory_than_is_available_is_refused():
    import resource

    status = Path("/proc/self/status").read_text()
    taken = next(int(line.split()[1]) * 1024 for line in status.splitlines() if line.startswith("VmSize:"))
    large = np.zeros((1000, 1000), np.uint8)
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (taken + 200_000_000, limits[1]))
    try:
        with pytest.raises(ValueError, match=r"the match takes about \d+ MB of memory, and \d\d MB may be taken"):
            multiscopic.match(large, large, method="gc", num_disparities=256, threads=1)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def test_files(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"cannot read .*rig.toml"):
        multiscopic.Rig.load(tmp_path)
    (tmp_path / "rig.toml").write_text('[images]\ncenter = "c.png"\n')
    with pytest.raises(ValueError, match="no neighbour in"):
        multiscopic.Rig.load(str(tmp_path))
    (tmp_path / "rig.toml").write_text('[images]\ncenter = "c.png"\nright = "r.png"\n')
    rig = multiscopic.Rig.load(tmp_path)
    assert (rig.path, rig.views, rig.focal_px, rig.doffs) == (tmp_path, [(1, 0)], None, 0.0)
    with pytest.raises(FileNotFoundError, match="c.png"):
        rig.match()
    multiscopic.write_png(tmp_path / "c.png", NOISE)
    multiscopic.write_png(tmp_path / "r.png", moved(GRAY, 5)[:, 1:])
    with pytest.raises(ValueError, match="found 79x60 pixels, expected 80x60"):
        rig.frames()
    multiscopic.write_png(tmp_path / "r.png", moved(NOISE, 5))
    frames = rig.frames()
    assert np.array_equal(frames[0, 0], NOISE) and np.array_equal(frames[1, 0], moved(NOISE, 5))
    values = np.array([[1.5, np.nan, np.inf], [-2, 0, 1e30]], np.float32)
    multiscopic.write_pfm(tmp_path / "v.pfm", values)
    read = multiscopic.read_pfm(tmp_path / "v.pfm")
    assert np.array_equal(read, np.where(np.isinf(values), np.nan, values), equal_nan=True)
    with pytest.raises(ValueError, match="expected a PFM file"):
        multiscopic.read_pfm(tmp_path / "c.png")
    with pytest.raises(OSError, match="cannot write"):
        multiscopic.write_pfm(tmp_path / "missing" / "v.pfm", values)
    # The file keeps all bits of uint16, of which read_image gives the upper eight.
    multiscopic.write_png(tmp_path / "deep.png", NOISE * np.uint16(257))
    assert np.array_equal(multiscopic.read_image(tmp_path / "deep.png"), NOISE)
    most = NOISE.shape[0] * NOISE.shape[1] - 1
    try:
        multiscopic.set_max_pixels(most)
        with pytest.raises(ValueError, match=f"at most {most} in all"):
            multiscopic.read_image(tmp_path / "deep.png")
    finally:
        multiscopic.set_max_pixels(67_108_864)
    assert np.array_equal(multiscopic.read_image(tmp_path / "deep.png"), NOISE)


def test_inspect():
    image = np.kron(GRAY[:30, :40], np.ones((8, 8), np.uint8))
    (least, count), told = multiscopic.inspect(image, right=moved(image, 24), left=moved(image, -24))
    assert least <= 24 < least + count and told == []
    _, told = multiscopic.inspect(image, right=moved(image, -24), left=moved(image, 24))
    assert any("swapped" in warning for warning in told)


def test_warnings_are_pythons():
    image = np.kron(GRAY[:30, :40], np.ones((8, 8), np.uint8))
    swapped = {"right": moved(image, -24), "left": moved(image, 24)}
    with pytest.warns(multiscopic.MatchWarning, match="swapped") as told:
        result = multiscopic.match(image, **swapped, method="bm")
    assert [str(warning.message) for warning in told] == result.warnings
    # They are told at the line of the caller.
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", multiscopic.MatchWarning)
        with pytest.raises(multiscopic.MatchWarning, match="swapped"):
            multiscopic.match(image, **swapped, method="bm")


def test_points_are_those_of_the_cloud(rig, tmp_path):
    result = multiscopic.Rig.load(rig).match(method="bm")
    points = result.points()
    assert np.array_equal(result.points(edges="keep")[..., 2], result.depth(), equal_nan=True)
    is_point = np.isfinite(points[..., 2])
    assert np.array_equal(points[is_point], result.points(edges="keep")[is_point])
    assert 0 < is_point.sum() < np.isfinite(result.depth()).sum()
    assert np.isnan(points[~is_point]).all()
    result.write_ply(tmp_path / "cloud.ply", ascii=True)
    body = (tmp_path / "cloud.ply").read_text().split("end_header\n")[1]
    assert len(body.splitlines()) == is_point.sum()
    first = [float(word) for word in body.split()[:3]]
    assert np.array_equal(np.float32(first), points[is_point][0])


def test_other_threads_run_while_it_matches():
    options = {"method": "gc", "sweeps": 1, "confidence": False}
    slow = threading.Thread(target=lambda: multiscopic.match(LARGE, right=moved(LARGE, 20), **options))
    slow.start()
    turns = 0
    while slow.is_alive():
        time.sleep(0.001)
        turns += 1
    assert turns > 20


@pytest.mark.usefixtures("control_c")
def test_control_c_ends_it():
    image = np.kron(GRAY, np.ones((8, 8), np.uint8))
    timer = threading.Timer(0.5, _thread.interrupt_main)
    timer.start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        multiscopic.match(image, right=moved(image, 60), method="gc", num_disparities=100, confidence=False)
    assert time.monotonic() - start < 20


def test_notebook(rig, monkeypatch):
    monkeypatch.setenv("MULTISCOPIC_RIG", str(rig))
    notebook = nbformat.read(PACKAGE / "examples" / "multiscopic.ipynb", as_version=4)
    assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in notebook.cells), "outputs go stale"
    NotebookClient(notebook, timeout=120, kernel_name="python3").execute()


def test_sweeps_are_refused_where_they_make_no_sense(rig, sweep):
    frames, offsets = [moved(GRAY, 2), moved(GRAY, -2)], [20, -20]
    for message, arguments, options in [
        ("there are 2 frames and 1 offsets_mm", [GRAY, frames, [20]], {}),
        ("there are 1 frames and 1 offsets_mm", [GRAY, frames[:1], [20]], {}),
        (r"frames\[1\]: found 79x60 pixels, expected 80x60 as in the centre", [GRAY, [frames[0], GRAY[:, 1:]], offsets], {}),
        ("a place of 20 baselines, expected 16 at most", [GRAY, frames, offsets], {"baseline_mm": 1}),
        ("baseline_mm is 0", [GRAY, frames, [0, 0]], {}),
        ("block_size has no effect on the frames of a sweep", [GRAY, frames, offsets], {"block_size": 5}),
        ("align has no effect on the frames of a sweep", [GRAY, frames, offsets], {"align": True}),
        ("at most 256 disparities, 300 were given", [GRAY, frames, offsets], {"num_disparities": 300}),
    ]:
        with pytest.raises(ValueError, match=message):
            multiscopic.match_sweep(*arguments, **options)
    slide = multiscopic.Rig.load(sweep)
    assert slide.views == [] and repr(slide).endswith(f"a sweep of {len(slide.sweep()[1])} frames>")
    with pytest.raises(ValueError, match="the frames of a sweep"):
        slide.frames()
    with pytest.raises(ValueError, match="sub_pixel has no effect on the frames of a sweep"):
        slide.match(sub_pixel="none")
    with pytest.raises(ValueError, match="no .*sweep"):
        multiscopic.Rig.load(rig).sweep()


def code_of(guide):
    """The Python blocks of a guide, one after the other."""
    blocks = (PACKAGE.parent / "docs" / guide).read_text().split("```python\n")[1:]
    return compile("\n".join(block.split("```")[0] for block in blocks), f"docs/{guide}", "exec")


def test_code_of_the_guide(rig, sweep, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig").symlink_to(rig)
    (tmp_path / "sweep").symlink_to(sweep)
    # What stands for the hardware of the reader: a wall that moves by 8 pixels.
    place = {}
    driver = types.SimpleNamespace(go=place.update)
    sensor = types.SimpleNamespace(read=lambda: np.roll(NOISE, (round(0.4 * place["y"]), -round(0.4 * place["x"])), axis=(0, 1)))
    names = {"driver": driver, "sensor": sensor}
    exec(code_of("python.md"), names)
    assert np.array_equal(names["rig"].frames()[1, 0], np.roll(NOISE, -8, axis=1)[..., ::-1])


#: An arm whose tool looks down from 700 mm, as a command for --stage exec.
ARM = """
import sys
x = y = 0.0
for line in sys.stdin:
    order, *numbers = line.split()
    if order == "move":
        x, y = map(float, numbers)
    place = f" {x} {y} {400 + x} {-200 - y} 700 180 0 0" if order == "where" else ""
    print("ok" + place, flush=True)
"""


def test_code_that_finds_a_part(program, tmp_path, monkeypatch, capsys):
    """The camera is 50 mm beside the tool, and sees the scene of the demo."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.py").write_text(ARM)
    (tmp_path / "hand_eye.toml").write_text("translation_mm = [50.0, 0.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.0]\n")
    quick = "--settle 0 --size 320x240 --views 4 --baseline 20 --hand-eye hand_eye.toml -o rig".split()
    program("capture", "--camera", "sim", "--stage", f"exec:{sys.executable} arm.py", *quick)
    exec(code_of("picking.md"), {})
    pose = capsys.readouterr().out.split("p[")[1].split("]")[0]
    x, y, z = [float(number) for number in pose.split(",")[:3]]
    truth = multiscopic.read_pfm(tmp_path / "rig" / "truth.pfm")
    nearest = multiscopic.Rig.load(tmp_path / "rig").focal_px * 0.02 / np.quantile(truth, 0.999)
    # 100 mm above the part.
    assert abs(z - (0.7 - nearest + 0.1)) < 0.005
    assert abs(x - 0.45) < nearest * 0.4 and abs(y + 0.2) < nearest * 0.4
