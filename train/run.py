"""Runs all steps: scenes, features, training, weights in whole numbers, metrics.

    cargo build --release -p multiscopic-cli
    python train/run.py --program target/release/multiscopic --folder out/train

A run that was stopped resumes.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import scenes

HERE = Path(__file__).parent


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True, help="for scenes, features and checkpoints: 14 GB")
    parser.add_argument("--steps", type=int, default=30_000, help="how many steps training takes: about an hour on two cores")
    parser.add_argument("--start", type=Path, help="weights to go on from, at half the rate, rather than from nothing")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()

    scenes.make(options.program, options.folder, options.threads)
    run, weights = options.folder / "run", options.folder / "network.weights"
    start = ["--start", options.start, "--rate", 1e-3] if options.start else []
    training = ["--run", run, "--steps", options.steps, "--seed", options.seed, "--processes", options.threads]
    commands = [
        ["train.py", options.folder, *training, *start],
        ["export.py", run / "checkpoint.pt", weights, "--calibrate", options.folder],
        ["curves.py", run / "log.jsonl", run / "curves.svg"],
        ["check.py", run / "checkpoint.pt", weights, options.folder],
    ]
    for script, *arguments in commands:
        subprocess.run([sys.executable, HERE / script, *map(str, arguments)], check=True)


if __name__ == "__main__":
    main()
