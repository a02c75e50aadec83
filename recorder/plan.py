"""What is to be recorded: put together from a rig.toml and what the operator said."""

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from recorder.equipment import Equipment, load_equipment
from recorder.rig import Rig, load_rig
from recorder.segment import Split


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What to record: where, with what, and what is known of it beforehand."""

    folder: Path
    name: str
    rig: Rig
    equipment: Equipment
    metadata: Mapping[str, str]
    split: Split | None = None


def make_plan(
    rig: Path, folder: Path, *, name: str = "", split: str = "", about: Mapping[str, str]
) -> Plan:
    """Put a plan together from what the operator said.

    Args:
        rig: a rig.toml with cameras.
        folder: for the files.
        name: of the recording; the date and time (UTC) if empty.
        split: when to go on in a new file, like 5min or 500MB; never if empty.
        about: lighting, cultivar, site; empty values are left out.

    Raises:
        PomologError: no such rig, or a value that cannot be.
    """
    equipment = load_equipment(rig)
    metadata = {key: value for key, value in about.items() if value}
    metadata |= {"made_by": "record", "equipment": json.dumps(asdict(equipment))}
    return Plan(
        folder=folder,
        name=name or time.strftime("%Y-%m-%dT%H-%M-%SZ", time.gmtime()),
        rig=load_rig(rig),
        equipment=equipment,
        metadata=metadata,
        split=Split.parse(split) if split else None,
    )
