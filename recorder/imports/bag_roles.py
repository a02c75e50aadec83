"""Which topic of a bag is what: a guess from names and first messages, which flags overrule."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from recorder.errors import PomologError
from recorder.imports.bag import Bag, Topic
from recorder.imports.bag_messages import BagImage, BagRange, decode
from recorder.imports.bag_ours import our_topics
from recorder.imports.bag_pictures import COLOURS, is_depth, picture_size_px
from recorder.mcap_records import reporting_damage

# how the names of two cameras differ; the first that fits counts
_PAIRS: Final = (
    ("left", "right"), ("infra1", "infra2"), ("cam0", "cam1"), ("cam1", "cam2"),
    ("camera0", "camera1"), ("camera1", "camera2"), ("camera_0", "camera_1"),
    ("camera_1", "camera_2"), ("/l/", "/r/"), ("_l/", "_r/"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Roles:
    """The topic of each role; None: there is none."""

    left: str | None = None
    right: str | None = None
    left_info: str | None = None
    right_info: str | None = None
    range: str | None = None
    depth: str | None = None

    def items(self) -> Iterator[tuple[str, str]]:
        """The roles that have a topic, as the flags name them."""
        for role in ("left", "right", "left_info", "right_info", "range", "depth"):
            topic = getattr(self, role)
            if topic is not None:
                yield role.replace("_", "-"), topic


@dataclass(frozen=True, slots=True)
class _Camera:
    """A topic of pictures and what its first one is like."""

    topic: Topic
    first: BagImage
    size_px: tuple[int, int]

    @property
    def depth(self) -> bool:
        return is_depth(self.first)

    @property
    def worth(self) -> tuple[int, int, int, int]:
        """The greater, the likelier to be the one that is meant."""
        raw = self.first.size_px is not None
        colour = not raw or self.first.encoding in COLOURS
        return self.topic.count, colour, raw, -len(self.topic.name)


def assign_roles(bag: Bag, wanted: Mapping[str, str]) -> Roles:
    """Guess the topics' roles, and let the wanted ones stand as they are.

    Args:
        bag: the bag.
        wanted: role ("left", "right", "left_info", ...) -> topic; "-" says that it has none.

    Raises:
        PomologError: a wanted topic is not there or holds something else, or no guess is sound.
    """
    _require(bag, wanted)
    ours = our_topics(bag)  # label pictures among them
    cameras = {
        topic.name: _camera(bag, topic)
        for topic in bag.of_kind("image", "compressed")
        if topic.name not in ours
    }
    views = sorted(
        (c for c in cameras.values() if not c.depth), key=lambda c: c.worth, reverse=True
    )
    if not cameras:
        raise PomologError(f"no camera topics in {bag.path}; {bag.listing()}")
    said = {role: None if topic == "-" else topic for role, topic in wanted.items()}
    if "left" in said:
        left, right = said["left"], said.get("right")
    elif "right" in said:
        raise PomologError("--right needs --left too; give both topics")
    else:
        left, right = _guess_views(bag, views, [c for c in cameras.values() if c.depth])
        right = said.get("right", right)
    roles = Roles(left, right)
    roles = replace(roles, left_info=_info(bag, left), right_info=_info(bag, right))
    roles = replace(roles, depth=_guess_depth(cameras, left), range=_guess_range(bag))
    return replace(roles, **{role: topic for role, topic in said.items() if role != "left"})


def _require(bag: Bag, wanted: Mapping[str, str]) -> None:
    """Hold the topics that flags name against what is there."""
    kinds: dict[str, tuple[str, ...]] = {
        "left": ("image", "compressed"), "right": ("image", "compressed"),
        "depth": ("image", "compressed"), "range": ("range", "scan"),
        "left_info": ("calibration",), "right_info": ("calibration",),
    }  # fmt: skip
    for role, name in wanted.items():
        if name == "-" and role != "left":
            continue
        flag = role.replace("_", "-")
        topic = bag.topics.get(name)
        if topic is None or not topic.count:
            raise PomologError(f"--{flag}: no messages of {name} in {bag.path}; {bag.listing()}")
        if topic.kind not in kinds[role]:
            raise PomologError(
                f"--{flag}: {name} holds {topic.schema or 'no schema'} ({topic.encoding}), "
                f"which cannot be read as that; {bag.listing()}"
            )
    given = [name for name in wanted.values() if name != "-"]
    if len(set(given)) < len(given):
        raise PomologError("two flags name one topic; each topic has one role")


def first_message(bag: Bag, topic: Topic) -> Any:
    """A topic's first message, decoded.

    Raises:
        PomologError: it is damaged.
    """
    message = bag.first(topic.name)
    if message is None:
        raise PomologError(
            f"{bag.path} is damaged (no messages of {topic.name}, but counted); copy it again"
        )
    with reporting_damage(bag.path, f"the first message of {topic.name}", "record it again"):
        return decode(topic, message)


def _camera(bag: Bag, topic: Topic) -> _Camera:
    first = first_message(bag, topic)
    return _Camera(topic, first, picture_size_px(first, topic.name))


def _guess_views(
    bag: Bag, views: Sequence[_Camera], depths: Sequence[_Camera]
) -> tuple[str, str | None]:
    """Left and right of a pair in colour, else the colour beside depth, else any pair or one."""
    named = {c.topic.name: c for c in views}
    pairs = []
    for camera in views:
        for one, other in _PAIRS:
            name = camera.topic.name
            partner = re.sub(rf"{one}(?![0-9])", other, name) if one in name else name
            if partner != name and partner in named:
                pairs.append((camera, named[partner]))
                break
    colour = [c for c in views if c.worth[1]]
    coloured = [pair for pair in pairs if pair[0].worth[1] and pair[1].worth[1]]
    if coloured:
        return coloured[0][0].topic.name, coloured[0][1].topic.name
    if depths and colour:
        return colour[0].topic.name, None
    if pairs:
        return pairs[0][0].topic.name, pairs[0][1].topic.name
    if len(views) == 1:
        return views[0].topic.name, None
    if not views:
        raise PomologError(f"only depth and no pictures in {bag.path}; {bag.listing()}")
    names = ", ".join(c.topic.name for c in views)
    raise PomologError(
        f"which of {names} is the left view, which the right? say --left TOPIC --right TOPIC "
        "(one view: --left TOPIC alone)"
    )


def _guess_depth(cameras: Mapping[str, _Camera], left: str | None) -> str | None:
    """Depth of the left picture's size and, if the messages say one, of its frame."""
    if left is None or left not in cameras:
        return None
    view = cameras[left]
    aligned = [
        c for c in cameras.values()
        if c.depth
        and c.topic.name != left
        and c.size_px == view.size_px
        and c.first.stamp.frame_id in ("", view.first.stamp.frame_id)
    ]  # fmt: skip
    best = max(aligned, key=lambda c: c.worth, default=None)
    return best.topic.name if best else None


def _guess_range(bag: Bag) -> str | None:
    """The only rangefinder; of several nobody can know which is meant."""
    found = [topic.name for topic in bag.of_kind("range")]
    for topic in bag.of_kind("scan"):
        try:
            first = first_message(bag, topic)
        except PomologError:
            continue  # of many beams; --range says why it cannot be read
        found += [topic.name] if isinstance(first, BagRange) else []
    return found[0] if len(found) == 1 else None


def _info(bag: Bag, image: str | None) -> str | None:
    """The calibration beside a picture's topic: the longest common way to it."""
    if image is None:
        return None
    folder = image.rsplit("/", 1)[0]
    beside = [t.name for t in bag.of_kind("calibration")]
    for _ in range(3):  # image_raw/compressed lies one deeper than camera_info
        found = [name for name in beside if name.rsplit("/", 1)[0] == folder]
        if len(found) == 1:
            return found[0]
        if "/" not in folder.strip("/"):
            break
        folder = folder.rsplit("/", 1)[0]
    return None
