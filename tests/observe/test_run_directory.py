import contextlib
import json
import os
import string
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmer.engines.result import Event
from swarmer.errors import BadInput
from swarmer.observe.files import write_text
from swarmer.observe.run_directory import RunDirectory, check_out, safe_name
from swarmer.observe.saved_run import load


def create(path, shape="dragon", root=None):
    return RunDirectory.create(path, shape, 7, ["swarmer-run"], *([root] if root else []))


@given(
    st.text(max_size=80) | st.sampled_from(["../x", "/etc/passwd", "", "\0", "..", ".", "a/../..", "x" * 500])
)
def test_any_shape_name_becomes_one_plain_name(shape):
    name = safe_name(shape)
    assert 0 < len(name) <= 60
    assert set(name) <= set(string.ascii_letters + string.digits + "._-")
    assert not name.startswith(".")


def test_unnamed_runs_get_directories_of_their_own(tmp_path):
    root = tmp_path / "runs"
    made = [create(None, "../../dragon.xyz", root) for _ in range(3)]
    assert len({directory.path for directory in made}) == 3
    assert all(d.path.parent == root and d.path.name.startswith("dragon-") for d in made)


@pytest.mark.parametrize("name", ["", " ", "a\0b"])
def test_names_that_are_none_are_refused(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match="out"):
        create(type(tmp_path)(name) if name.strip() else _Blank(name))
    assert list(tmp_path.iterdir()) == []


class _Blank:
    def __init__(self, text):
        self.text = text

    def __str__(self):
        return self.text


def test_what_is_refused_is_refused_before_anything_is_written(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "done").mkdir()
    (tmp_path / "done" / "summary.json").write_text("{}")
    held = create(tmp_path / "held")
    for name, reason in (
        ("file", "is a file"),
        ("done", "finished run"),
        ("held", "another run"),
        ("file/below", ""),
    ):
        with pytest.raises(BadInput, match=f"out.*{reason}"):
            check_out(tmp_path / name)
    held.close("failed")
    remains = {path.name for path in check_out(tmp_path / "held")}
    assert remains == {path.name for path in (tmp_path / "held").iterdir()} >= {"manifest.json"}
    assert check_out(tmp_path / "new" / "below") == []
    assert not (tmp_path / "new").exists()


def test_out_may_be_new_or_empty_only(tmp_path):
    (tmp_path / "empty").mkdir()
    assert create(tmp_path / "empty").path.is_dir()
    assert create(tmp_path / "a" / "b").path.is_dir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for taken in ("file", "full", "link", "file/below"):
        with pytest.raises(BadInput, match="out"):
            create(tmp_path / taken)
    assert (tmp_path / "file").read_text() == (tmp_path / "full" / "thesis.tex").read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


def everything_written(path):
    """A run directory from its beginning to its end, and a report beside it."""
    directory = create(path)
    directory.event(Event(1.0, "thaw", 0, "ours"))
    directory.write_summary({"status": "done"})
    directory.close("done")
    write_text(path / "report.html", "ours")


@pytest.mark.parametrize("suffix", ["", ".partial", ".tmp"])
def test_a_link_in_it_is_replaced_and_what_it_leads_to_stays(tmp_path, suffix):
    """Somebody has laid links under the names of a run's files, before it began."""
    (tmp_path / "thesis.tex").write_text("mine")
    (tmp_path / "run").mkdir()
    names = ("events.csv", "manifest.json", "summary.json", "report.html", "log.txt")
    for name in names:
        if name + suffix != "summary.json":  # which would be that of a finished run
            (tmp_path / "run" / (name + suffix)).symlink_to(tmp_path / "thesis.tex")
    everything_written(tmp_path / "run")
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert not [path for path in (tmp_path / "run").iterdir() if path.is_symlink()]
    assert {*names} <= {path.name for path in (tmp_path / "run").iterdir()}


@pytest.mark.parametrize("suffix", ["", ".partial", ".tmp"])
def test_a_link_that_is_laid_while_it_runs_is_replaced_too(tmp_path, suffix):
    (tmp_path / "thesis.tex").write_text("mine")
    directory = create(tmp_path / "run")
    for name in ("trace.jsonl.gz", "summary.json", "report.html"):
        (tmp_path / "run" / (name + suffix)).symlink_to(tmp_path / "thesis.tex")
    stream = directory.stream("trace.jsonl.gz")
    stream.write(b"ours")
    directory.write_summary({"status": "done"})
    directory.close("done")
    write_text(tmp_path / "run" / "report.html", "ours")
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert (tmp_path / "run" / "trace.jsonl.gz").read_bytes() == b"ours"


def test_a_link_to_a_directory_is_that_directory(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "disk")
    everything_written(tmp_path / "run")
    assert (tmp_path / "run").is_symlink()
    assert "summary.json" in {path.name for path in (tmp_path / "disk").iterdir()}
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("mine")
    (tmp_path / "other").symlink_to(tmp_path / "full")
    with pytest.raises(BadInput, match="other files"):
        create(tmp_path / "other")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(BadInput, match="out"):
        create(tmp_path / "loop")


def test_finished_run_is_never_overwritten(finished_run):
    before = {path.name: path.read_bytes() for path in finished_run.iterdir()}
    with pytest.raises(BadInput, match="finished run"):
        create(finished_run)
    assert {path.name: path.read_bytes() for path in finished_run.iterdir()} == before


def test_unfinished_run_is_replaced_but_not_while_it_runs(tmp_path):
    running = create(tmp_path / "run")
    with pytest.raises(BadInput, match="another run"):
        create(tmp_path / "run")
    running.event(Event(1.0, "thaw", 0, "from the first"))
    running._release()  # killed
    again = create(tmp_path / "run")
    again.close("done")
    assert "from the first" not in (tmp_path / "run" / "events.csv").read_text()


def test_streams_are_partial_until_closed(tmp_path):
    directory = create(tmp_path / "run")
    directory.event(Event(1.25, "failure", 3, 'he said "no",\nand died'))
    names = {path.name for path in directory.path.iterdir()}
    assert {"events.csv.partial", "log.txt.partial", "manifest.json"} == names
    assert load(directory.path).events == [Event(1.25, "failure", 3, 'he said "no",\nand died')]
    directory.close("done")
    assert {path.name for path in directory.path.iterdir()} == {"events.csv", "log.txt", "manifest.json"}
    manifest = json.loads((directory.path / "manifest.json").read_text())
    assert (manifest["status"], manifest["seed"]) == ("done", 7)
    assert manifest["ended"]


@contextlib.contextmanager
def as_nobody(real):
    """Without root's rights, which know no unwritable directory. real: also for who asks by the real user id."""
    if os.geteuid() != 0:
        yield
        return
    os.setresuid(65534 if real else 0, 65534, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("mode", [0o555, 0o000])
def test_a_directory_that_is_there_and_cannot_be_written_is_refused(real, mode):
    with tempfile.TemporaryDirectory() as room:
        os.chmod(room, 0o755)  # noqa: PTH101
        out = Path(room) / "out"
        out.mkdir()
        out.chmod(mode)
        with as_nobody(real), pytest.raises(BadInput, match=r"out: .*Permission denied") as refused:
            create(out)
        assert refused.value.exit_status == 2
        assert "\n" not in str(refused.value)
        out.chmod(0o755)
        assert list(out.iterdir()) == []


@pytest.mark.parametrize("real", [True, False])
def test_a_directory_below_one_that_cannot_be_written_is_refused(real):
    with tempfile.TemporaryDirectory() as room:
        os.chmod(room, 0o555)  # noqa: PTH101
        with as_nobody(real), pytest.raises(BadInput, match=r"out: .*Permission denied"):
            create(Path(room) / "new" / "out")
        os.chmod(room, 0o755)  # noqa: PTH101
