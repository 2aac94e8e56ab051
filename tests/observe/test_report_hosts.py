"""The report's part on hosts: what hosts.csv says, a line for each, and nothing where there is none."""

import shutil

import pytest

from swarmer.engines.result import HostRow
from swarmer.observe.report import make_report
from swarmer.observe.report_hosts import HOSTS_SHOWN, hosts_part, read_hosts
from swarmer.observe.run_directory import HOSTS, RunDirectory
from swarmer.observe.saved_run import load

OAK = HostRow(
    "oak", 8, 30, 42, 3000, 2500, 1600, 1500, 400_000, 7, 1, 0, 4, 0.25, 12.7, 40.0, -3.2, 0.04, 0.0, None, ""
)
ELM = OAK._replace(
    host="<b>elm</b>", flss=0, lost_s=12.34, replaced_on="12 on oak", datagrams_out=None, late_p50_ms=None
)


@pytest.fixture
def run(finished_run, tmp_path):
    """A saved run, with hosts to be written beside it."""
    shutil.copytree(finished_run, tmp_path / "run")

    def written(*rows):
        directory = RunDirectory.create(tmp_path / "other", "ball", 1, ["swarmer-run"])
        directory.write_hosts(rows)
        directory.close("done")
        shutil.copy(tmp_path / "other" / HOSTS, tmp_path / "run" / HOSTS)
        return load(tmp_path / "run")

    return written


def test_a_line_for_each_host(run, quick):
    saved = run(OAK, ELM)
    html = hosts_part(saved).html
    assert (
        "2 hosts; 1 of them was lost. Their relays sent 3,000 datagrams in 3,200 packets; 5,000 came." in html
    )
    assert "&lt;b&gt;elm&lt;/b&gt; was lost at 12.3 s; its FLSs were replaced, 12 on oak" in html
    cells = ["oak", "30, then 42", "3,000", "2,500", "1,600", "2.0", "7", "5", "0.25", "13", "-3.2", "0.04"]
    assert f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>" in html
    assert html.count("<td>–</td>") == 3, "what the lost host did not live to tell"
    assert '<section id="hosts"' in make_report([saved])


def test_of_very_many_hosts_some_are_shown(run):
    html = hosts_part(run(*[OAK] * (HOSTS_SHOWN + 5))).html
    assert html.count("<td>oak</td>") == HOSTS_SHOWN
    assert f"The first {HOSTS_SHOWN} of {HOSTS_SHOWN + 5} hosts." in html


def test_a_run_on_one_machine_has_no_such_part(finished_run):
    assert hosts_part(load(finished_run)) is None


@pytest.mark.parametrize(
    "text", ["", "host\noak\n", "x,y\n1\n", None, "\0", ",".join(HostRow._fields) + "\noak,1\n"]
)
def test_a_file_that_is_none_of_ours_is_left_out(run, text):
    saved = run(OAK)
    path = saved.path / HOSTS
    if text is None:
        path.write_text(path.read_text().replace("3000", "many"))
    else:
        path.write_text(text)
    assert read_hosts(saved) == []
