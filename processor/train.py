"""Learn a model from lessons: colours first, then what circles mean fruit, then which match."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from processor.colour_table import ENTRIES, ColourModel, ColourTable, pack, read_table
from processor.count import LEAST_IOU
from processor.crossfit import FOLDS, Fitted, cross_fit
from processor.discs import LEAST_VISIBLE, disc_iou
from processor.evidence import CLAIM_MEASURES, MEASURES, Claims
from processor.fruit import FruitFinder, FruitModel, Proposals
from processor.lessons import Lesson, looks_at
from processor.net import Floats32, Net
from processor.trace import Cleaner, Floats, Look
from processor.train_centres import TaughtCentres
from recorder.records import UNCOUNTED, Labels, Picture, counted_fruit

Bytes = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]
Folds = npt.NDArray[np.int64]
Say = Callable[[str], None]

STOPS: Final = (-1.6, -0.8, 0.0, 0.8, 1.6)  # exposures that a model must stand
REAL_WEIGHT: Final = 0.3  # of a photograph's pixels: their boxes label by ellipses only
CHOICE_ROUNDS: Final = 30  # more, and the held-out half gets worse
_SHAPE: Final = (32, 64, 32)  # of a table: 5, 6 and 5 bits


def learn_colours(
    lessons: Sequence[Lesson], name: str, stops: Sequence[float] = STOPS
) -> ColourModel:
    """Count colours in fruit and elsewhere, smooth, divide; then the same for surroundings."""
    unknown = np.zeros(ENTRIES, np.uint8)
    reader = ColourTable(ColourModel(name, unknown, unknown))
    colour = _count(lessons, stops, lambda picture: pack(reader.smooth(picture)))

    def around(picture: Picture) -> npt.NDArray[np.uint16]:
        evidence = read_table(colour, pack(reader.smooth(picture)))
        return pack(reader.surroundings(evidence, picture.shape[1] / evidence.shape[1]))

    return ColourModel(name, colour, _count(lessons, stops, around))


def _count(
    lessons: Sequence[Lesson],
    stops: Sequence[float],
    entries_of: Callable[[Picture], npt.NDArray[np.uint16]],
) -> npt.NDArray[np.uint8]:
    """(65536,) 255 times the smoothed share of fruit among the pixels of each entry."""
    fruit, other = np.zeros(ENTRIES), np.zeros(ENTRIES)
    for lesson in lessons:
        weight = (REAL_WEIGHT if lesson.real else 1.0) / len(stops)
        for stop in stops:
            entries = entries_of(lesson.exposed(stop).picture)
            step = lesson.labels.shape[1] // entries.shape[1]
            labels = lesson.labels[::step, ::step][: entries.shape[0], : entries.shape[1]]
            is_fruit = counted_fruit(labels)
            is_other = labels == 0
            fruit += step**2 * weight * np.bincount(entries[is_fruit], minlength=ENTRIES)
            other += step**2 * weight * np.bincount(entries[is_other], minlength=ENTRIES)
    return _shares(fruit.reshape(_SHAPE), other.reshape(_SHAPE))


def _shares(fruit: Floats, other: Floats, prior: float = 2.0) -> npt.NDArray[np.uint8]:
    """Share of fruit from coarse to fine: where few pixels were seen the coarser share stays."""
    share = np.full(_SHAPE, fruit.sum() / max(fruit.sum() + other.sum(), 1.0))
    for width in (4.0, 2.0, 1.0, 0.5, 0.25):
        sigma = (width, 2 * width, width)  # the middle channel has a bit more
        near_fruit = gaussian_filter(fruit, sigma, mode="nearest")
        near_other = gaussian_filter(other, sigma, mode="nearest")
        share = (near_fruit + prior * share) / (near_fruit + near_other + prior)
    return np.round(share * 255).astype(np.uint8).ravel()


@dataclass(frozen=True, slots=True, eq=False)
class TaughtFruit:
    """A model, and for each fold of scenes one that never saw them."""

    model: FruitModel
    without: tuple[FruitModel, ...]


def learn_fruit(
    groups: Sequence[tuple[Lesson, ...]],
    colours: ColourModel,
    clean: Cleaner,
    centres: TaughtCentres,
    *,
    stops: Sequence[float] = (0.0, -1.0, 1.0),
    rounds: int = 3,
    seed: int = 0,
    say: Say = lambda _: None,
) -> TaughtFruit:
    """Learn which circles fit fruit, then which of them are worth choosing.

    The first network learns on voted candidates, then again on those and on refined ones. The
    second learns on what the greedy choice meets, by its own earlier decisions. Every picture is
    judged by networks that never saw its scene: they would be too sure of it.

    Args:
        groups: both views of a pair, or one picture alone.
        colours: what recognises.
        clean: how regions are made.
        centres: what sees whole neighbourhoods.
        stops: exposures of rendered lessons.
        rounds: of learning.
        seed: of every random number.
        say: called with a line now and then.
    """
    shown, looks = _looks(groups, ColourTable(colours), stops)
    cleaned = [clean(look.recognition) for look in looks]
    quality = _nobody_knows(MEASURES)
    choice = _nobody_knows(MEASURES + CLAIM_MEASURES)
    measures: list[Floats32] = []
    wanted: list[Floats] = []
    folds: list[Folds] = []
    for number in range(rounds):
        models = [
            FruitModel(colours.name, q, c, n)
            for q, c, n in zip(quality.without, choice.without, centres.without, strict=True)
        ]
        choices: list[tuple[Floats32, Floats, Flags, Folds]] = []
        for place, (lesson, look, cleaning) in enumerate(zip(shown, looks, cleaned, strict=True)):
            fold = lesson.fold
            proposals = FruitFinder(models[fold]).propose(cleaning, (seed, number, place), look)
            circles = proposals.tried[:, :3] if number == 0 else proposals.circles
            goals, counted = fit_of(circles, lesson)
            if number == 0:
                gained = proposals.tried_measures
            else:
                gained = proposals.evidence.measures
                met = _choices(proposals, lesson, models[fold].choice, number > 1)
                choices.append((*met, np.full(len(met[1]), fold)))
            measures.append(gained[counted])
            wanted.append(goals[counted])
            folds.append(np.full(int(counted.sum()), fold))
        quality = cross_fit(
            np.concatenate(measures), np.concatenate(wanted), np.concatenate(folds),
            seed=seed, hidden=(32, 16),
        )  # fmt: skip
        say(f"round {number}: {sum(map(len, wanted))} circles")
        if choices:
            x, y, w, f = (np.concatenate(parts) for parts in zip(*choices, strict=True))
            choice = cross_fit(
                x, y, f, weight=w.astype(float), seed=seed, hidden=(32, 16), rounds=CHOICE_ROUNDS
            )
            say(f"round {number}: {int(w.sum())} choices, {int(y[w].sum())} right")
    return TaughtFruit(
        FruitModel(colours.name, quality.whole, choice.whole, centres.whole),
        tuple(
            FruitModel(colours.name, q, c, n)
            for q, c, n in zip(quality.without, choice.without, centres.without, strict=True)
        ),
    )


def _looks(
    groups: Sequence[tuple[Lesson, ...]], recognise: ColourTable, stops: Sequence[float]
) -> tuple[list[Lesson], list[Look]]:
    """Every picture of the groups at every exposure, and a look at it that knows the other view."""
    lessons: list[Lesson] = []
    looks: list[Look] = []
    for group in groups:
        for stop in stops if not group[0].real else (0.0,):
            exposed = [lesson.exposed(stop) for lesson in group]
            lessons += exposed
            looks += looks_at(exposed, recognise)
    return lessons, looks


def _nobody_knows(measures: int) -> Fitted:
    """Networks that say a half of everything."""
    nothing = np.zeros(measures, np.float32)
    net = Net(nothing, nothing, (nothing[:, None],), (np.zeros(1, np.float32),))
    return Fitted(net, (net,) * FOLDS)


def fit_of(circles: Floats, lesson: Lesson) -> tuple[Floats, Flags]:
    """How well each circle fits its best disc, 0 to 1, and which circles count."""
    discs = lesson.discs[lesson.discs[:, 3] >= LEAST_VISIBLE * 0.8]
    iou = disc_iou(circles, discs[:, :3]).max(1) if len(discs) else np.zeros(len(circles))
    counted = (iou >= LEAST_IOU) | ~on_uncounted(circles, lesson.labels, lesson.real)
    return np.clip((iou - 0.2) / 0.7, 0, 1), counted


def on_uncounted(circles: Floats, labels: Labels, real: bool) -> Flags:
    """Which circles lie on fruit that counts neither way, more than on any other.

    On photographs 65535 is the doubtful ring around each box, not a fruit.
    """
    if real:
        return np.zeros(len(circles), bool)
    step = np.linspace(-0.9, 0.9, 13)
    across, down = (axis.ravel() for axis in np.meshgrid(step, step))
    keep = np.hypot(across, down) <= 0.95
    x = np.rint(circles[:, :1] + circles[:, 2:] * across[keep]).astype(int)
    y = np.rint(circles[:, 1:2] + circles[:, 2:] * down[keep]).astype(int)
    inside = (x >= 0) & (y >= 0) & (x < labels.shape[1]) & (y < labels.shape[0])
    under = labels[y.clip(0, labels.shape[0] - 1), x.clip(0, labels.shape[1] - 1)]
    uncounted = (inside & (under == UNCOUNTED)).sum(1)
    others = (inside & counted_fruit(under)).sum(1)
    return np.asarray((uncounted > others) & (uncounted >= LEAST_VISIBLE * inside.sum(1)))


def _choices(
    proposals: Proposals, lesson: Lesson, net: Net, own_decisions: bool
) -> tuple[Floats32, Floats, Flags]:
    """Measures at the moment of each decision; whether taking is right, whether it counts."""
    circles = proposals.circles
    right, doubtful = assigned(circles, lesson)
    claims = Claims.none(circles, proposals.evidence)
    count = len(circles)
    rows: list[Floats32] = []
    for place in range(count):
        now = np.array([place])
        measures = claims.measures(now, proposals.quality)
        rows.append(measures)
        taken = net(measures)[0] >= 0.5 if own_decisions else bool(right[place])
        if taken:
            claims.accept(now)
    width = CLAIM_MEASURES + MEASURES
    return (
        np.concatenate(rows) if rows else np.empty((0, width), np.float32),
        right.astype(float),
        ~doubtful,
    )


def assigned(circles: Floats, lesson: Lesson) -> tuple[Flags, Flags]:
    """Which circles, best first, find a fruit that none before found; which count neither way."""
    discs = lesson.discs
    iou = disc_iou(circles, discs[:, :3])
    iou[iou < LEAST_IOU] = 0
    right = np.zeros(len(circles), bool)
    doubtful = on_uncounted(circles, lesson.labels, lesson.real)
    for place in range(len(circles)):
        if not len(discs) or iou[place].max() <= 0:
            continue
        disc = int(iou[place].argmax())
        iou[:, disc] = 0
        known = bool(discs[disc, 3] >= LEAST_VISIBLE)
        right[place], doubtful[place] = known, not known
    return right, doubtful
