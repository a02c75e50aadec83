"""The golden regression: what replaying sessions/demo.mcap gave when it was last looked at.

    python -m tests.golden.update

writes demo.json anew: the frames' counts by every named method, and the apples of the paper's.
Do that only for a change that is meant, and say in its commit what moved and why.
"""

import json
import tempfile
from pathlib import Path
from typing import Any, Final

from processor.methods import METHODS
from processor.replay import Replayed, replay
from processor.results import read_table

COMMAND: Final = "python -m tests.golden.update"
REFERENCE: Final = Path(__file__).parent / "demo.json"
DEMO: Final = Path(__file__).parent.parent.parent / "sessions" / "demo.mcap"

# field -> (how far it may be from the reference, why). A field of a frame may differ by that share,
# a field of an apple by that much.
FRAME_FIELDS: Final[dict[str, tuple[float, str]]] = {
    "left_fruit": (0.0, "a count"),
    "right_fruit": (0.0, "a count"),
    "matched": (0.0, "a count"),
    "reference_px": (0.0, "the place of the largest of whole numbers"),
    "pixels_tp": (1e-4, "another JPEG decoder may round a colour on the rule's edge"),
    "pixels_fp": (1e-4, "as above"),
    "pixels_fn": (1e-4, "as above"),
    "pixels_cleaned_tp": (1e-4, "as above"),
    "pixels_cleaned_fp": (1e-4, "as above"),
    "pixels_cleaned_fn": (1e-4, "as above"),
    "fruit_tp": (0.0, "a count"),
    "fruit_fp": (0.0, "a count"),
    "fruit_fn": (0.0, "a count"),
}
APPLE_FIELDS: Final[dict[str, tuple[float, str]]] = {
    "left_x_px": (1e-4, "a circle through three whole pixels, in double precision and a 5th digit"),
    "left_y_px": (1e-4, "as above"),
    "left_radius_px": (1e-4, "as above"),
    "right_x_px": (1e-4, "as above"),
    "z_m": (1e-5, "1e-4 px of disparity at the furthest apple of the demo, and a rounded digit"),
    "left_truth": (0.0, "a name"),
    "right_truth": (0.0, "a name"),
}
DECIMALS: Final = 5  # beyond what any tolerance asks for

Golden = dict[str, Any]


def measure(folder: Path) -> Golden:
    """Replay the demo by every method; `folder` is for the results."""
    golden: Golden = {"frames": {}, "apples": []}
    for name, locator in METHODS.items():
        (done,) = replay([DEMO], folder / name, locator, method=name, rrd="none")
        assert isinstance(done, Replayed), done
        golden["frames"][name] = _rows(done.out, "frames", FRAME_FIELDS)
        if name == "paper":
            golden["apples"] = _rows(done.out, "apples", APPLE_FIELDS)
    return golden


def _rows(out: Path, table: str, fields: dict[str, Any]) -> list[list[Any]]:
    """A table's rows as lists: the frame, then the fields in their order."""
    return [
        [row["frame"], *(_rounded(row[name]) for name in fields)]
        for row in read_table(out, table).to_pylist()
    ]


def _rounded(value: Any) -> Any:
    return round(value, DECIMALS) if isinstance(value, float) else value


def read() -> Golden:
    """The reference."""
    golden: Golden = json.loads(REFERENCE.read_text(encoding="utf-8"))
    return golden


def write(golden: Golden) -> None:
    """Write the reference, a line a row, so that a change shows as the rows that changed."""
    frames = ",\n".join(
        f"{json.dumps(name)}: [\n{_lines(rows)}\n]" for name, rows in golden["frames"].items()
    )
    apples = _lines(golden["apples"])
    REFERENCE.write_text(f'{{"frames": {{\n{frames}\n}},\n"apples": [\n{apples}\n]}}\n')


def _lines(rows: list[list[Any]]) -> str:
    return ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as work:
        write(measure(Path(work)))
