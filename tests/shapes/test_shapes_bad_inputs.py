"""Every bad file, shown to every command that takes one: exit status 2, one line, nothing written, no memory taken."""

import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from bad_files import BAD_FILES

from swarmer.cli import invoke, leave, swarmer
from swarmer.errors import BadInput
from swarmer.shapes import text_files
from swarmer.shapes.catalogue import load_shape
from swarmer.shapes.files import read_cloud

COMMANDS = {
    "show": ("shapes", "show", "FILE", "--out", "picture.png"),
    "check": ("shapes", "check", "FILE"),
    "make": ("shapes", "make", "FILE", "--points", "9", "--out", "made.xyz"),
    "run": ("run", "--shape", "FILE", "--out", "run"),
}
BY_NAME = {bad.name: bad for bad in BAD_FILES}


def ended(monkeypatch, capsys, *arguments):
    """Exit status, stdout and stderr of the command, in this process."""
    monkeypatch.setattr(sys, "argv", ["swarmer", *arguments])
    monkeypatch.setattr(sys, "stderr", sys.stderr)
    with pytest.raises(SystemExit) as end:
        leave(lambda: invoke(swarmer, "swarmer"))
    out, err = capsys.readouterr()
    return end.value.code, out, err


def refused(monkeypatch, capsys, command, path):
    """The one line of the refusal; nothing else was written, neither there nor on stdout."""
    before = sorted(item.name for item in Path().iterdir())
    status, out, err = ended(
        monkeypatch, capsys, *(path if word == "FILE" else word for word in COMMANDS[command])
    )
    assert (status, out) == (2, ""), err
    assert err.count("\n") == 1, err
    assert len(err) < 400, err
    assert sorted(item.name for item in Path().iterdir()) == before
    return err


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", BY_NAME)
def test_a_bad_file_is_refused_in_one_line(tmp_path, monkeypatch, capsys, name, command):
    monkeypatch.chdir(tmp_path)
    bad = BY_NAME[name]
    Path(name).write_bytes(bad.content() if callable(bad.content) else bad.content)
    line = refused(monkeypatch, capsys, command, "./" + name)
    assert line.startswith("error: shape: ")
    assert name in line
    assert bad.words in line


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_no_file_is_refused(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    Path("dir.xyz").mkdir()
    os.mkfifo("pipe.xyz")
    Path("loop.xyz").symlink_to("loop.xyz")
    Path("dangling.xyz").symlink_to("nowhere.xyz")
    with Path("sparse.xyz").open("wb") as file:
        file.truncate(2**40)
    for path, words in {
        "dir.xyz": "is a directory",
        "pipe.xyz": "not a plain file",
        "loop.xyz": "cannot be read: Too many levels of symbolic links",
        "dangling.xyz": "no such file",
        "sparse.xyz": "1,099,511,627,776 bytes; at most",
        "absent.xyz": "no such file",
        "dir.xyz/absent.xyz": "no such file",
        "x" * 300 + ".xyz": "cannot be read: File name too long",
        "/dev/full": "not a plain file",
    }.items():
        assert words in refused(monkeypatch, capsys, command, path)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_may_not_be_read_is_refused(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    Path("mine.xyz").write_text("1 2 3\n4 5 6\n")
    Path("mine.xyz").chmod(0)
    assert "Permission denied" in refused(monkeypatch, capsys, command, "mine.xyz")


def test_a_picture_is_sent_to_make(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("my cat.png").write_bytes(b"\x89PNG")
    for command in ("show", "check", "run"):
        line = refused(monkeypatch, capsys, command, "my cat.png")
        assert "`swarmer shapes make 'my cat.png' --points N`" in line
    assert "PNG" in refused(monkeypatch, capsys, "make", "my cat.png")
    Path("cat.JPG").write_bytes(b"\xff\xd8\xff")
    for command in COMMANDS:
        line = refused(monkeypatch, capsys, command, "cat.JPG")
        assert "save it as PNG, then `swarmer shapes make cat.png --points N`" in line


def test_a_current_directory_that_is_gone_is_no_matter(tmp_path):
    gone = tmp_path / "gone"
    code = (
        "import os, sys; os.rmdir(os.getcwd())\n"
        "from swarmer.cli import invoke, leave, swarmer\n"
        "sys.argv[1:] = ['shapes', 'check', sys.argv[1]]; leave(lambda: invoke(swarmer, 'swarmer'))"
    )
    ends = []
    for shape in ("dragon", "mine.xyz"):
        gone.mkdir(exist_ok=True)
        words = [sys.executable, "-c", code, shape]
        ends.append(subprocess.run(words, cwd=gone, capture_output=True, text=True, timeout=100))
    assert ends[0].returncode == 0, ends[0].stderr
    assert "760 points" in ends[0].stdout
    assert (ends[1].returncode, ends[1].stderr) == (2, "error: shape: 'mine.xyz': no such file\n")


CLAIMS = [
    bad.name
    for bad in BAD_FILES
    if bad.name.startswith(("huge", "large", "wide", "list", "many", "deep", "bomb"))
]
WITHIN_MB = 200

READER = """
import resource, sys, trimesh
from pathlib import Path
from swarmer.errors import BadInput
from swarmer.shapes.files import read_cloud
read_cloud(Path(sys.argv[1])), read_cloud(Path(sys.argv[2]))  # what is imported is not what is meant
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[3:]:
    try:
        read_cloud(Path(path))
    except BadInput:
        continue
    sys.exit(path + " was read")
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_no_memory_is_taken_on_a_files_word(tmp_path):
    assert len(CLAIMS) > 10
    for name in CLAIMS:
        content = BY_NAME[name].content
        (tmp_path / name).write_bytes(content() if callable(content) else content)
    (tmp_path / "good.txt").write_text("1 2 3\n4 5 6\n")
    (tmp_path / "good.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", READER, "good.txt", "good.obj", *CLAIMS],
        cwd=tmp_path, capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < WITHIN_MB


@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("suffix", [".xyz", ".npy"])
def test_few_points_on_a_line_are_a_shape(tmp_path, monkeypatch, capsys, count, suffix):
    monkeypatch.chdir(tmp_path)
    points = np.arange(count)[:, None] * [2.0, 2.0, 2.0]
    if suffix == ".npy":
        np.save("line.npy", points)
    else:
        np.savetxt("line.xyz", points)
    for command in ("show", "check", "make"):
        words = [f"line{suffix}" if word == "FILE" else word for word in COMMANDS[command]]
        status, out, _ = ended(monkeypatch, capsys, *(str(count) if word == "9" else word for word in words))
        assert status == 0
        assert f"{count}" in out
    assert len(load_shape("made.xyz")) == count


@pytest.mark.slow
def test_a_million_points_are_a_shape(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.save("many.npy", np.indices((100, 100, 100)).reshape(3, -1).T * 2.0)
    status, out, err = ended(monkeypatch, capsys, "shapes", "check", "many.npy")
    assert "1000000 points in 3D" in out
    assert "nearest two 2 cells apart" in out
    assert (status, err.count("\n")) == (0, 1)
    assert "too much for this machine: points: 1000000 is not allowed" in err


MANY = 10_000_001


@pytest.mark.parametrize(
    ("name", "head", "line", "said"),
    [
        ("long.xyz", b"", b"1 2\n", "more than 10,000,000 lines"),
        ("long.csv", b"x,y\n", b"1,2\n", "more than 10,000,000 lines"),
        ("blank.txt", b"1 2 3\n", b"\n", "more than 10,000,000 lines"),
        ("long.obj", b"\n", b"v 0 0 0\n", "10,000,001 vertices; at most 10,000,000"),
        ("long.stl", b"solid x\n", b"vertex\n", "10,000,001 vertices; at most 10,000,000"),
    ],
)
def test_ten_million_lines_are_refused_at_a_glance(tmp_path, name, head, line, said):
    """Before anything is made of them: no more memory than the file's bytes, for rows of numbers not even those."""
    path = tmp_path / name
    with path.open("wb") as file:
        file.write(head)
        file.writelines([line * 1000] * (MANY // 1000))
        file.write(line * (MANY % 1000))
    size = path.stat().st_size
    tracemalloc.start()
    try:
        with pytest.raises(BadInput, match=said):
            read_cloud(path)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < (4 * 2**20 if path.suffix in (".xyz", ".csv", ".txt") else size + 4 * 2**20)


def test_comments_are_no_lines_of_a_cloud(tmp_path, monkeypatch):
    monkeypatch.setattr(text_files, "POINTS_MAX", 3)
    (tmp_path / "few.xyz").write_text("# one\n" * 9 + "1 2 3 # x\n4 5 6\n")
    assert len(read_cloud(tmp_path / "few.xyz")) == 2
    (tmp_path / "many.xyz").write_text("1 2 3\n4 5 6\n7 8 9\n1 1 1\n")
    with pytest.raises(BadInput, match="more than 3 lines"):
        read_cloud(tmp_path / "many.xyz")
