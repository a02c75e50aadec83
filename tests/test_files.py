import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from recorder.errors import PomologError
from recorder.files import only_writer, replacing
from tests.builders import frame, rig, session_file
from tests.conftest import must


def test_a_file_appears_under_its_name_only_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.txt"
    with replacing(path) as part:
        part.write_text("half")
        assert part.parent == path.parent
        assert not path.exists()
        part.write_text("whole")
    assert path.read_text() == "whole"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, OSError])
def test_a_writer_that_fails_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def write() -> None:
        with replacing(path) as part:
            part.write_text("half")
            raise error

    with pytest.raises(PomologError if error is OSError else error):
        write()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    def write(fail: bool) -> None:
        with replacing(tmp_path / "out") as part:
            part.mkdir()
            (part / "a.txt").write_text("x")
            assert not fail

    with pytest.raises(AssertionError):
        write(True)
    assert list(tmp_path.iterdir()) == []
    write(False)
    assert (tmp_path / "out" / "a.txt").read_text() == "x"


KILLED = """
import signal
import sys
from pathlib import Path
from recorder.session_writer import SessionWriter
from tests.builders import frame, rig
# what a shell starts in the background has it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
with SessionWriter.create(Path(sys.argv[1]), rig()) as writer:
    for index in range(10**9):
        writer.write_frame(frame("left", index))
        writer.sync()
        if index == 3:
            print("writing", flush=True)
"""


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_killed_writer_leaves_nothing_under_the_name(
    tmp_path: Path, kill: signal.Signals
) -> None:
    path = tmp_path / "s.mcap"
    command = [sys.executable, "-c", KILLED, str(path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=Path(__file__).parents[1]
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"writing\n"
        writer.send_signal(kill)
        try:
            writer.wait(timeout=20)
        finally:
            writer.kill()
    assert not path.exists()
    if kill == signal.SIGINT:
        assert list(tmp_path.iterdir()) == []


# no rights, no room


def write_megabytes(path: Path, count: int) -> None:
    from recorder.session_writer import SessionWriter

    with SessionWriter.create(path, rig((1024, 700)), raw_images=True) as writer:
        large = frame("left", encoding="bgr8", size_px=(1024, 700))
        for _ in range(count):
            writer.write_frame(large)


def test_a_full_disk_is_one_line_and_leaves_nothing(small_disk: Path) -> None:
    with pytest.raises(
        PomologError, match=r"cannot write .*s\.mcap: No space left on device; make"
    ):
        write_megabytes(small_disk / "s.mcap", 3)
    assert list(small_disk.iterdir()) == []


def test_a_full_disk_at_the_very_end_is_noticed_too(small_disk: Path) -> None:
    # room for the chunks, but not for the index: 1 MiB less what one session of one pair takes
    size = session_file(small_disk, 1, name="probe.mcap").stat().st_size
    (small_disk / "filler").write_bytes(bytes((1 << 20) - 8192 - (size // 4096 + 1) * 4096))
    (small_disk / "probe.mcap").unlink()
    before = sorted(small_disk.iterdir())
    with pytest.raises(PomologError, match="No space left"):
        session_file(small_disk, 40)
    assert sorted(small_disk.iterdir()) == before


LIMITED = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
from recorder.errors import PomologError
from tests.test_files import write_megabytes
try:
    write_megabytes(Path(sys.argv[1]), 3)
except PomologError as error:
    print(error)
"""


def test_a_file_that_may_not_grow_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    # the same refusal as a full disk's, which nobody needs to be root for
    command = [sys.executable, "-c", LIMITED, str(tmp_path / "s.mcap")]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1]
    )
    assert done.stdout == (
        f"cannot write {tmp_path}/s.mcap: File too large; make room, or choose another place with "
        "-o/--out\n"
    )
    assert done.stderr == ""
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_rights_is_one_line(tmp_path: Path) -> None:
    place = tmp_path / "closed"
    place.mkdir(mode=0o500)
    if os.geteuid() == 0:  # root may write anywhere, but not to a disk mounted for reading
        command = ["mount", "-t", "tmpfs", "-o", "ro,size=1m", "tmpfs", str(place)]
        must(subprocess.run(command, capture_output=True, text=True, check=False), "no rights")
    try:
        for path in (place / "s.mcap", place / "deeper" / "s.mcap"):
            with pytest.raises(PomologError, match=r"Permission denied|Read-only"):
                session_file(path.parent, 1)
    finally:
        if os.geteuid() == 0:
            subprocess.run(["umount", str(place)], check=True)
    assert list(place.iterdir()) == []


def test_a_folder_that_is_a_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PomologError, match="cannot write"):
        session_file(tmp_path / "file", 1)


def test_a_folder_of_that_name_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    (tmp_path / "s.mcap").mkdir()
    with pytest.raises(PomologError, match="is a folder"):
        session_file(tmp_path, 1)
    assert [entry.name for entry in tmp_path.iterdir()] == ["s.mcap"]


@pytest.mark.parametrize("name", [".", "/", "..", ""])
def test_an_output_without_a_name_is_one_line(name: str) -> None:
    with pytest.raises(PomologError, match="cannot write"), replacing(Path(name)) as part:
        part.write_text("x")


def test_a_name_that_is_too_long_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PomologError, match="File name too long"):
        session_file(tmp_path, 1, name="a" * 300)
    assert list(tmp_path.iterdir()) == []


def test_syncing_takes_what_was_written_to_the_disk_not_to_a_buffer(tmp_path: Path) -> None:
    from recorder.session_writer import SessionWriter

    with (tmp_path / "s.mcap").open("wb", buffering=1 << 20) as stream:
        writer = SessionWriter(stream, rig())
        writer.write_frame(frame())
        before = (tmp_path / "s.mcap").stat().st_size
        writer.sync()
        after = (tmp_path / "s.mcap").stat().st_size
        assert before < after
        assert after > len(frame().data)
        writer.finish()


def test_a_device_or_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(PomologError, match="is no file"), replacing(tmp_path / "pipe") as part:
        part.write_text("x")
    assert (tmp_path / "pipe").is_fifo()


def test_a_second_run_does_not_write_into_a_folder_that_another_is_writing(tmp_path: Path) -> None:
    with only_writer(tmp_path):
        with pytest.raises(PomologError, match="another run is writing"), only_writer(tmp_path):
            pass
        assert (tmp_path / ".lock").exists()  # the first still holds it
    with only_writer(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []
