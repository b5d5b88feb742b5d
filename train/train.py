"""Trains the network on features of made-up scenes.

The learning rate rises, then falls along a cosine to the end, which is a number of steps or of minutes. A run that was stopped
goes on from its last checkpoint.
"""

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
import torch

import scenes
from data import Example, augmented, batch_of
from losses import loss, metrics
from model import Network

SIZE = (192, 256)
# From which part of the training on weights and activations are rounded.
QUANTIZED_FROM = 0.4
# Scenes in which semi-global matching fails at a larger share of the pixels are drawn less often, in inverse proportion.
EASY = 0.1


def examples(folder, sets):
    found = []
    for scene_set in sets:
        for use in scene_set.uses:
            for number in use.scenes:
                features = folder / "features" / f"{scene_set.name}-{use.name}" / f"{number:04}"
                if features.exists():
                    truth = folder / scene_set.name / f"{number:04}" / "truth.pfm"
                    found.append((use.name, Example(features, truth, use.least)))
    return found


def draw(training, random, size):
    """A batch of examples that have the same number of disparities."""
    chosen = []
    while len(chosen) < size:
        _, example = training[random.integers(len(training))]
        # Scenes in which little can be matched teach less.
        is_drawn = random.random() < EASY / max(example.hardness, EASY)
        if is_drawn and (not chosen or example.count == chosen[0].count):
            chosen.append(example)
    arrays = []
    for example in chosen:
        y, x = (4 * random.integers((side - size) // 4 + 1) for side, size in zip(example.truth.shape, SIZE))
        arrays.append(augmented(example.arrays(y, x, *SIZE), random))
    return batch_of(arrays, chosen[0].count)


def evaluate(network, held_back):
    """The mean metrics of each kind of examples."""
    results, baseline = {}, {}
    with torch.no_grad():
        for name, example in held_back:
            batch = batch_of([example.arrays()], example.count)
            out = network(batch, torch.bfloat16)["disparity"]
            results.setdefault(name, []).append(metrics(out, batch["truth"]))
            baseline.setdefault(name, []).append(metrics(batch["db"].float(), batch["truth"]))
    average = lambda found: {name: [round(float(x), 4) for x in torch.stack(all_of).mean(0)] for name, all_of in found.items()}
    return average(results), average(baseline)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path, help="scenes and features, as scenes.py makes them")
    parser.add_argument("--run", type=Path, required=True, help="folder for checkpoints and the log")
    end = parser.add_mutually_exclusive_group(required=True)
    end.add_argument("--steps", type=int)
    end.add_argument("--minutes", type=float)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()

    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    options.run.mkdir(parents=True, exist_ok=True)
    checkpoint, log = options.run / "checkpoint.pt", options.run / "log.jsonl"
    network, mean = Network(), Network()
    mean.load_state_dict(network.state_dict())
    optimizer = torch.optim.Adam(network.parameters(), betas=(0.9, 0.99))
    step, elapsed = 0, 0.0
    if checkpoint.exists():
        state = torch.load(checkpoint)
        network.load_state_dict(state["network"])
        mean.load_state_dict(state["mean"])
        optimizer.load_state_dict(state["optimizer"])
        step, elapsed = state["step"], state["elapsed"]
    random = np.random.default_rng([options.seed, step])
    training, held_back = examples(options.folder, scenes.TRAINING), examples(options.folder, scenes.HELD_BACK)
    print(len(training), "examples,", len(held_back), "held back, from step", step, flush=True)

    def report(**values):
        line = json.dumps({"step": step, "minutes": round(elapsed / 60, 2), **values})
        print(line, flush=True)
        with open(log, "a") as file:
            file.write(line + "\n")

    def save():
        state = {"network": network.state_dict(), "mean": mean.state_dict(), "optimizer": optimizer.state_dict()}
        torch.save({**state, "step": step, "elapsed": elapsed}, checkpoint.with_suffix(".new"))
        checkpoint.with_suffix(".new").rename(checkpoint)

    def progress():
        return step / options.steps if options.steps else elapsed / 60 / options.minutes

    last, last_evaluation, last_save = time.time(), elapsed, elapsed
    losses = []
    while progress() < 1:
        part = progress()
        network.quantize(part >= QUANTIZED_FROM)
        mean.quantize(part >= QUANTIZED_FROM)
        rate = options.rate * min(1, (step + 1) / 300) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * part)))
        for group in optimizer.param_groups:
            group["lr"] = rate
        batch = draw(training, random, options.batch)
        value = loss(network(batch, torch.bfloat16), batch["truth"], batch["count"])
        optimizer.zero_grad(set_to_none=True)
        value.backward()
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        if norm.isfinite():
            optimizer.step()
        step += 1
        decay = min(0.998, step / (step + 10))
        with torch.no_grad():
            for to, of in zip(mean.parameters(), network.parameters()):
                to.lerp_(of, 1 - decay)
        losses.append(float(value.detach()))
        elapsed, last = elapsed + time.time() - last, time.time()
        if step % 50 == 0:
            report(rate=round(rate, 6), loss=round(float(np.mean(losses)), 4), norm=round(float(norm), 3))
            losses = []
        if elapsed - last_save > 120:
            save()
            last_save = elapsed
        if elapsed - last_evaluation > 480:
            results, _ = evaluate(mean, held_back)
            report(held_back=results)
            last_evaluation = elapsed
    save()
    results, baseline = evaluate(mean, held_back)
    report(held_back=results, baseline=baseline, final=True)


if __name__ == "__main__":
    main()
