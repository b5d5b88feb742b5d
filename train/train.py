"""Trains the network on features of made-up scenes, by a loss and with the metrics by which weights are selected.

The learning rate rises, then falls along a cosine to the end. A run that was stopped goes on from its last checkpoint.
"""

import argparse
import json
import math
import socket
import time
from pathlib import Path

import numpy as np
import torch
import torch.distributed as dist
import torch.nn.functional as F
from torch import multiprocessing

import export
import reference
import scenes
from data import Example, augmented, batch_of
from model import Network

SIZE = (192, 256)
# From which part of the training on weights and activations are rounded.
QUANTIZED_FROM = 0.3


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
        if random.random() < example.weight and (not chosen or example.count == chosen[0].count):
            chosen.append(example)
    arrays = []
    for example in chosen:
        y, x = (4 * random.integers((side - size) // 4 + 1) for side, size in zip(example.truth.shape, SIZE))
        arrays.append(augmented(example.arrays(y, x, *SIZE), random))
    return batch_of(arrays, chosen[0].count)


def robust(error):
    """The loss of an error in pixels: nearly linear near 0, then of a small slope, so that hidden surfaces do not count too much."""
    return ((error * error + 0.01).sqrt() - 0.1).clamp(max=4.0) + 0.05 * error.abs()


def mean(values, valid):
    return (values * valid).sum() / valid.sum().clamp(min=1)


def block_shares(truth, valid, count):
    """The share of each block's pixels at each whole disparity, b x count x h/4 x w/4; a pixel between two counts for both."""
    b, h, w = truth.shape
    block = torch.arange(h)[:, None] // 4 * (w // 4) + torch.arange(w) // 4
    whole = truth.floor()
    shares = torch.zeros(b, count * (h // 4) * (w // 4))
    for index, share in ((whole, 1 - (truth - whole)), (whole + 1, truth - whole)):
        inside = (index >= 0) & (index < count)
        at = index.clamp(0, count - 1).long() * ((h // 4) * (w // 4)) + block
        shares.scatter_add_(1, at.reshape(b, -1), (share * inside * valid / 16).reshape(b, -1))
    return shares.reshape(b, count, h // 4, w // 4)


def loss(out, truth, count):
    valid = truth.isfinite() & (truth > -32) & (truth < 64 * count - 32)
    truth = torch.where(valid, truth, 0.0)
    valid = valid.float()
    error = (out["disparity"] - truth) / 64
    total = mean(robust(error), valid)
    for name in ("mixed", "volume"):
        total = total + 0.3 * mean(robust((out[name] - truth) / 64), valid)
    b, n, h, w = out["logits"].shape
    target = block_shares(truth / 64, valid, n)
    total = total - 0.25 * (target * F.log_softmax(out["logits"] / 16, 1)).sum(1).mean()
    right = (error.detach().abs() <= 1).float()
    return total + 0.1 * mean(F.binary_cross_entropy_with_logits(out["confidence"], right, reduction="none"), valid)


def metrics(disparity, truth):
    """RMS, mean error and share of errors above a pixel, of arrays in 1/64 px."""
    valid = truth.isfinite()
    error = ((disparity - truth)[valid] / 64).abs()
    return torch.stack([(error**2).mean().sqrt(), error.mean(), 100 * (error > 1).float().mean()])


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


class Run:
    """A training, by several processes: each computes the gradients of a part of the batch."""

    def __init__(self, options, rank):
        self.options, self.rank = options, rank
        self.step, self.elapsed = 0, 0.0
        torch.manual_seed(options.seed)
        self.network, self.mean = Network(), Network()
        if options.start:
            export.start(self.network, reference.Weights(options.start.read_bytes()))
        self.mean.load_state_dict(self.network.state_dict())
        self.optimizer = torch.optim.Adam(self.network.parameters(), betas=(0.9, 0.99))
        self.checkpoint = options.run / "checkpoint.pt"
        if self.checkpoint.exists():
            state = torch.load(self.checkpoint)
            for name in ("network", "mean", "optimizer"):
                getattr(self, name).load_state_dict(state[name])
            self.step, self.elapsed = state["step"], state["elapsed"]

    def save(self):
        state = {name: getattr(self, name).state_dict() for name in ("network", "mean", "optimizer")}
        new = self.checkpoint.with_suffix(".new")
        torch.save({**state, "step": self.step, "elapsed": self.elapsed}, new)
        new.rename(self.checkpoint)

    def report(self, **values):
        line = json.dumps({"step": self.step, "minutes": round(self.elapsed / 60, 2), **values})
        print(line, flush=True)
        with open(self.options.run / "log.jsonl", "a") as file:
            file.write(line + "\n")

    def part(self):
        """The share of the training that is done, from 0 to 1."""
        return self.step / self.options.steps

    def learn(self, batch, part):
        """A step of the optimizer. Returns the loss and the size of its gradient."""
        for network in (self.network, self.mean):
            network.quantize(part >= QUANTIZED_FROM or self.options.start is not None)
        rate = self.options.rate * min(1, (self.step + 1) / 300) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * part)))
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        value = loss(self.network(batch, torch.bfloat16), batch["truth"], batch["count"])
        self.optimizer.zero_grad(set_to_none=True)
        value.backward()
        parameters = list(self.network.parameters())
        gradient = torch.cat([parameter.grad.flatten() for parameter in parameters] + [value.detach()[None]])
        dist.all_reduce(gradient)
        gradient /= self.options.processes
        for parameter, of_it in zip(parameters, gradient[:-1].split([parameter.numel() for parameter in parameters])):
            parameter.grad.copy_(of_it.reshape(parameter.shape))
        norm = torch.nn.utils.clip_grad_norm_(parameters, 1.0)
        if norm.isfinite():
            self.optimizer.step()
        self.step += 1
        decay = min(0.998, self.step / (self.step + 10))
        with torch.no_grad():
            for to, of in zip(self.mean.parameters(), parameters):
                to.lerp_(of, 1 - decay)
        return float(gradient[-1]), float(norm)


def train(rank, options, training, held_back, port):
    torch.set_num_threads(1)
    # The tails of the softmax are denormal numbers, with which processors are slow.
    torch.set_flush_denormal(True)
    dist.init_process_group("gloo", init_method=f"tcp://127.0.0.1:{port}", rank=rank, world_size=options.processes)
    run = Run(options, rank)
    random = np.random.default_rng([options.seed, run.step, rank])
    last, last_evaluation, last_save = time.time(), run.elapsed, run.elapsed
    losses = []
    while (part := run.part()) < 1:
        batch = draw(training, random, options.batch // options.processes)
        value, norm = run.learn(batch, part)
        losses.append(value)
        run.elapsed, last = run.elapsed + time.time() - last, time.time()
        if rank > 0:
            continue
        if run.step % 50 == 0:
            run.report(part=round(part, 3), loss=round(float(np.mean(losses)), 4), norm=round(norm, 3))
            losses = []
        if run.elapsed - last_save > 120:
            run.save()
            last_save = run.elapsed
        if run.elapsed - last_evaluation > 600:
            run.report(held_back=evaluate(run.mean, held_back[::4])[0])
            last_evaluation = run.elapsed
    if rank == 0:
        run.save()
        results, baseline = evaluate(run.mean, held_back)
        run.report(held_back=results, baseline=baseline, final=True)
    dist.barrier()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path, help="scenes and features, as scenes.py makes them")
    parser.add_argument("--run", type=Path, required=True, help="folder for checkpoints and the log")
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--start", type=Path, help="weights in whole numbers to go on from, rather than from nothing")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    options.run.mkdir(parents=True, exist_ok=True)
    training, held_back = examples(options.folder, scenes.TRAINING), examples(options.folder, scenes.HELD_BACK)
    print(len(training), "examples,", len(held_back), "held back", flush=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # The examples are shared with the processes.
    arguments = (options, training, held_back, port)
    multiprocessing.start_processes(train, arguments, options.processes, start_method="fork")


if __name__ == "__main__":
    main()
