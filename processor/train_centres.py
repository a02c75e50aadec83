"""Train the network of centres, by JAX: one on everything, and one for each fold without it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from processor.centre_lessons import Example, turn
from processor.centre_net import LAYERS, OnArrays, first_weights, network, to_onnx
from processor.centres import CentreModel
from processor.crossfit import FOLDS
from recorder.errors import PomologError
from recorder.files import replacing

Say = Callable[[str], None]

CROP_PX: Final = (224, 288)  # height, width of what a step sees
BATCH: Final = 8
ROUNDS: Final = 40
RATE: Final = 3e-3  # the highest, a tenth of the way in


@dataclass(frozen=True, slots=True, eq=False)
class TaughtCentres:
    """A network, and for each fold of scenes one that never saw them; or none at all."""

    whole: CentreModel | None
    without: tuple[CentreModel | None, ...]


NO_CENTRES: Final = TaughtCentres(None, (None,) * FOLDS)


def learn_centres(
    shown: Sequence[Example], kept: Path, rounds: int = ROUNDS, say: Say = lambda _: None
) -> TaughtCentres:
    """Train on everything and on everything but each fold, as `cross_fit` does.

    A network that sees less sees it more often: one that learned less would be trusted less.

    Args:
        shown: to learn from.
        kept: a folder for networks that are done, so that a broken run goes on with the next.
        rounds: passes over all of them.
        say: called with a line now and then.
    """

    def trained(some: Sequence[Example]) -> CentreModel:
        passes = rounds * max(1, round(len(shown) / len(some)))
        names = "\n".join([repr(LAYERS), str(passes), *(one.name for one in some)])
        file = kept / f"{sha256(names.encode()).hexdigest()[:16]}.onnx"
        if file.is_file():
            say(f"centres: {file} is done")
            return CentreModel(file.read_bytes())
        made = train_centres(some, rounds=passes, say=say)
        kept.mkdir(exist_ok=True)
        with replacing(file) as part:
            part.write_bytes(made.onnx)
        return made

    whole = trained(shown)
    without = []
    for fold in range(FOLDS):
        others = [one for one in shown if one.fold != fold]
        without.append(trained(others) if 0 < len(others) < len(shown) else whole)
    return TaughtCentres(whole, tuple(without))


def require_trainer() -> None:
    """Say before any work that libraries are missing.

    Raises:
        PomologError: they are.
    """
    missing = [name for name in ("jax", "optax", "onnx") if find_spec(name) is None]
    if missing:
        raise PomologError(
            f"no {', '.join(missing)} here to train a network with; "
            "pip install 'pomolog[train]', or leave it out: --network-rounds 0"
        )


def train_centres(
    shown: Sequence[Example],
    *,
    rounds: int = ROUNDS,
    crop_px: tuple[int, int] = CROP_PX,
    seed: int = 0,
    say: Say = lambda _: None,
) -> CentreModel:
    """Train by AdamW with a rate that rises, then falls along a cosine.

    Args:
        shown: to learn from.
        rounds: passes over them.
        crop_px: height and width of what a step sees of each.
        seed: of the first weights and of every turn.
        say: called with a line now and then.

    Raises:
        PomologError: the libraries for it are not installed.
    """
    require_trainer()
    import jax
    import optax

    rng = np.random.default_rng(seed)
    steps = max(1, len(shown) // BATCH)
    schedule = optax.cosine_onecycle_schedule(rounds * steps, RATE, pct_start=0.1)
    optimiser = optax.chain(
        optax.clip_by_global_norm(5.0), optax.adamw(schedule, weight_decay=1e-4)
    )
    weights: Any = first_weights(seed)
    state = optimiser.init(weights)

    @jax.jit
    def step(weights: Any, state: Any, seen: Any, wanted: Any) -> tuple[Any, Any, Any]:
        loss, slopes = jax.value_and_grad(_loss)(weights, seen, wanted)
        updates, state = optimiser.update(slopes, state, weights)
        return optax.apply_updates(weights, updates), state, loss

    for number in range(rounds):
        order = rng.permutation(len(shown))
        losses = []
        for start in range(0, steps * BATCH, BATCH):
            some = [order[k % len(order)] for k in range(start, start + BATCH)]
            turned = [turn(shown[k], rng, crop_px) for k in some]
            seen, wanted = (np.stack(parts) for parts in zip(*turned, strict=True))
            weights, state, loss = step(weights, state, seen, wanted)
            losses.append(float(loss))
        if number % 10 == 9 or number == rounds - 1:
            say(f"centres, round {number + 1} of {rounds}: loss {np.mean(losses):.3f}")
    return CentreModel(to_onnx(weights, (crop_px[1], crop_px[0])))


def _loss(weights: Any, seen: Any, wanted: Any) -> Any:
    """Focal for the hills (Law & Deng 2018, alpha 2, beta 4), absolute for circles on them."""
    import jax
    import jax.numpy as jnp

    said = network(OnArrays(weights), seen)
    hill, is_centre, asked, sure = (wanted[..., k] for k in range(4))
    p = jnp.clip(jax.nn.sigmoid(said[..., 0]), 1e-4, 1 - 1e-4)
    missed = (1 - p) ** 2 * jnp.log(p) * is_centre
    false = p**2 * (1 - hill) ** 4 * jnp.log(1 - p) * (1 - is_centre) * asked
    found = -(missed + false).sum() / jnp.maximum(is_centre.sum(), 1)
    off = jnp.abs(said[..., 1:] - wanted[..., 4:]) * jnp.array([2.0, 2.0, 2.0, 0.3])
    return found + (off * sure[..., None]).sum() / jnp.maximum(sure.sum(), 1)
