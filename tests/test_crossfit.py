"""Networks that are as sure as they may be."""

import numpy as np
import pytest

from processor.crossfit import calibration, cross_fit, rescaled
from processor.net import train_net

RNG = np.random.default_rng(0)
X = RNG.standard_normal((2000, 2))
TRUTH = 1 / (1 + np.exp(-2 * X[:, 0]))
Y = (RNG.random(2000) < TRUTH).astype(float)


def test_boasting_logits_are_brought_down_to_what_they_are_worth() -> None:
    honest = 2 * X[:, 0]
    slope, shift = calibration(3 * honest + 1, Y, np.ones(len(Y)))
    assert slope == pytest.approx(1 / 3, abs=0.05)
    assert shift == pytest.approx(-1 / 3, abs=0.15)


def test_a_rescaled_networks_log_odds_are_stretched_and_moved() -> None:
    net = train_net(X, Y, rounds=2)
    np.testing.assert_allclose(
        rescaled(net, 0.5, 1.0).logits(X), 0.5 * net.logits(X) + 1, atol=1e-5
    )


def test_each_folds_network_never_saw_it() -> None:
    folds = np.arange(len(Y)) % 2
    lied = np.where(folds == 0, 1 - Y, Y)  # fold 0 teaches the opposite
    fitted = cross_fit(X, lied, folds, hidden=(8,), rounds=20, batch=32)
    first, second = (np.corrcoef(net.logits(X), X[:, 0])[0, 1] for net in fitted.without)
    assert first > 0.7  # learned from fold 1
    assert second < -0.7


def test_one_fold_alone_is_answered_by_the_whole() -> None:
    fitted = cross_fit(X, Y, np.zeros(len(Y), int), hidden=(8,), rounds=2)
    assert [net is fitted.whole for net in fitted.without] == [True, True]


def test_an_overfitted_network_is_calibrated_by_what_it_did_not_see() -> None:
    few, folds = slice(0, 200), np.arange(200) % 2
    fitted = cross_fit(X[few], Y[few], folds, hidden=(32, 16), rounds=150, batch=20)
    plain = train_net(X[few], Y[few], hidden=(32, 16), rounds=150, batch=20)
    unseen = slice(1000, 2000)

    def loss(net) -> float:  # type: ignore[no-untyped-def]
        said = np.clip(net(X[unseen]).astype(float), 1e-6, 1 - 1e-6)
        return float(-(Y[unseen] * np.log(said) + (1 - Y[unseen]) * np.log(1 - said)).mean())

    assert loss(fitted.whole) < loss(plain)
