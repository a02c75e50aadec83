"""Pack sessions/demo.mcap from rendered stereo pairs, through the commands a user has.

    python sessions/make_demo.py PAIRS

PAIRS is a folder of pairs, each a folder KIND_SEED with left.png, right.png, their 16-bit
*_labels.png and truth.json, beside a rig_opencv.yaml.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

CHOSEN = (
    "front_101", "front_102", "back_121", "back_122", "cloudy_141", "cloudy_142", "indoor_161",
)  # fmt: skip
# 4:4:4, because chroma subsampling moves R - G
JPEG = [
    cv2.IMWRITE_JPEG_QUALITY, 92,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
]  # fmt: skip


def pack(pairs: Path, out: Path) -> None:
    """Make JPEGs of the chosen pairs, import them and label them."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        apples = []
        for name in CHOSEN:
            for side in ("left", "right"):
                for kind in ("pictures", "masks"):
                    (work / kind / side).mkdir(parents=True, exist_ok=True)
                picture = cv2.imread(str(pairs / name / f"{side}.png"))
                number = f"{len(apples):02d}"
                cv2.imwrite(str(work / "pictures" / side / f"{number}.jpg"), picture, JPEG)
                labels = (pairs / name / f"{side}_labels.png").read_bytes()
                (work / "masks" / side / f"{number}.png").write_bytes(labels)
            apples.append(json.loads((pairs / name / "truth.json").read_text())["apples"])
        (work / "apples.json").write_text(json.dumps(apples))
        lighting = ",".join(name.split("_")[0] for name in CHOSEN)
        pomolog(
            "import", "frames", work / "pictures/left", work / "pictures/right",
            "--rig", pairs / "rig_opencv.yaml", "--lighting", lighting, "--cultivar", "Fuji",
            "--site", "digital orchard", "-o", work / "frames.mcap",
        )  # fmt: skip
        pomolog(
            "label", work / "frames.mcap", "--masks", work / "masks",
            "--apples", work / "apples.json", "-o", out,
        )  # fmt: skip


def pomolog(*words: object) -> None:
    """Run one command of ours."""
    subprocess.run([sys.executable, "-m", "pomolog", *map(str, words)], check=True)


if __name__ == "__main__":
    pack(Path(sys.argv[1]), Path(__file__).parent / "demo.mcap")
