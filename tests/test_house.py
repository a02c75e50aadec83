"""The house's rules: who may import whom, where printing happens, how large files may be."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("recorder", "processor", "viewer")

# layer -> what of ours it may import
MAY_IMPORT = {
    "recorder": {"recorder"},
    "processor": {"recorder", "processor"},
    "viewer": {"recorder", "processor", "viewer"},
}
# library -> the only modules that may import it
KEEPERS = {
    "mcap": {
        "recorder.container",
        "recorder.mcap_index",
        "recorder.mcap_records",
        "recorder.message_writer",
        "recorder.ros2",
        "recorder.salvage",
    },
    "mcap_ros2": {"recorder.ros2"},
    "mcap_protobuf": {"recorder.message_writer"},
    "rerun": {
        "processor.rrd",
        "processor.rrd_match",
        "processor.rrd_numbers",
        "processor.rrd_pictures",
        "processor.rrd_session",
        "viewer.chunks",
        "viewer.layout",
        "viewer.layout_chosen",
        "viewer.open",
        "viewer.side_by_side",
        "viewer.views",
        "viewer.worst",
    },
    "rerun_cli": {"processor.recordings"},
    "pyarrow": {"processor.results", "viewer.chunks"},
    "matplotlib": {"processor.charts", "recorder.timing_plot"},
    "pydantic": {
        "recorder.rig_formats.ours",
        "recorder.equipment",
        "recorder.imports.coco",
        "recorder.imports.json_files",
        "recorder.imports.masks",
        "recorder.orchard.scene",
        "processor.methods",
        "processor.run_file",
    },
    "yaml": {"recorder.rig_formats.yaml_text"},
    "fsspec": {"recorder.objects"},
    "distributed": {"processor.cluster"},
    "jax": {"processor.centre_net", "processor.train_centres"},
    "onnx": {"processor.centre_net"},
    "optax": {"processor.train_centres"},
    "gi": {"recorder.cameras.aravis"},
    "pypylon": {"recorder.cameras.pylon"},
    "av": {"recorder.cameras.av"},
    "serial": {"recorder.rangefinders.port"},
}
STAGES = ("recognise", "clean", "circles", "match", "triangulate", "locate")


def modules(*packages: str) -> Iterator[tuple[str, ast.Module]]:
    for package in packages:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name.removesuffix(".__init__"), parsed(path)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(tree: ast.Module) -> set[str]:
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


def root_of(name: str) -> str:
    return name.split(".", maxsplit=1)[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_layers_run_one_way(package: str) -> None:
    for name, tree in modules(package):
        ours = {root_of(i) for i in imported(tree)} & set(PACKAGES)
        assert ours <= MAY_IMPORT[package], f"{name} imports {ours - MAY_IMPORT[package]}"


@pytest.mark.parametrize("library", KEEPERS)
def test_a_library_is_imported_only_by_its_keepers(library: str) -> None:
    users = {
        name for name, tree in modules(*PACKAGES) if library in {root_of(i) for i in imported(tree)}
    }
    assert users == KEEPERS[library]


def test_stages_know_no_rerun_no_files_and_no_other_package_of_results() -> None:
    forbidden = {"rerun", "pathlib", "os", "logging", "processor.results", "processor.rrd"}
    for stage in STAGES:
        found = imported(parsed(ROOT / "processor" / f"{stage}.py"))
        assert not found & forbidden, f"processor/{stage}.py imports {found & forbidden}"


def test_the_score_imports_no_stage() -> None:
    for module, may in (("score", {"processor.sureness"}), ("sureness", set())):
        found = imported(parsed(ROOT / "processor" / f"{module}.py"))
        assert {name for name in found if root_of(name) in PACKAGES} <= may


def test_only_the_command_line_prints() -> None:
    for name, tree in modules(*PACKAGES):
        if name.endswith(".cli"):
            continue
        calls = (n for n in ast.walk(tree) if isinstance(n, ast.Call))
        printing = [
            c.lineno for c in calls if isinstance(c.func, ast.Name) and c.func.id == "print"
        ]
        assert not printing, f"{name} prints in line {printing[0]}"


def test_every_module_opens_with_a_sentence_of_purpose() -> None:
    for name, tree in modules(*PACKAGES):
        purpose = ast.get_docstring(tree)
        assert purpose, f"{name} says nothing"
        assert purpose.splitlines()[0].endswith((".", ":")), f"{name}: {purpose.splitlines()[0]}"


def test_the_recorder_never_loads_rerun_or_the_processor() -> None:
    names = [name for name, _ in modules("recorder")]
    code = (
        f"import importlib, sys\nfor n in {names!r}: importlib.import_module(n)\n"
        "print([m for m in ('rerun', 'processor', 'viewer') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_front_door_imports_nothing_heavy() -> None:
    code = "import sys, pomolog; print([m for m in ('numpy', 'cv2', 'typer') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_repository_stays_light() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split("\0")
    files = [ROOT / name for name in listed if name and (ROOT / name).is_file()]
    sessions = [f for f in files if f.is_relative_to(ROOT / "sessions")]
    assert sum(f.stat().st_size for f in sessions) < 40e6
    heavy = [f.name for f in files if f not in sessions and f.stat().st_size > 1e6]
    assert not heavy


def test_every_command_of_the_front_door_exists_and_shows_an_example() -> None:
    from importlib import import_module

    from typer.testing import CliRunner

    from pomolog import COMMANDS

    for name, command in COMMANDS.items():
        result = CliRunner().invoke(import_module(command.module).app, [name, "--help"])
        assert result.exit_code == 0, name
        if name not in ("import", "export"):  # a group: its own commands have the examples
            assert "Example: pomolog" in result.output, name


def test_nothing_is_unpickled_and_no_text_is_run() -> None:
    """Pickles of strangers run code; so do eval, exec and YAML's full loader."""
    forbidden = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
    for name, tree in modules(*PACKAGES):
        found = {root_of(i) for i in imported(tree)} & forbidden
        assert not found, f"{name} imports {found}"
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            place = f"{name}, line {call.lineno}"
            words = ast.unparse(call.func)
            assert words not in ("eval", "exec", "yaml.load", "yaml.unsafe_load"), place
            if words in ("np.load", "numpy.load"):
                given = {word.arg: ast.unparse(word.value) for word in call.keywords}
                assert given.get("allow_pickle") == "False", place


def test_servers_listen_on_this_machine_alone() -> None:
    from viewer.open import LOOPBACK, open_viewer

    assert LOOPBACK == "127.0.0.1"
    assert (open_viewer.__kwdefaults__ or {})["bind"] == LOOPBACK
    servers = ("ThreadingHTTPServer", "HTTPServer", "TCPServer", "ThreadingTCPServer")
    for name, tree in modules(*PACKAGES):
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if ast.unparse(call.func).endswith(servers):
                assert "127.0.0.1" in ast.unparse(call.args[0]), f"{name}, line {call.lineno}"
