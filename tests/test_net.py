"""The small network."""

import numpy as np

from processor.net import train_net


def test_it_learns_what_no_straight_line_can_tell_apart() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (3000, 2))
    y = (x[:, 0] * x[:, 1] > 0).astype(float)
    net = train_net(x[:2000], y[:2000], hidden=(16,), rounds=60, batch=32)
    assert ((net(x[2000:]) > 0.5) == y[2000:]).mean() > 0.95


def test_its_answer_is_a_probability() -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((4000, 1))
    net = train_net(x, (rng.random(4000) < 0.3).astype(float), hidden=(8,), rounds=20)
    assert abs(float(net(x).mean()) - 0.3) < 0.03


def test_the_same_seed_learns_the_same() -> None:
    x = np.random.default_rng(2).standard_normal((300, 3))
    one, two = (train_net(x, (x[:, 0] > 0).astype(float), rounds=3) for _ in range(2))
    np.testing.assert_array_equal(one(x), two(x))


def test_examples_without_weight_teach_nothing() -> None:
    x = np.concatenate([np.zeros((300, 1)), np.ones((300, 1))])
    y = np.concatenate([np.zeros(300), np.ones(300)])
    net = train_net(x, 1 - y, weight=np.zeros(600), rounds=2)
    start = train_net(x, y, weight=np.zeros(600), rounds=2)
    np.testing.assert_array_equal(net(x), start(x))
