"""Compares the weights in whole numbers with the checkpoint in real ones, and with two looks, on the scenes held back.

    python check.py CHECKPOINT NETWORK.weights FOLDER

Prints RMS, mean error and the share of errors above a pixel of each kind of scenes; and how well confidences are calibrated.
"""

import sys
from pathlib import Path

import numpy as np
import torch

import reference
import scenes
from data import batch_of
from model import Network
from train import examples, metrics


def main():
    checkpoint, weights_file, folder = map(Path, sys.argv[1:])
    network = Network()
    network.load_state_dict(torch.load(checkpoint)["mean"])
    weights = reference.Weights(weights_file.read_bytes())
    found, bins = {}, np.zeros((10, 3))
    for name, example in examples(folder, scenes.HELD_BACK):
        batch = batch_of([example.arrays()], example.count)
        height, width = example.truth.shape
        with torch.no_grad():
            real = network(batch)["disparity"][0, :height, :width]
        disparities, confidences, _ = reference.both_looks(weights, *example.features)
        fused, confidence = reference.fused(disparities, confidences)
        truth = torch.from_numpy(example.truth.copy())
        candidates = {
            "two scales": torch.from_numpy(example.winners[1].astype(np.float32)),
            "real": real,
            "whole": torch.from_numpy(disparities[0].astype(np.float32)),
            "both looks": torch.from_numpy(fused.astype(np.float32)),
        }
        for kind, disparity in candidates.items():
            found.setdefault((name, kind), []).append(metrics(disparity, truth))
        valid = np.isfinite(example.truth)
        right, sure = np.abs(fused - example.truth)[valid] <= 64, confidence[valid] / 255
        index = np.minimum((10 * sure).astype(int), 9)
        for column, values in enumerate((np.ones_like(sure), sure, right)):
            bins[:, column] += np.bincount(index, values, 10)
    for (name, kind), all_of in found.items():
        print(f"{name:13} {kind:10} RMS %.3f  AvgErr %.3f  Bad1 %.2f" % tuple(torch.stack(all_of).mean(0).tolist()))
    counts, sure, right = bins.T
    print("expected calibration error %.3f" % (np.abs(sure - right).sum() / counts.sum()))
    for count, s, r in bins[counts > 0]:
        print(f"  said {s / count:.2f}  right {r / count:.2f}  of {100 * count / counts.sum():.1f} %")


if __name__ == "__main__":
    main()
