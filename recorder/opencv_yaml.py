"""OpenCV's YAML, held against itself before OpenCV reads it.

Its reader believes the sizes that a matrix claims: `cols` missing, or more numbers than they say,
end in a damaged heap (opencv 4.11 to 5.0, found by mutating a good file). So every matrix must be
as `cv2.FileStorage` writes it, its numbers as many as it says.
"""

import re
from pathlib import Path
from typing import Final

from recorder.errors import PomologError
from recorder.text_files import read_text

MOST_NUMBERS: Final = 1000  # of a matrix; a camera's has 9
_MATRIX: Final = re.compile(
    r"rows:\s*(\d{1,4})\s+cols:\s*(\d{1,4})\s+dt:\s*\"?[fdi]\"?\s+data:\s*\[([^\[\]{}\"'&*!:]*)\]"
)
_LIE: Final = (
    "not an OpenCV YAML to trust: a matrix has other numbers than its rows and cols say; "
    "did cv2.FileStorage write it?"
)
_WORDS: Final = ("rows", "cols", "dt", "data", "sizes")


def require_sound(path: Path) -> None:
    """Refuse a file whose matrices lie about their sizes.

    Raises:
        PomologError: one does, or the file is no text, or too large.
    """
    text = read_text(path, "an OpenCV stereo YAML", "calibration")
    plain = re.sub(r"(^|\s)#[^\n]*", r"\1", text)  # a comment
    matrices = _MATRIX.findall(plain)
    found = {word: len(re.findall(rf"\b{word}\b", plain)) for word in _WORDS}
    if found != dict.fromkeys(_WORDS[:-1], len(matrices)) | {"sizes": 0}:
        raise PomologError(_LIE)
    for rows, columns, listed in matrices:
        count = len(listed.split(",")) if listed.strip() else 0
        if not 0 < count <= MOST_NUMBERS or count != int(rows) * int(columns):
            raise PomologError(_LIE)
