"""scripts/cluster: linted, checked against their schemas, and run as far as one machine carries.

ssh and Slurm are stand-ins that run here what they are given, and note it; a stand-in `ray` notes its arguments.
"""

import json
import os
import shutil
import stat
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = ROOT / "scripts" / "cluster"
SHELL = ["ssh.sh", "slurm.sbatch"]


def tool(name):
    """A linter of the extra `dev`, from the environment that runs this."""
    found = shutil.which(name, path=f"{Path(sys.executable).parent}:{os.environ.get('PATH', '')}")
    if found is None:
        pytest.skip(f"NOT LINTED: {name} is missing: pip install -e .[dev]")
    return found


@pytest.fixture
def bench(tmp_path):
    """A folder of stand-ins, each of which notes how it was called in `calls`; and how to make one."""
    place = tmp_path / "bin"
    place.mkdir()

    def stand_in(name, body="", where=place):
        path = where / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            f'#!/usr/bin/env bash\necho "{name} $*" >> {tmp_path}/calls\n'
            f'echo "{name} ${{RAY_AUTH_MODE:-}} ${{RAY_AUTH_TOKEN:-}}" >> {tmp_path}/tokens\n{body}\n'
        )
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    stand_in.calls = lambda: (tmp_path / "calls").read_text().splitlines()
    stand_in.tokens = lambda name: {
        tuple(line.split()[1:])
        for line in (tmp_path / "tokens").read_text().splitlines()
        if line.split()[0] == name
    }
    stand_in.path = place
    return stand_in


def run(script, *arguments, path, **environment):
    return subprocess.run(
        ["bash", str(SCRIPTS / script), *map(str, arguments)],
        capture_output=True, text=True, timeout=60,
        env={**os.environ, "PATH": f"{path}:{os.environ['PATH']}", **{k: str(v) for k, v in environment.items()}},
    )  # fmt: skip


@pytest.mark.parametrize("name", SHELL)
def test_shell_scripts_are_clean(name):
    done = subprocess.run([tool("shellcheck"), str(SCRIPTS / name)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_the_container_file_is_clean():
    done = subprocess.run([tool("hadolint"), str(SCRIPTS / "Containerfile")], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_container_installs_what_is_pinned_and_the_extra():
    text = (SCRIPTS / "Containerfile").read_text()
    assert '-c /src/constraints.txt "/src[cluster]"' in text
    pinned = next(
        line for line in (ROOT / "constraints.txt").read_text().splitlines() if line.startswith("ray==")
    )
    kubernetes = yaml.safe_load((SCRIPTS / "kubernetes.yaml").read_text())
    assert kubernetes["spec"]["rayVersion"] == pinned.partition("==")[2]


def test_the_container_takes_along_what_a_wheel_is_made_of_and_no_more():
    """Not the whole checkout: an environment and runs in it are gigabytes."""
    lines = (SCRIPTS / "Containerfile").read_text().splitlines()
    taken = {name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {*wheel["packages"], *wheel["force-include"], *project["project"]["license-files"]}
    assert taken == needed | {"pyproject.toml", "constraints.txt", project["project"]["readme"]}


def test_the_container_has_what_ray_up_needs_inside():
    text = (SCRIPTS / "Containerfile").read_text()
    cloud = (SCRIPTS / "cloud.yaml").read_text()
    packages = text.split("install --no-install-recommends --yes ")[1].split("\\")[0].split()
    assert {"rsync", "tmux"} <= set(packages), "for `ray rsync-down` and `ray exec --tmux`"
    assert "--tmux" in cloud
    # `ray up` asks the image for HOME, and puts ~ of `file_mounts` there.
    assert "--home-dir /ray " in text
    assert "ENV HOME=/ray " in text


def test_the_cloud_file_is_as_rays_schema_has_it():
    if find_spec("ray") is None:
        pytest.skip("NOT CHECKED: needs the extra `cluster`")
    import jsonschema
    import ray.autoscaler

    schema = json.loads((Path(ray.autoscaler.__file__).parent / "ray-schema.json").read_text())
    cloud = yaml.safe_load((SCRIPTS / "cloud.yaml").read_text())
    jsonschema.validate(cloud, schema)
    # Said, or Ray has commands of its own there, which install another Ray.
    assert cloud["setup_commands"] == cloud["worker_setup_commands"] == []
    workers = cloud["available_node_types"]["worker"]
    assert workers["min_workers"] == workers["max_workers"] == cloud["max_workers"]
    assert cloud["available_node_types"][cloud["head_node_type"]]["resources"] == {"CPU": 0}


CONTAINER = {
    "type": "object", "required": ["name", "image", "resources"], "additionalProperties": False,
    "properties": {
        "name": {"type": "string"}, "image": {"type": "string"},
        "env": {"type": "array", "items": {"required": ["name", "value"]}},
        "resources": {"required": ["requests", "limits"]}, "volumeMounts": {"type": "array"},
    },
}  # fmt: skip
TEMPLATE = {
    "type": "object", "required": ["spec"],
    "properties": {"spec": {"required": ["containers"], "properties": {
        "containers": {"type": "array", "minItems": 1, "items": CONTAINER}, "volumes": {"type": "array"},
    }}},
}  # fmt: skip
PARAMETERS = {
    "type": "object",
    "additionalProperties": {"type": "string"},
}  # a number there is refused by the operator
RAY_CLUSTER = {  # what we use of ray.io/v1, by KubeRay's API reference
    "type": "object", "required": ["apiVersion", "kind", "metadata", "spec"], "additionalProperties": False,
    "properties": {
        "apiVersion": {"const": "ray.io/v1"}, "kind": {"const": "RayCluster"}, "metadata": {"required": ["name"]},
        "spec": {
            "required": ["headGroupSpec", "rayVersion"], "additionalProperties": False,
            "properties": {
                "rayVersion": {"type": "string"},
                "authOptions": {"properties": {"mode": {"enum": ["disabled", "token"]}}},
                "headGroupSpec": {"required": ["rayStartParams", "template"], "additionalProperties": False,
                                  "properties": {"rayStartParams": PARAMETERS, "template": TEMPLATE}},
                "workerGroupSpecs": {"type": "array", "items": {
                    "required": ["groupName", "rayStartParams", "template"], "additionalProperties": False,
                    "properties": {
                        "groupName": {"type": "string"}, "replicas": {"type": "integer"},
                        "minReplicas": {"type": "integer"}, "maxReplicas": {"type": "integer"},
                        "rayStartParams": PARAMETERS, "template": TEMPLATE,
                    },
                }},
            },
        },
    },
}  # fmt: skip


def test_the_kubernetes_manifest_is_a_ray_cluster():
    jsonschema = pytest.importorskip("jsonschema")
    manifest = yaml.safe_load((SCRIPTS / "kubernetes.yaml").read_text())
    jsonschema.validate(manifest, RAY_CLUSTER)
    head = manifest["spec"]["headGroupSpec"]
    mounts = {
        mount["name"] for one in head["template"]["spec"]["containers"] for mount in one["volumeMounts"]
    }
    assert mounts == {volume["name"] for volume in head["template"]["spec"]["volumes"]}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(
            {
                **manifest,
                "spec": {**manifest["spec"], "headGroupSpec": {**head, "rayStartParams": {"num-cpus": 0}}},
            },
            RAY_CLUSTER,
        )


HOSTS = "# mine\nme@first\n\nsecond  # slow\nthird\n"


def test_over_ssh_the_first_host_is_the_head_and_the_others_join_it_with_one_token(bench, tmp_path):
    (tmp_path / "hosts").write_text(HOSTS)
    ssh = bench("ssh", 'shift; bash -c "$*"')
    bench("ray", where=tmp_path / "venv" / "bin")
    done = run("ssh.sh", "up", tmp_path / "hosts", tmp_path / "venv", path=bench.path, SSH=ssh)
    assert done.returncode == 0, done.stderr
    rays = sorted(call for call in bench.calls() if call.startswith("ray "))
    assert rays == [
        *["ray start --log-color=false --address=first:6379"] * 2,
        "ray start --log-color=false --head --port=6379 --include-dashboard=false --disable-usage-stats",
    ]
    assert sorted(done.stderr.splitlines()) == ["me@first: head", "second: joined", "third: joined"]
    assert next(call for call in bench.calls() if call.startswith("ssh ")).startswith("ssh me@first ")
    [(mode, token)] = bench.tokens("ray")
    assert mode == "token"
    assert len(token) == 64
    assert token not in "".join(bench.calls())  # on no command line
    assert done.stdout.splitlines() == [
        "# on me@first, or another of the hosts:", f"export RAY_AUTH_MODE=token RAY_AUTH_TOKEN={token}",
        f"{tmp_path}/venv/bin/swarmer sweep FILE --ray first:6379",
    ]  # fmt: skip
    assert (
        run("ssh.sh", "down", tmp_path / "hosts", tmp_path / "venv", path=bench.path, SSH=ssh).returncode == 0
    )
    assert bench.calls()[-1] == "ray stop"


def test_over_ssh_options_of_ray_reach_it_whole(bench, tmp_path):
    (tmp_path / "hosts").write_text("first\n")
    bench("ray", 'for one; do echo "[$one]" >> $(dirname $0)/words; done', where=tmp_path / "venv" / "bin")
    options = """--resources='{"a": 1}' --temp-dir="/a b" """
    ssh = bench("ssh", 'shift; bash -c "$*"')
    done = run(
        "ssh.sh", "up", tmp_path / "hosts", tmp_path / "venv", path=bench.path, SSH=ssh, HEAD_OPTIONS=options
    )
    assert done.returncode == 0, done.stderr
    words = (tmp_path / "venv" / "bin" / "words").read_text().splitlines()
    assert words[-2:] == ['[--resources={"a": 1}]', "[--temp-dir=/a b]"]


def test_over_ssh_a_head_that_no_other_host_reaches_is_told(bench, tmp_path):
    """Ray on a host without a default route takes what /etc/hosts says of the host itself."""
    (tmp_path / "hosts").write_text(HOSTS)
    bench("ray", "echo 'Local node IP: 127.0.1.1'", where=tmp_path / "venv" / "bin")
    ssh = bench("ssh", 'shift; bash -c "$*"')
    done = run("ssh.sh", "up", tmp_path / "hosts", tmp_path / "venv", path=bench.path, SSH=ssh)
    assert done.returncode == 1
    assert done.stderr.startswith("error: me@first is 127.0.1.1 to itself, where no other host reaches it;")
    assert len([call for call in bench.calls() if call.startswith("ray ")]) == 1  # nobody joins that


def test_over_ssh_a_host_that_cannot_join_is_named(bench, tmp_path):
    (tmp_path / "hosts").write_text(HOSTS)
    done = run(
        "ssh.sh", "up", tmp_path / "hosts", path=bench.path, SSH=bench("ssh", 'echo busy; [ "$1" != third ]')
    )
    assert done.returncode == 1
    told = done.stderr.splitlines()
    assert sorted(told) == ["error: third could not join", "me@first: head", "second: joined", "third: busy"]
    assert told.index("third: busy") < told.index("error: third could not join")


def test_over_ssh_a_host_that_cannot_be_stopped_is_named_and_the_others_are(bench, tmp_path):
    (tmp_path / "hosts").write_text(HOSTS)
    ssh = bench("ssh", '[ "$1" != second ]')
    done = run("ssh.sh", "down", tmp_path / "hosts", path=bench.path, SSH=ssh)
    assert done.returncode == 1
    assert sorted(done.stderr.splitlines()) == [
        "error: second could not be stopped", "me@first: stopped", "third: stopped",
    ]  # fmt: skip
    assert len(bench.calls()) == 3


@pytest.mark.parametrize(
    "arguments", [[], ["up"], ["up", "/nowhere"], ["sideways", "HOSTS"], ["up", "EMPTY"]]
)
def test_over_ssh_what_cannot_be_ends_with_2(arguments, bench, tmp_path):
    (tmp_path / "HOSTS").write_text(HOSTS)
    (tmp_path / "EMPTY").write_text("# none\n")
    places = [str(tmp_path / one) if one.isupper() else one for one in arguments]
    done = run("ssh.sh", *places, path=bench.path, SSH="false")
    assert done.returncode == 2
    assert "Ray on a list of hosts" in done.stderr or "names no host" in done.stderr


def slurm(bench, tmp_path, *nodes):
    """Stand-ins for Slurm on these nodes, and for the Ray of the environment whose programs' folder it gives."""
    bench("scontrol", "; ".join(f"echo {node}" for node in nodes))
    bench(
        "srun", 'while [ "${1#-}" != "$1" ]; do case $1 in -w) shift 2 ;; *) shift ;; esac; done; exec "$@"'
    )
    venv = tmp_path / "venv" / "bin"
    bench("ray", "exec sleep 60", where=venv)
    return venv


@pytest.mark.parametrize("status", [0, 1])
def test_on_slurm_every_node_joins_and_the_sweep_is_the_job(status, bench, tmp_path):
    venv = slurm(bench, tmp_path, "n1", "n2", "n3")
    bench("python", where=venv)  # the head answers
    joined = f"for i in $(seq 100); do [ $(grep -c '^ray ' {tmp_path}/calls) = 3 ] && break; sleep 0.1; done"
    bench("swarmer", f"{joined}; exit {status}", where=venv)
    done = run(
        "slurm.sbatch", "loss_map", "--out", "o", path=bench.path, VENV=tmp_path / "venv",
        SLURM_JOB_NODELIST="n[1-3]", SLURM_CPUS_ON_NODE=16,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    calls = bench.calls()
    assert "swarmer sweep loss_map --out o --ray n1:6379" in calls
    rays = sorted(call for call in calls if call.startswith("ray "))
    assert rays[:2] == ["ray start --address=n1:6379 --num-cpus=16 --block"] * 2
    assert rays[2].startswith("ray start --head --port=6379 --num-cpus=16 ")
    assert sorted(call.split("-w ")[1].split()[0] for call in calls if call.startswith("srun ")) == [
        "n1",
        "n2",
        "n3",
    ]
    [(mode, token)] = bench.tokens("ray")
    assert mode == "token"
    assert token not in "".join(calls)  # on no command line


@pytest.mark.parametrize("begun", [True, False])
def test_on_slurm_a_signal_ends_the_sweep_in_good_order(begun, bench, tmp_path):
    """Slurm sends it a minute before the limit: the job waits until the sweep has written its table."""
    venv = slurm(bench, tmp_path, "n1")
    bench("python", "" if begun else "kill -TERM $PPID; sleep 0.2; exit 1", where=venv)
    bench(
        "swarmer",
        f"trap 'sleep 1; echo > {tmp_path}/table; exit 130' TERM\nkill -TERM $PPID; while sleep 0.1; do :; done",
        where=venv,
    )
    done = run(
        "slurm.sbatch", "loss_map", path=bench.path, VENV=tmp_path / "venv", SLURM_JOB_NODELIST="n1",
        SLURM_CPUS_ON_NODE=1,
    )  # fmt: skip
    assert done.returncode == (130 if begun else 143), done.stderr
    assert (tmp_path / "table").exists() == begun
