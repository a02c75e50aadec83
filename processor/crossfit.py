"""Networks whose probabilities hold on pictures that they did not learn from.

Every example belongs to a fold. One network learns from everything; one more for each fold learns
from the others, answers for the fold it never saw, and so shows how sure the first may be.
"""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from processor.net import Net, train_net

FOLDS: Final = 2
BELIEVED: Final = 5.0  # examples' worth
LEAST_SLOPE: Final = 0.05  # an order is never turned round


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """What was learned.

    Attributes:
        whole: learned from every example, calibrated.
        without: for each fold the network that never saw it.
    """

    whole: Net
    without: tuple[Net, ...]


def cross_fit(
    measures: npt.NDArray[np.floating],
    wanted: npt.NDArray[np.floating],
    folds: npt.NDArray[np.integer],
    *,
    weight: npt.NDArray[np.floating] | None = None,
    **options: Any,
) -> Fitted:
    """Train on everything and on everything but each fold, and calibrate.

    A fold without examples, or all other examples in one fold, leaves that network the whole one.

    Args:
        measures: (N, F).
        wanted: (N,) in [0, 1].
        folds: (N,) each example's, below FOLDS; one scene is in one fold.
        weight: (N,) of each example; equal where absent.
        options: of `train_net`.
    """
    weights = np.ones(len(wanted)) if weight is None else weight
    whole = train_net(measures, wanted, weight=weights, **options)
    nets, held_out = [], np.full(len(wanted), np.nan)
    for fold in range(FOLDS):
        others = folds != fold
        if others.all() or not others.any():
            nets.append(whole)
            continue
        net = train_net(measures[others], wanted[others], weight=weights[others], **options)
        nets.append(net)
        held_out[~others] = net.logits(measures[~others])
    known = np.isfinite(held_out) & (weights > 0)
    if not known.any():
        return Fitted(whole, tuple(nets))
    slope, shift = calibration(held_out[known], np.asarray(wanted, float)[known], weights[known])
    return Fitted(rescaled(whole, slope, shift), tuple(rescaled(n, slope, shift) for n in nets))


def calibration(
    logits: npt.NDArray[np.floating],
    wanted: npt.NDArray[np.floating],
    weight: npt.NDArray[np.floating],
) -> tuple[float, float]:
    """Slope and shift that make logits honest (Platt 1999), of the largest likelihood.

    A little of slope 1 and shift 0 is believed beforehand, so few examples change little.
    """
    prior = np.array([1.0, 0.0])

    def loss(found: npt.NDArray[np.float64]) -> float:
        said = found[0] * logits + found[1]
        unlikely = np.logaddexp(0, said) - wanted * said
        return float((weight * unlikely).sum() + BELIEVED / 2 * ((found - prior) ** 2).sum())

    slope, shift = minimize(loss, prior, method="Nelder-Mead").x
    return max(float(slope), LEAST_SLOPE), float(shift)


def rescaled(net: Net, slope: float, shift: float) -> Net:
    """The same network, its logits stretched and moved."""
    last = np.float32(slope) * net.weights[-1]
    bias = np.float32(slope) * net.biases[-1] + np.float32(shift)
    return replace(net, weights=(*net.weights[:-1], last), biases=(*net.biases[:-1], bias))
