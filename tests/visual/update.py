"""Make the reference pictures anew: `python -m tests.visual.update`; then look at each of them."""

from pathlib import Path
from tempfile import TemporaryDirectory

from tests.visual.compare import REFERENCES, write
from tests.visual.looks import look_at_all
from tests.visual.needs import vulkan


def main() -> None:
    """Write every reference."""
    with TemporaryDirectory() as folder:
        for _, looked in look_at_all(Path(folder), vulkan()):
            for name, picture in looked.pictures.items():
                write(name, picture)
                print(f"{REFERENCES / name}.jpg")
            for complaint in looked.complaints:
                print(f"the viewer complains: {complaint}")


if __name__ == "__main__":
    main()
