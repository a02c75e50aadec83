"""The locator: recognise, clean, fit circles, match, triangulate."""

from dataclasses import dataclass
from time import perf_counter_ns

from processor.circles import RandomRing
from processor.clean import AreaRule
from processor.match import AreaInOrder
from processor.recognise import ColourRatio
from processor.trace import (
    CircleFinder,
    Cleaner,
    Matcher,
    Recogniser,
    Seed,
    Sensed,
    Trace,
    Triangulator,
    ViewTrace,
    look_both_ways,
)
from processor.triangulate import Parallel
from recorder.records import SIDES, Picture
from recorder.rectify import Rectification


@dataclass(frozen=True, slots=True)
class Locator:
    """One choice for each stage; the defaults are the paper's.

    Its repr is the whole configuration. Calling it changes nothing: the same pictures and seed
    give the same trace, in any order and on any worker.
    """

    recognise: Recogniser = ColourRatio()
    clean: Cleaner = AreaRule()
    circles: CircleFinder = RandomRing()
    match: Matcher = AreaInOrder()
    triangulate: Triangulator = Parallel()

    def __call__(
        self,
        left: Picture,
        right: Picture,
        rectification: Rectification,
        seed: Seed = (0, 0),
        sensed: Sensed = Sensed(),  # noqa: B008  # frozen
    ) -> Trace:
        """Locate the apples of one stereo pair.

        Args:
            left: (H, W, 3) BGR uint8, as recorded.
            right: the same of the right camera.
            rectification: the rig's.
            seed: (run seed, frame).
            sensed: what other instruments saw then, for stages that want it.

        Returns:
            Every intermediate; its stage times sum both views.
        """
        watch = Stopwatch()
        pictures, recognitions, cleanings, views = [], [], [], []
        for side, recorded in zip(SIDES, (left, right), strict=True):
            pictures.append(rectification.view(side).picture(recorded))
            watch.lap("rectify")
            recognitions.append(self.recognise(pictures[-1]))
            watch.lap("recognise")
            cleanings.append(self.clean(recognitions[-1]))
            watch.lap("clean")
        looks = look_both_ways(pictures, recognitions, rectification)
        for number, (look, cleaning) in enumerate(zip(looks, cleanings, strict=True)):
            circles = self.circles(cleaning, (*seed, number), look)
            watch.lap("circles")
            views.append(ViewTrace(look.picture, look.recognition, cleaning, circles))
        matching = self.match(views[0], views[1], rectification)
        watch.lap("match")
        apples = self.triangulate(views[0], views[1], matching, rectification, sensed)
        watch.lap("triangulate")
        return Trace(views[0], views[1], matching, apples, watch.laps)


class Stopwatch:
    """Adds up how long each stage took, in nanoseconds."""

    def __init__(self) -> None:
        self.laps: dict[str, int] = {}
        self._last = perf_counter_ns()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap on a stage."""
        now = perf_counter_ns()
        self.laps[stage] = self.laps.get(stage, 0) + now - self._last
        self._last = now
