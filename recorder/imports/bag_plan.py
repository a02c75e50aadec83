"""What is decided of a bag before its first frame is written: its rig, its clock, what is told."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

from recorder.errors import PomologError
from recorder.imports.bag import Bag
from recorder.imports.bag_messages import BagImage, BagRange, BagTransform, decode
from recorder.imports.bag_pictures import picture_size_px
from recorder.imports.bag_rig import Frames, single_rig, stereo_rig, with_rangefinder
from recorder.imports.bag_roles import Roles, first_message
from recorder.mcap_records import reporting_damage
from recorder.one_view import NOMINAL, ONE_VIEW, nominal_camera, one_view_rig
from recorder.profile import PROFILE
from recorder.rig import USUAL_STD_M, Rig

Times = Literal["header", "arrival"]

AGAIN: Final = "mcap doctor {path}"  # which says what is wrong with it
_CLOCKS_AGREE_NS: Final = 10_000_000_000  # headers that lag more apart are of several clocks
_WRITTEN_ANEW: Final = frozenset(("profile", "images", "rig", "rangefinder_std_m", "crc32"))
_TRANSFORMS: Final = 10_000  # beyond so many, frames move; the first of each child are long there


@dataclass(frozen=True, slots=True, eq=False)
class ImportPlan:
    """How a bag becomes a session.

    Attributes:
        bag: what is imported.
        roles: the topic of each role.
        rig: of the session.
        times: of the headers, or of arrival.
        offsets_ns: role -> what is added to its times.
        metadata: of the session.
        raw: its frames are raw instead of compressed.
        remarks: what a user should know of all this, a sentence each.
    """

    bag: Bag
    roles: Roles
    rig: Rig
    times: Times
    offsets_ns: Mapping[str, int]
    metadata: Mapping[str, str]
    raw: bool
    remarks: tuple[str, ...]


def plan_import(
    bag: Bag,
    roles: Roles,
    rig: Rig | None,
    times: Times | None,
    offsets_ns: Mapping[str, int],
    tolerance_ns: int | None,
    metadata: Mapping[str, str],
) -> ImportPlan:
    """Decide how a bag becomes a session; the arguments are those of `import_bag`.

    Raises:
        PomologError: an offset of nothing that was chosen, no rig, or a damaged first message.
    """
    for role in offsets_ns:
        if role == "left" or getattr(roles, role, None) is None:
            raise PomologError(
                f"--offset {role}: right, range or depth can be shifted, if chosen; leave it out"
            )
    remarks: list[str] = []
    before = {k: v for k, v in bag.metadata.items() if k not in _WRITTEN_ANEW}
    about = {"made_by": "import bag", **before, **metadata}
    if roles.right is None:
        about |= ONE_VIEW
    if tolerance_ns is not None:
        about["max_skew_ns"] = str(tolerance_ns)
    found = rig or _bag_rig(bag, roles, remarks, about)
    if rig and roles.range and rig.rangefinder is None:
        remarks.append("readings are kept, but the given rig has no [rangefinder] to place them")
    raw = _first_image(bag, roles.left).size_px is not None
    clock = times or _clock(bag, roles, remarks)
    return ImportPlan(bag, roles, found, clock, offsets_ns, about, raw, tuple(remarks))


def _first_image(bag: Bag, topic: str | None) -> BagImage:
    assert topic is not None
    image = first_message(bag, bag.topics[topic])
    assert isinstance(image, BagImage)
    return image


def _bag_rig(bag: Bag, roles: Roles, remarks: list[str], about: dict[str, str]) -> Rig:
    """The rig of the bag's calibrations and transforms."""
    frames = Frames(_transforms(bag))
    ours = bag.metadata.get("profile") == PROFILE
    rectified = "image_rect" in (roles.left or "")  # image_proc's names
    left, right = (
        first_message(bag, bag.topics[name]) if name else None
        for name in (roles.left_info, roles.right_info)
    )
    if roles.right is None:
        if left is None:
            size_px = picture_size_px(_first_image(bag, roles.left), roles.left or "")
            about |= NOMINAL
            remarks.append("no calibration of the left camera: a nominal one is kept; or --rig")
            rig = one_view_rig(nominal_camera(size_px))
        else:
            rig = single_rig(left, rectified=rectified)
    elif left is None or right is None:
        side = "left" if left is None else "right"
        raise PomologError(
            f"no calibration of the {side} camera in {bag.path}; give its topic with "
            f"--{side}-info, or a calibration with --rig"
        )
    else:
        rig = stereo_rig(left, right, frames, rectified=rectified, transforms_first=ours)
    if roles.range is None:
        return rig
    left_frame = left.stamp.frame_id if left else ""
    beam: BagRange = first_message(bag, bag.topics[roles.range])
    pose = frames.pose(beam.stamp.frame_id, left_frame)
    if pose is None:
        remarks.append(
            f"no transform from {left_frame or 'the left camera'} to {beam.stamp.frame_id!r}: "
            "readings are kept, but where their beam is nobody knows; give --rig with [rangefinder]"
        )
        return rig
    std_m = float(bag.metadata.get("rangefinder_std_m", USUAL_STD_M))
    return with_rangefinder(rig, pose, beam.direction, std_m)


def _transforms(bag: Bag) -> list[BagTransform]:
    found: list[BagTransform] = []
    names = {
        t.name: t for t in bag.of_kind("transforms")
        if t.encoding != "cdr" or t.name.endswith("tf_static")
    }  # fmt: skip
    with reporting_damage(bag.path, "its transforms", AGAIN):
        for message in bag.messages(tuple(names)):
            found += decode(names[message.topic], message)
            if len(found) > _TRANSFORMS:
                break
    return found


def _clock(bag: Bag, roles: Roles, remarks: list[str]) -> Times:
    """The headers' times, unless one has none or they are of several clocks."""
    lags: dict[str, int] = {}
    for role, name in roles.items():
        if role.endswith("-info"):
            continue
        stamp_ns = first_message(bag, bag.topics[name]).stamp.time_ns
        message = bag.first(name)
        assert message is not None
        if stamp_ns == 0 and message.log_ns != 0:
            remarks.append(f"times of arrival: {name} has none in its headers")
            return "arrival"
        lags[name] = message.log_ns - stamp_ns
    if max(lags.values()) - min(lags.values()) > _CLOCKS_AGREE_NS:
        apart_s = (max(lags.values()) - min(lags.values())) / 1e9
        remarks.append(f"times of arrival: the headers' clocks are {apart_s:.0f} s apart")
        return "arrival"
    return "header"
