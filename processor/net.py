"""A small network of a few hundred weights: what turns measures of a circle into a probability."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

Floats32 = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Net:
    """Fully connected layers, rectified between them, a logistic function at the end.

    Attributes:
        mean: (F,) of the measures that it was trained on.
        scale: (F,) one over their standard deviation.
        weights: (F, a), (a, b), ... (z, 1).
        biases: (a,), (b,), ... (1,).
    """

    mean: Floats32
    scale: Floats32
    weights: tuple[Floats32, ...]
    biases: tuple[Floats32, ...]

    def __call__(self, measures: npt.NDArray[np.floating]) -> Floats32:
        """(N, F) measures -> (N,) probabilities."""
        return np.asarray(1 / (1 + np.exp(-self.logits(measures))), np.float32)

    def logits(self, measures: npt.NDArray[np.floating]) -> Floats32:
        """(N, F) measures -> (N,) log odds, within 30 of even."""
        signal = (measures.astype(np.float32) - self.mean) * self.scale
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            signal = np.maximum(signal @ weight + bias, 0)
        return np.clip((signal @ self.weights[-1] + self.biases[-1])[:, 0], -30, 30)


def train_net(
    measures: npt.NDArray[np.floating],
    wanted: npt.NDArray[np.floating],
    *,
    weight: npt.NDArray[np.floating] | None = None,
    hidden: tuple[int, ...] = (24, 12),
    rounds: int = 30,
    seed: int = 0,
    rate: float = 3e-3,
    batch: int = 256,
) -> Net:
    """Train by Adam on cross-entropy; the rate falls to zero along a cosine.

    Args:
        measures: (N, F).
        wanted: (N,) in [0, 1].
        weight: (N,) of each example; equal where absent.
        hidden: sizes of the layers between.
        rounds: passes over the examples.
        seed: of the first weights and of the order.
        rate: Adam's, at the beginning.
        batch: examples a step.
    """
    rng = np.random.default_rng(seed)
    mean = measures.mean(0).astype(np.float32)
    scale = (1 / (measures.std(0) + 1e-6)).astype(np.float32)
    x = (measures.astype(np.float32) - mean) * scale
    y = wanted.astype(np.float32)
    w = np.ones_like(y) if weight is None else weight.astype(np.float32)
    sizes = [x.shape[1], *hidden, 1]
    layers = [
        (rng.standard_normal((a, b)).astype(np.float32) * np.float32(np.sqrt(2 / a)),
         np.zeros(b, np.float32))
        for a, b in pairwise(sizes)
    ]  # fmt: skip
    parameters = [p for layer in layers for p in layer]
    first = [np.zeros_like(p) for p in parameters]
    second = [np.zeros_like(p) for p in parameters]
    batch = min(batch, len(y))
    starts = range(0, len(y) - batch + 1, batch)
    steps, step = rounds * len(starts), 0
    for _ in range(rounds):
        order = rng.permutation(len(y))
        for start in starts:
            step += 1
            some = order[start : start + batch]
            gradients = _gradients(layers, x[some], y[some], w[some])
            now = rate / 2 * (1 + np.cos(np.pi * step / steps))
            for value, slope, m, v in zip(parameters, gradients, first, second, strict=True):
                np.add(m, 0.1 * (slope - m), out=m)
                np.add(v, 0.001 * (slope * slope - v), out=v)
                mean_slope, mean_square = m / (1 - 0.9**step), v / (1 - 0.999**step)
                np.subtract(
                    value, np.float32(now) * mean_slope / (np.sqrt(mean_square) + 1e-8), out=value,
                    casting="same_kind",
                )  # fmt: skip
    return Net(mean, scale, tuple(a for a, _ in layers), tuple(b for _, b in layers))


def _gradients(
    layers: list[tuple[Floats32, Floats32]], x: Floats32, y: Floats32, w: Floats32
) -> list[Floats32]:
    signals = [x]
    for weight, bias in layers[:-1]:
        signals.append(np.maximum(signals[-1] @ weight + bias, 0))
    logit = np.clip(signals[-1] @ layers[-1][0] + layers[-1][1], -30, 30)[:, 0]
    back = ((1 / (1 + np.exp(-logit)) - y) * w / len(y))[:, None].astype(np.float32)
    gradients: list[Floats32] = []
    for number in range(len(layers) - 1, -1, -1):
        weight = layers[number][0]
        gradients = [signals[number].T @ back + 1e-5 * weight, back.sum(0), *gradients]
        if number:
            back = (back @ weight.T) * (signals[number] > 0)
    return gradients
