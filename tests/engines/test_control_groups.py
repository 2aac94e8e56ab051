"""What a container or a batch job grants, in files as both versions of control groups have them."""

import pytest

from swarmer.engines import control_groups, limits
from swarmer.engines.control_groups import Grant


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Write the kernel's files, by name; the process is in the groups of `membership`."""
    root = tmp_path / "cgroup"
    monkeypatch.setattr(control_groups, "ROOT", root)
    monkeypatch.setattr(control_groups, "MEMBERSHIP", tmp_path / "self")

    def write(membership, **files):
        (tmp_path / "self").write_text(membership)
        for name, text in files.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    return write


def test_without_limits_there_is_none(system):
    system(
        "0::/user\n", **{"user/memory.max": "max\n", "user/pids.max": "max\n", "user/cpu.max": "max 100000\n"}
    )
    assert (control_groups.memory(), control_groups.processes(), control_groups.cores()) == (None, None, None)


def test_where_the_system_has_no_such_files_there_is_none():
    assert control_groups.read_number("/proc/none") is None


def test_the_second_version_and_the_group_that_grants_least(system):
    system(
        "0::/batch/job\n",
        **{
            "batch/memory.max": "4000", "batch/memory.current": "3500",
            "batch/job/memory.max": "3000", "batch/job/memory.current": "1000",
            "batch/job/memory.stat": "anon 500\ninactive_file 400\n",
            "batch/job/pids.max": "100", "batch/job/pids.current": "40",
            "batch/cpu.max": "150000 100000", "batch/job/cpu.max": "max 100000",
        },
    )  # fmt: skip
    assert control_groups.memory() == Grant(4000, 3500)
    assert control_groups.processes() == Grant(100, 40)
    assert control_groups.cores() == 1.5


def test_what_the_kernel_takes_back_is_not_used(system):
    system("0::/", **{"memory.max": "3000", "memory.current": "1000", "memory.stat": "inactive_file 400"})
    assert control_groups.memory() == Grant(3000, 600)
    assert control_groups.memory().left == 2400


def test_the_first_version(system):
    system(
        "9:memory:/slurm/job\n3:cpu,cpuacct:/\n8:pids:/\n0::/\n",
        **{
            "memory/memory.limit_in_bytes": str((1 << 63) - 4096),
            "memory/slurm/job/memory.limit_in_bytes": "5000",
            "memory/slurm/job/memory.usage_in_bytes": "2000",
            "memory/slurm/job/memory.stat": "inactive_file 1\ntotal_inactive_file 500\n",
            "cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000",
        },
    )  # fmt: skip
    assert control_groups.memory() == Grant(5000, 1500)
    assert control_groups.cores() is None


def test_a_container_sees_its_group_as_the_root_whatever_the_path_says(system):
    system("0::/docker/1234\n", **{"memory.max": "3000", "memory.current": "1000"})
    assert control_groups.memory() == Grant(3000, 1000)


def test_more_is_used_than_is_granted(system):
    system("0::/", **{"pids.max": "10", "pids.current": "12"})
    assert control_groups.processes().left == 0


def test_a_run_asks_both_the_machine_and_the_group(system):
    free = limits.available_mb()
    assert free > 64
    system("0::/", **{"memory.max": str(1 << 26), "memory.current": "0"})
    assert limits.available_mb() == 64
