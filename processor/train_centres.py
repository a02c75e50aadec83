"""Train the network of centres, by JAX: one on everything, and one for each fold without it."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from threading import Event
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
BATCH: Final = 4  # of 8 the same number of rounds learns a fifth less
ROUNDS: Final = 100
RATE: Final = 4e-3  # the highest, a tenth of the way in


@dataclass(frozen=True, slots=True, eq=False)
class TaughtCentres:
    """A network, and for each fold of scenes one that never saw them; or none at all."""

    whole: CentreModel | None
    without: tuple[CentreModel | None, ...]


NO_CENTRES: Final = TaughtCentres(None, (None,) * FOLDS)


def learn_centres(
    shown: Sequence[Example], kept: Path, rounds: int = ROUNDS, say: Say = lambda _: None
) -> TaughtCentres:
    """Train on everything and on everything but each fold, as `cross_fit` does; side by side.

    A network that sees less sees it more often: one that learned less would be trusted less.

    Args:
        shown: to learn from.
        kept: a folder for networks that are done, so that a broken run goes on with the next.
        rounds: passes over all of them.
        say: called with a line now and then, from several threads.
    """
    seen = [shown, *([one for one in shown if one.fold != fold] for fold in range(FOLDS))]
    stopping = Event()

    def trained(number: int) -> CentreModel | None:
        some = seen[number]
        if number and not 0 < len(some) < len(shown):
            return None
        passes = rounds * max(1, round(len(shown) / len(some)))
        names = "\n".join([repr((LAYERS, BATCH, RATE, passes)), *(one.name for one in some)])
        file = kept / f"{sha256(names.encode()).hexdigest()[:16]}.onnx"
        if file.is_file():
            say(f"centres: {file} is done")
            return CentreModel(file.read_bytes())
        title = f"centres {number + 1} of {len(seen)}"
        made = train_centres(
            some, rounds=passes, say=lambda line: say(f"{title}, {line}"), stopping=stopping
        )
        kept.mkdir(exist_ok=True)
        with replacing(file) as part:
            part.write_bytes(made.onnx)
        return made

    with ThreadPoolExecutor(len(seen)) as pool:  # one alone leaves cores idle
        try:
            whole, *without = pool.map(trained, range(len(seen)))
        except BaseException:
            stopping.set()
            raise
    return TaughtCentres(whole, tuple(model or whole for model in without))


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
    stopping: Event | None = None,
) -> CentreModel:
    """Train by AdamW with a rate that rises, then falls along a cosine.

    Args:
        shown: to learn from.
        rounds: passes over them.
        crop_px: height and width of what a step sees of each.
        seed: of the first weights and of every turn.
        say: called with a line now and then.
        stopping: ends it at once, without a network worth keeping.

    Raises:
        PomologError: the libraries for it are not installed, or it was stopped.
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
            if stopping is not None and stopping.is_set():
                raise PomologError("training was stopped; begin it again")
            some = [order[k % len(order)] for k in range(start, start + BATCH)]
            turned = [turn(shown[k], rng, crop_px) for k in some]
            seen, wanted = (np.stack(parts) for parts in zip(*turned, strict=True))
            weights, state, loss = step(weights, state, seen, wanted)
            losses.append(float(loss))
        if number % 10 == 9 or number == rounds - 1:
            say(f"round {number + 1} of {rounds}: loss {np.mean(losses):.3f}")
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
