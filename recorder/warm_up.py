"""The first pictures of a camera: make sure that it is the rig's, and learn its clock."""

import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from recorder.cameras import Camera, Shot
from recorder.errors import PomologError
from recorder.plan import Plan
from recorder.records import Side
from recorder.timeline import Timeline

FIRST_SHOT_S: Final = 5.0  # a camera may take this long to begin


def settle(plan: Plan, cameras: Mapping[Side, Camera], timelines: Mapping[str, Timeline]) -> None:
    """Take frames that will not be kept until both cameras' clocks are known, or a camera is gone.

    Neither camera's frames may wait for the other's clock: a driver soon has no room for more.
    """
    until_s = time.monotonic() + FIRST_SHOT_S
    unsettled = set(cameras)

    def take(side: Side) -> None:
        while unsettled and time.monotonic() < until_s:
            try:
                if plan.equipment.cameras[side].trigger == "software":
                    cameras[side].trigger()
                shot = cameras[side].next_shot(0.5)
            except PomologError:
                break  # the recording's own watchdog opens it anew
            if shot is not None and timelines[side].note(shot):
                unsettled.discard(side)
        unsettled.discard(side)

    with ThreadPoolExecutor(len(cameras)) as pool:
        list(pool.map(take, cameras))


def first_shot(plan: Plan, cameras: Mapping[Side, Camera], side: Side) -> Shot:
    """Wait until a camera delivers, and make sure that it is the rig's.

    Raises:
        PomologError: nothing comes, or pictures of another size.
    """
    settings, camera = plan.equipment.cameras[side], cameras[side]
    until_s = time.monotonic() + FIRST_SHOT_S
    size_px = plan.rig.camera(side).size_px
    while time.monotonic() < until_s:
        if settings.trigger == "software":
            camera.trigger()
        shot = camera.next_shot(0.5)
        if shot is None or not shot.complete:
            continue
        if shot.size_px != size_px:
            raise PomologError(
                f"the {side} camera gives {shot.size_px[0]} x {shot.size_px[1]} px, the rig's "
                f"calibration is of {size_px[0]} x {size_px[1]}; set region_px, or calibrate again"
            )
        return shot
    raise PomologError(
        f"the {side} camera {settings.device} opens but sends no picture; packets too large for "
        "the network, a firewall, or a trigger that never comes?"
    )
