"""Train a whole model from sessions and boxes, and say where it comes from."""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from shutil import rmtree
from typing import Any, Final

from processor.centre_lessons import examples
from processor.clean import SizeFloor
from processor.colour_table import ColourTable
from processor.lessons import Lesson, boxed, lesson_pairs
from processor.model_file import Model, save_model
from processor.train import learn_colours, learn_fruit
from processor.train_centres import (
    NO_CENTRES,
    ROUNDS,
    learn_centres,
    require_trainer,
)
from processor.train_pairs import learn_matches, learn_range, see
from recorder.errors import PomologError
from recorder.session import Session

Say = Callable[[str], None]

LIBRARIES: Final = ("pomolog", "numpy", "opencv-python-headless", "jax", "optax")


def teach(
    sessions: Sequence[Path],
    boxes: Path | None,
    out: Path,
    *,
    network_rounds: int = ROUNDS,
    say: Say = lambda _: None,
) -> Model:
    """Learn from the labelled pairs of sessions, and from the training half of boxed photographs.

    Args:
        sessions: with labels and apples, of the training split.
        boxes: a folder with images/ and labels/ (YOLO), or None.
        out: the model's .npz; a .json with its provenance is written beside it. Until then
            networks that are trained already stay in a folder beside it.
        network_rounds: passes over the pictures to train the network of centres; 0 leaves it out.
        say: called with a line now and then.

    Raises:
        PomologError: nothing to learn from, a session of the test split, or no library to train a
            network with.
    """
    if out.suffix != ".npz":
        raise PomologError(f"{out}: a model's name ends in .npz; give such a name")
    if network_rounds:
        require_trainer()
    provenance = [_provenance(path) for path in sessions]
    pairs = list(lesson_pairs(sessions))
    photographs = boxed(boxes, "train") if boxes else []
    halves = [(left.halved(), right.halved()) for left, right in pairs]
    lessons: list[Lesson] = [view for pair in pairs + halves for view in pair] + photographs
    say(f"{len(pairs)} pairs and {len(photographs)} photographs")
    name, kept = out.stem, out.with_suffix(".networks")
    colours = learn_colours(lessons, name)
    groups = [*pairs, *halves, *((photograph,) for photograph in photographs)]
    centres = NO_CENTRES
    if network_rounds:
        whole = [*pairs, *((photograph,) for photograph in photographs)]
        shown = examples(whole, ColourTable(colours))
        centres = learn_centres(shown, kept, network_rounds, say)
    fruit = learn_fruit(groups, colours, SizeFloor(), centres, say=say)
    seen = see(pairs, colours, fruit.without) + see(halves, colours, fruit.without, (0.0,))
    model = Model(
        name, colours, fruit.model, learn_matches(seen, name, say), learn_range(seen, name, say)
    )
    about: dict[str, Any] = {
        "made_by": "pomolog train",
        "sessions": provenance,
        "photographs": {"folder": boxes.name, "count": len(photographs)} if boxes else None,
        "network_rounds": network_rounds,
        "versions": {n: version(n) for n in LIBRARIES[: None if network_rounds else 3]},
    }
    save_model(model, out, about)
    rmtree(kept, ignore_errors=True)  # they are in the model now
    return model


def _provenance(path: Path) -> dict[str, Any]:
    with Session(path) as session:
        split = session.metadata.get("split")
        if split in ("test", "both"):
            whole = "of the test split" if split == "test" else "partly of the test split"
            raise PomologError(
                f"{path} is {whole}; train on the train split: pomolog simulate --split train"
            )
        said = {
            k: session.metadata.get(k) for k in ("scene", "seed", "split", "lighting", "cultivar")
        }
        return {
            "file": path.name,
            "fingerprint": session.fingerprint,
            "pairs": len(session),
            **said,
        }
