"""Make the sample sessions of the digital orchard again, and hold their truth against the manifest.

Run `make sessions`. Pictures may differ in a few bits between machines; truth may not: it is held
by its hash, and where a hash differs, label by label and centre by centre.
"""

import argparse
import hashlib
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from recorder.errors import PomologError
from recorder.orchard.scene import Split, load_scene, shots
from recorder.orchard.simulate import simulate
from recorder.pictures import decode
from recorder.records import Labels
from recorder.session import Session

HERE: Final = Path(__file__).parent
MANIFEST: Final = HERE / "manifest.json"
CONTACT: Final = HERE / "contact.jpg"
LABELS_MAY_DIFFER: Final = 1e-4  # of a session's pixels: rays that graze an edge
CENTRES_MAY_DIFFER_M: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Sample:
    """A session: so many worlds (of a motion: pairs) of a set, of one split."""

    scene: str
    worlds: int
    split: Split = "both"

    @property
    def name(self) -> str:
        """Of its file, without the ending."""
        return self.scene if self.split == "both" else f"{self.scene}-{self.split}"


SAMPLES: Final = (
    Sample("segmentation-front", 2, "test"),
    Sample("segmentation-back", 2, "test"),
    Sample("segmentation-cloudy", 2, "test"),
    Sample("row", 4),
    Sample("cultivar-fuji", 1),
    Sample("cultivar-dark-red", 1),
    Sample("cultivar-gala", 1),
    Sample("cultivar-granny-smith", 1),
    Sample("cultivar-golden-delicious", 1),
    Sample("cultivar-unripe", 1),
    Sample("exposure-front", 1),
    Sample("distance-indoor-clear", 6),
    Sample("matching-front", 1, "test"),
    Sample("matching-back", 1, "test"),
    Sample("matching-cloudy", 1, "test"),
    Sample("distance-outdoor-front", 2),
    Sample("distance-indoor-leaves", 3),
    Sample("distance-indoor-fruit", 2),
    Sample("distance-outdoor-back", 2),
)


def make(sample: Sample, out: Path, cache: Path) -> None:
    """Render one sample; what `cache` has already is not rendered again."""
    scene = load_scene(Path(sample.scene))
    whole = shots(scene, split=sample.split)
    worlds = scene.motion.pairs if scene.motion else len({shot.seed for shot in whole})
    simulate(scene, shots(scene, sample.worlds / worlds, sample.split), out, cache=cache)


def describe(sample: Sample, path: Path) -> dict[str, Any]:
    """The manifest's entry of a made session."""
    with Session(path) as session:
        about = session.metadata
        entry = {
            "scene": sample.scene,
            "split": about["split"],
            "pairs": len(session),
            "seed": int(about["seed"]),
            "scene_hash": about["scene_hash"],
            "lighting": about["lighting"],
            "cultivar": about["cultivar"],
        }
    entry["bytes"] = path.stat().st_size
    entry["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    entry["truth_sha256"] = truth_hash(path)
    return entry


def truth_hash(path: Path) -> str:
    """Of every label, and of every apple to a micrometre."""
    digest = hashlib.sha256()
    with Session(path) as session:
        for pair in session.pairs():
            assert pair.truth is not None
            for labels in (pair.truth.left, pair.truth.right):
                digest.update(np.ascontiguousarray(labels, "<u2").tobytes())
            for apple in pair.truth.apples or ():
                rounded = [round(value * 1e6) for value in (*apple.centre_m, apple.radius_m)]
                digest.update(json.dumps([apple.id, *rounded]).encode())
    return digest.hexdigest()


def truth_differs(one: Path, other: Path) -> str | None:
    """What of the truth of two sessions differs by more than it may; None: nothing."""
    pixels = differing = 0
    with Session(one) as a, Session(other) as b:
        if len(a) != len(b):
            return f"{len(a)} pairs instead of {len(b)}"
        for ours, theirs in zip(a.pairs(), b.pairs(), strict=True):
            assert ours.truth is not None
            assert theirs.truth is not None
            for x, y in ((ours.truth.left, theirs.truth.left),
                         (ours.truth.right, theirs.truth.right)):  # fmt: skip
                pixels += np.asarray(x).size
                differing += _count_differing(x, y)
            known = {apple.id: apple.centre_m for apple in theirs.truth.apples or ()}
            for apple in ours.truth.apples or ():
                centre_m = known.get(apple.id, (np.inf,) * 3)
                if np.abs(np.subtract(apple.centre_m, centre_m)).max() > CENTRES_MAY_DIFFER_M:
                    return f"apple {apple.id} of pair {ours.index} is elsewhere"
    share = differing / max(pixels, 1)
    return f"{share:.2%} of all labels" if share > LABELS_MAY_DIFFER else None


def _count_differing(x: Labels | None, y: Labels | None) -> int:
    return int((np.asarray(x) != np.asarray(y)).sum())


def contact_sheet(samples: list[Sample]) -> None:
    """One small picture of the first left view of every session."""
    tiles = []
    for sample in samples:
        with Session(HERE / f"{sample.name}.mcap") as session:
            pair = next(session.pairs(stop=1))
            tile = cv2.resize(decode(pair.left), (320, 256), interpolation=cv2.INTER_AREA)
        cv2.putText(tile, sample.name, (6, 248), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3)
        cv2.putText(tile, sample.name, (6, 248), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255,) * 3, 1)
        tiles.append(tile)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 5)
    rows = [np.hstack(tiles[i : i + 5]) for i in range(0, len(tiles), 5)]
    cv2.imwrite(str(CONTACT), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, 85])


def main() -> int:
    """Make what is asked for; 1 where a session's truth is not what the manifest says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="only these sessions")
    parser.add_argument("--write", action="store_true", help="replace sessions and manifest")
    parser.add_argument("--cache", type=Path, default=HERE.parent / "results" / "orchard-cache")
    parser.add_argument("--out", type=Path, default=HERE.parent / "results" / "sessions")
    asked = parser.parse_args()
    manifest = json.loads(MANIFEST.read_text()) if MANIFEST.is_file() else {}
    chosen = [s for s in SAMPLES if not asked.names or s.name in asked.names]
    faults = 0
    for sample in chosen:
        committed = HERE / f"{sample.name}.mcap"
        path = committed if asked.write else asked.out / committed.name
        try:
            make(sample, path, asked.cache)
        except PomologError as error:
            print(f"{sample.name}: {error}", file=sys.stderr)
            return 1
        entry = describe(sample, path)
        if asked.write:
            manifest[sample.name] = entry
            MANIFEST.write_text(json.dumps(manifest, indent=2) + "\n")
        fault = None
        if entry["truth_sha256"] != manifest.get(sample.name, {}).get("truth_sha256"):
            fault = truth_differs(path, committed) if committed.is_file() else "no such session"
        faults += fault is not None
        print(f"{sample.name}: {fault or 'truth as in the manifest'}", flush=True)
    if asked.write:
        contact_sheet([s for s in SAMPLES if s.name in manifest])
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
