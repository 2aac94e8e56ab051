import json
import re
import shutil

import pytest
from click.testing import CliRunner

from swarmer.commands.report import command
from swarmer.errors import BadInput
from swarmer.observe.report import write_report


def requests(page):
    """Everything in the page that a browser would fetch."""
    found = re.findall(
        r"""(?:src|href|data|action)\s*=\s*["']?([^"' >]+)|url\(([^)]+)\)|@import\s+(\S+)""", page
    )
    return [one for hit in found for one in hit if one and not one.strip("'\"").startswith(("#", "data:"))]


def test_report_of_a_run_is_one_file_that_needs_no_other(finished_run, tmp_path):
    out = write_report([finished_run], tmp_path / "report.html")
    page = out.read_text()
    assert requests(page) == []
    assert "<script" not in page
    for part in (
        "Hausdorff distance",
        "States",
        "duration_s",
        "swarmer-run --shape ball",
        "How to reproduce",
        "faithful",
    ):
        assert part in page
    assert page.count("<svg") == 4
    assert "Not everything is there" not in page
    assert out.read_bytes() == write_report([finished_run], out).read_bytes()


def test_command_writes_beside_the_run_and_prints_where(finished_run, tmp_path):
    run = shutil.copytree(finished_run, tmp_path / "run")
    done = CliRunner().invoke(command, [str(run)], standalone_mode=False)
    assert done.output.splitlines()[-1] == str(run / "report.html")
    assert (run / "report.html").exists()


def test_several_runs_are_compared(finished_run, tmp_path, fake, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fake.record(tmp_path / "other", duration_s=8.0, lambda_ms=200, recording={"enabled": False})
    page = write_report([finished_run, tmp_path / "other"]).read_text()
    assert (tmp_path / "report.html").exists()
    assert "2 runs compared" in page
    assert re.search(r"lambda_ms</code></td><td>500</td><td>200</td>", page)


def test_a_file_that_is_no_report_is_not_replaced(finished_run, tmp_path):
    (tmp_path / "mine.html").write_text("mine")
    with pytest.raises(BadInput, match="no report of ours"):
        write_report([finished_run], tmp_path / "mine.html")
    assert (tmp_path / "mine.html").read_text() == "mine"


@pytest.mark.parametrize("name", ["missing", "empty", "file"])
def test_what_is_no_run_directory_is_refused(tmp_path, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(BadInput, match="run"):
        write_report([tmp_path / name])


def test_text_from_the_run_is_escaped(finished_run, tmp_path):
    run = shutil.copytree(finished_run, tmp_path / "run")
    evil = "<script>alert(1)</script>"
    summary = json.loads((run / "summary.json").read_text())
    (run / "summary.json").write_text(json.dumps({**summary, "shape": evil, "message": evil, evil: evil}))
    (run / "config.yaml").write_text(f"'{evil}': '{evil}'\n")
    (run / "events.csv").write_text(f"t_s,kind,fid,text\n1,{evil},0,{evil}\n")
    assert "<script" not in write_report([run]).read_text()
