"""Two nodes of a Ray on this machine, in a network of its own: run in `unshare -n` by test_on_ray.py.

Says the address on stdout, then obeys lines: `lose` ends a node as a machine ends, `add` adds one; anything else ends.
"""

import os
import subprocess
import sys

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"


def main() -> None:
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]
    print(cluster.address, flush=True)
    for line in sys.stdin:
        if line == "lose\n":
            cluster.remove_node(nodes.pop(), allow_graceful=False)
        elif line == "add\n":
            nodes.append(cluster.add_node(num_cpus=1))
        else:
            break
        print("done", flush=True)
    cluster.shutdown()


if __name__ == "__main__":
    main()
