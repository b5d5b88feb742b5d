#!/usr/bin/env python3
"""The errors of `multiscopic calibrate hand-eye` and of OpenCV's `calibrateHandEye`, from the same pictures and poses.

    pip install "opencv-python-headless<5"    # 5.0 has no calibrateHandEye in Python
    cargo build --release && tests/benches/hand_eye.py --runs 50

Each run has another place of the camera on the tool, another board, and pictures of it from all sides, turned by up to 30 degrees
about each axis. The arm reports poses that err by a normal distribution on each axis. OpenCV detects the corners of the board
itself, and `solvePnP` gives its methods the board in each picture.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

import cv2
import numpy as np

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/multiscopic"
METHODS = {name: getattr(cv2, f"CALIB_HAND_EYE_{name.upper()}") for name in ("Tsai", "Park", "Horaud", "Andreff", "Daniilidis")}
WIDTH, HEIGHT, FOCAL = 1280, 960, 1200.0
CAMERA = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
# The board that `multiscopic calibrate board` prints: 10x7 squares of 25 mm.
SQUARES, SQUARE_MM = (10, 7), 25.0
BOARD = cv2.aruco.CharucoBoard(SQUARES, SQUARE_MM, 0.75 * SQUARE_MM, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250))
BOARD_MM = np.array([side * SQUARE_MM for side in SQUARES])
PX_PER_MM = 10
PRINT = BOARD.generateImage([int(mm * PX_PER_MM) for mm in BOARD_MM])
# Pictures are drawn this much larger, and shrunk.
LARGER = 3
GRAY_NOISE = 2.0


def pose(translation, turn):
    """A transform of a translation in millimetres, and an axis times radians."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = cv2.Rodrigues(np.asarray(turn, float))[0], translation
    return transform


def picture(board_in_camera, random):
    """What the camera sees of the board."""
    to_mm = np.array([[1 / PX_PER_MM, 0, 0.5 / PX_PER_MM], [0, 1 / PX_PER_MM, 0.5 / PX_PER_MM], [0, 0, 1]])
    enlarge = np.array([[LARGER, 0, (LARGER - 1) / 2], [0, LARGER, (LARGER - 1) / 2], [0, 0, 1]])
    warp = enlarge @ CAMERA @ board_in_camera[:3, [0, 1, 3]] @ to_mm
    size = (LARGER * WIDTH, LARGER * HEIGHT)
    large = cv2.warpPerspective(PRINT, warp, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255)
    gray = 30 + 0.75 * cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(float)
    return np.clip(np.round(gray + random.normal(0, GRAY_NOISE, gray.shape)), 0, 255).astype(np.uint8)


def made_up(random, count, noise_mm, noise_deg):
    """The camera on the tool, pictures of a board, and the poses that the arm reports."""
    within = lambda most: random.uniform(-most, most, 3)
    camera_on_tool = pose(within(80), within(1.5))
    board = pose([500, random.uniform(-200, 200), random.uniform(-100, 100)], within(0.5))
    pictures, tools = [], []
    for _ in range(count):
        turn = pose([0, 0, 0], within(0.5))
        seen_at = [random.uniform(-40, 40), random.uniform(-30, 30), random.uniform(380, 540)]
        board_in_camera = pose(seen_at - (turn[:3, :3] @ [*BOARD_MM / 2, 0]), cv2.Rodrigues(turn[:3, :3])[0])
        pictures.append(picture(board_in_camera, random))
        tool = board @ np.linalg.inv(camera_on_tool @ board_in_camera)
        off = pose([0, 0, 0], np.radians(random.normal(0, noise_deg, 3)))
        reported = off @ tool
        reported[:3, 3] = tool[:3, 3] + random.normal(0, noise_mm, 3)
        tools.append(reported)
    return camera_on_tool, pictures, tools


def by_opencv(pictures, tools):
    """The camera on the tool by each of OpenCV's methods."""
    detector = cv2.aruco.CharucoDetector(BOARD)
    boards, seen_from = [], []
    for image, tool in zip(pictures, tools):
        corners, ids, _, _ = detector.detectBoard(image)
        if ids is None or len(ids) < 6:
            continue
        points, pixels = BOARD.matchImagePoints(corners, ids)
        _, turn, translation = cv2.solvePnP(points, pixels, CAMERA, None)
        boards.append(pose(translation.ravel(), turn))
        seen_from.append(tool)
    parts = lambda transforms: ([t[:3, :3] for t in transforms], [t[:3, 3] for t in transforms])
    found = {}
    for name, method in METHODS.items():
        rotation, translation = cv2.calibrateHandEye(*parts(seen_from), *parts(boards), method=method)
        found[name] = pose(translation.ravel(), cv2.Rodrigues(rotation)[0])
    return found


def by_multiscopic(pictures, tools):
    """The camera on the tool by the program."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        lens = f'size = [{WIDTH}, {HEIGHT}]\nfocal_px = [{FOCAL}, {FOCAL}]\nprincipal_point = {CAMERA[:2, 2].tolist()}\n'
        (folder / "camera.toml").write_text(lens + 'model = "plumb_bob"\ncoefficients = [0.0, 0.0, 0.0, 0.0, 0.0]\n')
        lines = ["image,x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad"]
        for number, (image, tool) in enumerate(zip(pictures, tools)):
            cv2.imwrite(str(folder / f"{number:02}.png"), image)
            numbers = [*tool[:3, 3], *cv2.Rodrigues(tool[:3, :3])[0].ravel()]
            lines.append(",".join([f"{number:02}.png", *(f"{value:.9f}" for value in numbers)]))
        (folder / "poses.csv").write_text("\n".join(lines) + "\n")
        command = [PROGRAM, "--quiet", "calibrate", "hand-eye", folder, "--lens", folder / "camera.toml", "--json"]
        done = subprocess.run([*command, "-o", folder / "hand_eye.toml"], check=True, capture_output=True, text=True)
    found = json.loads(done.stdout)["hand_eye"]
    return pose(found["translation_mm"], np.radians(found["rotation_deg"]))


def errors(found, truth):
    """Millimetres and degrees."""
    turn = cv2.Rodrigues(found[:3, :3] @ truth[:3, :3].T)[0]
    return np.linalg.norm(found[:3, 3] - truth[:3, 3]), np.degrees(np.linalg.norm(turn))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--poses", type=int, default=15)
    parser.add_argument("--arm-mm", type=float, default=0.1, help="standard deviation of the arm's positions on each axis")
    parser.add_argument("--arm-deg", type=float, default=0.01, help="that of its orientations about each axis")
    options = parser.parse_args()
    table = {}
    for run in range(options.runs):
        truth, pictures, tools = made_up(np.random.default_rng(run), options.poses, options.arm_mm, options.arm_deg)
        for name, found in {"multiscopic": by_multiscopic(pictures, tools), **by_opencv(pictures, tools)}.items():
            table.setdefault(name, []).append(errors(found, truth))
    arm = f"an arm that errs by {options.arm_mm} mm and {options.arm_deg} degrees"
    print(f"OpenCV {cv2.__version__}, {options.runs} runs of {options.poses} poses, {arm}")
    print("| | translation in mm: median | 95 % | worst | rotation in degrees: median | 95 % | worst |\n|" + " --- |" * 7)
    for name, found in table.items():
        columns = zip(np.transpose(found), (2, 3))
        cells = [f"{np.quantile(column, share):.{digits}f}" for column, digits in columns for share in (0.5, 0.95, 1)]
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
