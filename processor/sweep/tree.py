"""Many locators on one pair of pictures: what they share is computed once.

The locators make a tree, stage by stage: those with equal stages so far share one branch, and each
stage is called once a branch (and view). It is the composition of `processor.locate`, with more
than one way at each turn.
"""

from collections.abc import Iterator, Sequence
from time import perf_counter_ns
from typing import Any

from processor.locate import Locator
from processor.trace import Seed, Sensed, Trace, ViewTrace, look_both_ways
from recorder.records import SIDES, Picture
from recorder.rectify import Rectification

Branch = tuple[int, ...]  # places of locators


def locate_all(
    locators: Sequence[Locator],
    left: Picture,
    right: Picture,
    rectification: Rectification,
    seed: Seed = (0, 0),
    sensed: Sensed = Sensed(),  # noqa: B008  # frozen
) -> Iterator[tuple[int, Trace]]:
    """Locate the apples of one pair with every locator.

    Args:
        locators: in any order.
        left: (H, W, 3) BGR uint8, as recorded.
        right: the same of the right camera.
        rectification: the rig's.
        seed: (run seed, frame).
        sensed: what other instruments saw then.

    Yields:
        (place of the locator, its trace), branch by branch; the stage times are what the stage
        took when it was called, so that they sum to what the locator would take alone.
    """
    clock = _Clock()
    recorded = zip(SIDES, (left, right), strict=True)
    pictures = [rectification.view(side).picture(picture) for side, picture in recorded]
    start = {"rectify": clock.lap()}
    everyone = tuple(range(len(locators)))
    for recognise, those in branches(locators, everyone, "recognise"):
        recognitions = [recognise(picture) for picture in pictures]
        recognised = start | {"recognise": clock.lap()}
        for clean, cleaners in branches(locators, those, "clean"):
            cleanings = [clean(recognition) for recognition in recognitions]
            cleaned = recognised | {"clean": clock.lap()}
            for circles, finders in branches(locators, cleaners, "circles"):
                looks = look_both_ways(pictures, recognitions, rectification)
                views = [
                    ViewTrace(
                        look.picture,
                        look.recognition,
                        cleaning,
                        circles(cleaning, (*seed, number), look),
                    )
                    for number, (cleaning, look) in enumerate(zip(cleanings, looks, strict=True))
                ]
                circled = cleaned | {"circles": clock.lap()}
                for match, matchers in branches(locators, finders, "match"):
                    matching = match(views[0], views[1], rectification)
                    matched = circled | {"match": clock.lap()}
                    for triangulate, leaves in branches(locators, matchers, "triangulate"):
                        apples = triangulate(views[0], views[1], matching, rectification, sensed)
                        times = matched | {"triangulate": clock.lap()}
                        for place in leaves:
                            yield place, Trace(views[0], views[1], matching, apples, times)
                        clock.lap()  # what the caller did with them is no stage's time


def branches(
    locators: Sequence[Locator], places: Branch, stage: str
) -> Iterator[tuple[Any, Branch]]:
    """The different alternatives of a stage among some locators, each with those that have it."""
    left = list(places)
    while left:
        chosen = getattr(locators[left[0]], stage)
        same = [place for place in left if getattr(locators[place], stage) == chosen]
        yield chosen, tuple(same)
        left = [place for place in left if place not in same]


class _Clock:
    def __init__(self) -> None:
        self._last = perf_counter_ns()

    def lap(self) -> int:
        """Nanoseconds since the last lap."""
        now = perf_counter_ns()
        taken, self._last = now - self._last, now
        return taken
