"""run.json: what a session's results are of. It is written last: where it is, results are whole."""

import json
import re
import zlib
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from recorder.errors import PomologError, newer_profile
from recorder.limits import DEFAULT_LIMITS
from recorder.objects import Place

RESULTS_PROFILE: Final = "pomolog-results/1"


class _Session(BaseModel):
    """Of what everything after a replay relies on; other keys are kept as they are."""

    model_config = ConfigDict(extra="allow", strict=True)

    name: str
    file: str
    fingerprint: str
    pairs: Annotated[int, Field(ge=0)]
    metadata: dict[str, str]
    ledger: dict[str, str] = {}


class _Stage(BaseModel):
    """The same of one of the locator's stages."""

    model_config = ConfigDict(extra="allow", strict=True)

    use: str


class _Versions(BaseModel):
    """The same of what the results depend on beside session and method."""

    model_config = ConfigDict(extra="allow", strict=True)

    source: str


class _About(BaseModel):
    """The same of the whole file."""

    model_config = ConfigDict(extra="allow", strict=True)

    profile: str
    method: str
    locator: dict[str, _Stage]
    models: dict[str, str] = {}
    seed: int
    session: _Session
    versions: _Versions
    tables: dict[str, str] = {}


def run_text(about: dict[str, Any]) -> str:
    """The text of run.json, with a checksum of what it says."""
    return _laid_out({**about, "crc32": _crc(about)})


def _laid_out(about: dict[str, Any]) -> str:
    return json.dumps(about, indent=2) + "\n"


def read_run(path: Place) -> dict[str, Any]:
    """Read run.json back.

    Raises:
        PomologError: it is not there, damaged, or of another profile.
    """
    try:
        data = path.read_bytes()
        if len(data) > DEFAULT_LIMITS.text:
            raise ValueError(f"{len(data)} bytes")
        text = data.decode("utf-8")
        about = json.loads(text)
        _check_profile(path, about["profile"])
        ours = text == _laid_out(about)  # else a program has rewritten it, knowing what it did
        if about.pop("crc32", "") != _crc(about) and ours:
            raise ValueError("its checksum does not agree")
        _About.model_validate(about)
    except ValidationError as error:
        place = ".".join(map(str, error.errors()[0]["loc"]))
        raise PomologError(f"{path} is damaged (its {place}); replay it again") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise PomologError(f"{path} is damaged; replay it again") from None
    found: dict[str, Any] = about
    return found


def _check_profile(path: Place, profile: object) -> None:
    if profile == RESULTS_PROFILE:
        return
    if isinstance(profile, str) and re.fullmatch(r"pomolog-results/\d+", profile):
        raise newer_profile(path, profile, RESULTS_PROFILE)
    raise PomologError(
        f"{path} has profile {str(profile)[:40]!r}, not {RESULTS_PROFILE}; replay it again"
    )


def _crc(about: dict[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(about, sort_keys=True).encode()):08x}"
