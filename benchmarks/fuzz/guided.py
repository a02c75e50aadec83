"""Let atheris look for new paths through the session's reader: python -m benchmarks.fuzz.guided.

Words go to libFuzzer: -runs=100000 -max_total_time=600 FOLDER. pip install atheris first.
"""

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["recorder", "mcap"]):
    from benchmarks.fuzz.targets import read_session
    from recorder.errors import PomologError
    from tests.builders import session_file


def main() -> None:
    """Read mutated sessions until something else than a refusal escapes."""
    folder = Path(tempfile.mkdtemp(prefix="guided"))
    sound = session_file(folder, 2, name="sound.mcap", readings=True, labelled=True)
    seeds = folder / "seeds"
    seeds.mkdir()
    sound.rename(seeds / "sound.mcap")

    def one(data: bytes) -> None:
        path = folder / "s.mcap"
        path.write_bytes(data)
        try:
            read_session(path, folder)
        except PomologError:
            return

    atheris.Setup([*sys.argv, "-max_len=200000", str(seeds)], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
