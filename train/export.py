"""Writes the weights of a checkpoint in whole numbers: `python export.py CHECKPOINT OUT.weights [--calibrate FOLDER]`."""

import argparse
from pathlib import Path

import numpy as np
import torch

import reference
from model import UNIT, Network
from reference import LAYERS


def whole(layer):
    """The weights, biases, multipliers and shifts of a layer."""
    scales = layer.scales().double()
    real = layer.weight.detach().double()
    weights = (real / scales[:, None, None, None]).round().clamp(-127, 127)
    # The offset that was subtracted from the inputs, in whole weights.
    bias = UNIT * layer.bias.detach().double() / scales - layer.center * weights.sum((1, 2, 3))
    # A multiplier of 12 bits: sums keep three bits more than the result has.
    shifts = torch.floor(12 - 15 - torch.log2(scales)).clamp(0, 16)
    multipliers = (scales * 2 ** (shifts + 15)).round().clamp(0, 32767)
    # Shifting rounds down: half a unit more rounds to the nearest.
    bias = (bias + torch.where(shifts > 0, 2 ** (shifts - 1), 0.0)).round()
    return weights.permute(0, 2, 3, 1), bias, multipliers, shifts


def start(network, weights):
    """Gives a network the weights in whole numbers, with which it goes on learning."""
    for name, *_ in LAYERS:
        layer, (values, bias, multipliers, shifts) = network.layer(name), map(torch.from_numpy, weights.layers[name])
        scales = multipliers / 2.0 ** (shifts + 15)
        bias = bias - torch.where(shifts > 0, 2 ** (shifts - 1), 0) + layer.center * values.sum((1, 2, 3))
        layer.weight.data = (values * scales[:, None, None, None]).permute(0, 3, 1, 2).float().contiguous()
        layer.bias.data = (bias * scales / UNIT).float()


def data_of(network, sure):
    parts = [reference.MAGIC]
    for name, *_ in LAYERS:
        for values, kind in zip(whole(network.layer(name)), ("i1", "<i4", "<u2", "u1")):
            parts.append(values.contiguous().numpy().astype(kind).tobytes())
    parts.append(np.round(4096 * np.exp(-np.arange(160) / 16)).astype("<u2").tobytes())
    parts.append(np.asarray(sure, "u1").tobytes())
    return b"".join(parts)


def logistic(slope=1.0, offset=0.0):
    """Confidences of logits in units of 1/16 from -128 on."""
    logits = (np.arange(256) - 128) / UNIT
    return np.round(255 / (1 + np.exp(-(slope * logits + offset))))


def calibrated(weights, examples):
    """The table of confidences that fits examples held back: a logistic curve of the network's logits.

    It is fitted to what the program makes of two looks, which is right more often than either. Scenes count as often as they are
    drawn in training.
    """
    logits, agree, right, counts = [], [], [], []
    for example in examples:
        disparities, confidences, logit = reference.both_looks(weights, *example.features)
        valid = np.isfinite(example.truth)
        logits.append(np.clip(logit[:, valid], -128, 127) / UNIT)
        agree.append(np.abs(disparities[0] - disparities[1])[valid] <= 64)
        right.append(np.abs(reference.fused(disparities, confidences)[0] - example.truth)[valid] <= 64)
        counts.append(np.full(valid.sum(), example.weight))
    logits = torch.tensor(np.concatenate(logits, 1))
    agree, right, counts = (torch.tensor(np.concatenate(a)) for a in (agree, right, counts))
    curve = torch.tensor([1.0, 0.0], dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.LBFGS([curve], max_iter=50)

    def closure():
        optimizer.zero_grad()
        p, q = torch.sigmoid(curve[0] * logits + curve[1])
        one = torch.maximum(p, q) * (1 - torch.minimum(p, q)) / (1 - p * q)
        value = torch.nn.functional.binary_cross_entropy(torch.where(agree, (p + q) / 2, one), right.double(), counts)
        value.backward()
        return value

    optimizer.step(closure)
    return logistic(*curve.detach().tolist())


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--calibrate", type=Path, help="folder of scenes and features")
    options = parser.parse_args()
    network = Network()
    network.load_state_dict(torch.load(options.checkpoint)["mean"])
    data = data_of(network, logistic())
    if options.calibrate:
        import scenes
        from train import examples

        held_back = [example for _, example in examples(options.calibrate, scenes.HELD_BACK)[::3]]
        data = data_of(network, calibrated(reference.Weights(data), held_back))
    options.output.write_bytes(data)
    print(options.output, len(data), "bytes")


if __name__ == "__main__":
    main()
