#!/usr/bin/env python3
"""ONNX Runtime and the project's own networks side by side, in turns, in one run.

    pip install numpy onnx onnxruntime safetensors
    multiscopic weights install && cargo build --release -p multiscopic-tests --example mccnn
    tests/benches/mccnn_onnx.py $(multiscopic weights path | head -1)

Features of the fast network on noise, one thread, the best of some runs in each turn. What is printed is the best over all turns, the
ratio, and 10^9 multiplications with addition (MAC) in a second.
"""

import argparse
import json
import pathlib
import subprocess
import time

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from safetensors.numpy import load_file

PROGRAM = pathlib.Path(__file__).resolve().parents[2] / "target/release/examples/mccnn"


def session(weights, threads):
    """The fast network as a graph: convolutions without borders, then vectors of length 1."""
    tensors = load_file(weights)
    nodes, name = [], "image"
    for i in range(0, 10, 2):
        nodes.append(helper.make_node("Conv", [name, f"conv_blocks.{i}.weight", f"conv_blocks.{i}.bias"], [f"conv{i}"]))
        name = f"conv{i}"
        if i < 8:
            nodes.append(helper.make_node("Relu", [name], [f"relu{i}"]))
            name = f"relu{i}"
    nodes.append(helper.make_node("LpNormalization", [name], ["features"], axis=1, p=2))
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 1, "height", "width"])
    features = helper.make_tensor_value_info("features", TensorProto.FLOAT, [1, 64, "rows", "columns"])
    constants = [numpy_helper.from_array(values, name) for name, values in tensors.items()]
    graph = helper.make_graph(nodes, "fast", [image], [features], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=pathlib.Path, help="mc_cnn_fast_mb_weights.safetensors")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--repeat", type=int, default=3, help="runs in each turn")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))

    # As many features as pixels: the graph takes 5 pixels off each border.
    image = np.random.default_rng(0).standard_normal((1, 1, height + 10, width + 10), dtype=np.float32)
    theirs = session(options.weights, options.threads)
    numbers = {"width": width, "height": height, "threads": options.threads, "repeat": options.repeat}
    command = [PROGRAM, "--network=fast", *(f"--{name}={value}" for name, value in numbers.items())]
    environment = {"MULTISCOPIC_WEIGHTS": str(options.weights.resolve().parent)}

    best = {}
    for _ in range(options.turns):
        times = []
        for _ in range(options.repeat):
            start = time.perf_counter()
            theirs.run(None, {"image": image})
            times.append(time.perf_counter() - start)
        ours = json.loads(subprocess.run(command, check=True, capture_output=True, env=environment).stdout)["seconds"]
        turn = {"ONNX Runtime": min(times), "multiscopic": ours}
        best = {name: min(seconds, best.get(name, seconds)) for name, seconds in turn.items()}

    sizes = ((width + 2 * i) * (height + 2 * i) for i in (4, 3, 2, 1, 0))
    macs = sum(size * 9 * 64 * (1 if i == 0 else 64) for i, size in enumerate(sizes))
    print(f"ONNX Runtime {onnxruntime.__version__}, {options.size}, {options.threads} threads, {macs / 1e9:.1f} GMAC")
    print(f"{'':16} {'s':>7} {'GMAC/s':>7} {'ratio':>7}")
    for name, seconds in best.items():
        print(f"{name:16} {seconds:7.3f} {macs / seconds / 1e9:7.1f} {seconds / best['ONNX Runtime']:6.2f}x")


if __name__ == "__main__":
    main()
