#!/usr/bin/env python3
"""Makes the golden vectors of the networks by the Python package of their weights, under PyTorch, on a part of the demo's scene.

    pip install mccnn==1.4.1 torch numpy pillow
    multiscopic demo --width 160 --height 120 -o out/demo
    tests/golden/mccnn/make.py out/demo

Beside this file it writes the images, `vectors.json`, and `legacy.pt`: a small file in PyTorch's old format, and what is in it. Images
are extended by 5 pixels of their border once they are normalised, as this project does; all else is the package's own code. The
accurate network is asked both ways round, as this project does, by the package's costs of the centre and the other image, and of the
other image and the centre.
"""

import json
import pathlib
import sys

import numpy as np
import torch
from mc_cnn.cost_volume.cost_volume_pybaseline import CostVolumeBaseline
from mc_cnn.model.mc_cnn_accurate import AccMcCnnInfer
from mc_cnn.model.mc_cnn_fast import FastMcCnn
from mc_cnn.weights.weights import get_weights
from PIL import Image

HERE = pathlib.Path(__file__).parent
LEFT, TOP, WIDTH, HEIGHT = 60, 48, 40, 24
PIXELS = [(0, 0), (39, 23), (20, 12), (7, 3), (33, 18), (0, 12)]
DISPARITIES = range(-2, 11)


def grey(path):
    """An image in 8-bit grey, as the project makes it."""
    r, g, b = np.moveaxis(np.array(Image.open(path).convert("RGB")).astype(np.uint32), 2, 0)
    return ((77 * r + 150 * g + 29 * b + 128) >> 8).astype(np.uint8)


def network(model, architecture):
    state = torch.load(str(get_weights(architecture, "middlebury")), map_location="cpu", weights_only=False)
    model.load_state_dict(state["model"])
    return model.eval()


def extended(image):
    image = image.astype(np.float32)
    return torch.from_numpy(np.pad((image - image.mean()) / image.std(), 5, mode="edge"))


def numbers(values):
    return [float(f"{value:.8g}") for value in np.asarray(values).ravel()]


def main():
    images = {}
    for name in ("center", "left", "right"):
        images[name] = grey(pathlib.Path(sys.argv[1]) / f"{name}.png")[TOP : TOP + HEIGHT, LEFT : LEFT + WIDTH]
        Image.fromarray(images[name]).save(HERE / f"{name}.png")
    inputs = {name: extended(image) for name, image in images.items()}

    fast, accurate = network(FastMcCnn(), "fast"), network(AccMcCnnInfer(), "accurate")
    compare = CostVolumeBaseline({"cost_volume_method": "baseline"})
    with torch.no_grad():
        features = {
            "fast": {name: fast(image, training=False) for name, image in inputs.items()},
            "accurate": {name: accurate.conv_blocks(image[None, None])[0] for name, image in inputs.items()},
        }

    def volume(architecture, view):
        """Costs by row, column and the package's disparity: how far the match is to the right."""
        reach = max(abs(d) for d in DISPARITIES)
        center, other = features[architecture]["center"], features[architecture][view]
        if architecture == "fast":
            return reach, compare.computes_cost_volume(center.numpy(), other.numpy(), -reach, reach)
        ask = lambda *sides: np.asarray(  # noqa: E731
            accurate.computes_cost_volume_mc_cnn_accurate(*sides, -reach, reach, accurate.compute_cost_mc_cnn_accurate)
        )
        there, back = ask(center[None], other[None]), ask(other[None], center[None])
        mean = np.full_like(there, np.nan)
        for shift in range(-reach, reach + 1):
            columns = np.arange(max(0, -shift), min(WIDTH, WIDTH - shift))
            mean[:, columns, reach + shift] = (there[:, columns, reach + shift] + back[:, columns + shift, reach - shift]) / 2
        return reach, mean

    vectors = {"disparities": list(DISPARITIES)}
    for architecture in ("fast", "accurate"):
        center = features[architecture]["center"]
        vectors[architecture] = {
            "features": [{"u": u, "v": v, "values": numbers(center[:, v, u])} for u, v in PIXELS],
            "costs": [],
        }
        for view, sign in (("right", -1), ("left", 1)):
            reach, costs = volume(architecture, view)
            for u, v in PIXELS:
                # Where the match lies outside the package has no number: null.
                found = [float(costs[v, u, reach + sign * d]) for d in DISPARITIES]
                found = [None if np.isnan(cost) else float(f"{cost:.8g}") for cost in found]
                vectors[architecture]["costs"].append({"view": view, "u": u, "v": v, "values": found})

    torch.manual_seed(1)
    layers = torch.nn.Sequential(torch.nn.Conv2d(2, 3, 3), torch.nn.Linear(3, 1))
    optimizer = torch.optim.SGD(layers.parameters(), lr=0.1, momentum=0.9)
    layers[1](torch.ones(3)).sum().backward()
    optimizer.step()
    state = {"model": layers.state_dict(), "optimizer": optimizer.state_dict(), "epoch": 3}
    torch.save(state, HERE / "legacy.pt", _use_new_zipfile_serialization=False)
    vectors["legacy"] = {
        name: {"shape": list(tensor.shape), "values": [float(x) for x in tensor.ravel()]}
        for name, tensor in layers.state_dict().items()
    }

    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in vectors.items())
    (HERE / "vectors.json").write_text("{\n" + lines + "\n}\n")


if __name__ == "__main__":
    main()
