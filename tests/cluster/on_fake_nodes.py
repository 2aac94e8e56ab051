"""Two Ray nodes on one machine, and a run on them; to be run in a network namespace of its own.

`python on_fake_nodes.py OUT`, in which `lo` is down: every node is 127.0.0.1 then, and nothing of it is seen outside.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import swarmer

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
RUN = "from swarmer import cli; import sys; sys.argv[0] = 'swarmer-run'; cli.main_run()"


def main(out: str) -> None:
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    from ray.cluster_utils import Cluster

    other = Path(out, "other")
    shutil.copytree(Path(swarmer.__file__).parent, other / "swarmer")
    with (other / "swarmer" / "plan.py").open("a") as file:
        file.write("# otherwise\n")
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    found = {}
    try:
        cluster.add_node(num_cpus=1)
        settings = ["--engine", "cluster", "--no-recording", "--shape", "random", "--points", "20"]
        for name, more in (
            ("done", [f"cluster.address={cluster.address}"]),
            ("too_many", [f"cluster.address={cluster.address}", "cluster.nodes=3"]),
            ("nobody", ["cluster.address=127.0.0.1:1"]),
            ("strange", [f"cluster.address={cluster.address}"]),
        ):
            if name == "strange":
                cluster.add_node(num_cpus=1, env_vars={"PYTHONPATH": str(other)})
            given = [word for setting in more for word in ("--set", setting)]
            run = subprocess.run(
                [sys.executable, "-c", RUN, *settings, *given, "--duration", "4", "--out", f"{out}/{name}"],
                capture_output=True, text=True, timeout=100,
            )  # fmt: skip
            found[name] = [run.returncode, run.stderr]
    finally:
        cluster.shutdown()
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
