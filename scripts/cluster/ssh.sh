#!/usr/bin/env bash
# Ray on a list of hosts, over ssh:  scripts/cluster/ssh.sh up HOSTS [VENV]     and on one of them the lines it prints
#                                    scripts/cluster/ssh.sh down HOSTS [VENV]   ends all of Ray that is yours there
# HOSTS: a file with a host a line, as ssh takes it; the first becomes the head. VENV: where swarmer[cluster] is
# installed on every host (default ~/swarmer). In the environment:
#   SSH           what starts a program on a host (default ssh), such as 'ssh -o ConnectTimeout=5 -p 2222'
#   PORT          of the head (default 6379); Ray takes free ports besides, on all hosts
#   HEAD_ADDRESS  the head as the others reach it, where that is not its name in HOSTS
#   HEAD_OPTIONS, NODE_OPTIONS   more for `ray start` on the head and on the others, such as --num-cpus=8
set -euo pipefail

usage() { sed -n '2,/^[^#]/s/^# //p' "$0" >&2; exit 2; }
if [ $# -lt 2 ] || [ ! -r "$2" ]; then usage; fi
action=$1 venv=${3:-\~/swarmer} port=${PORT:-6379}
mapfile -t hosts < <(sed 's/#.*//; s/[[:space:]]//g; /^$/d' "$2")
[ ${#hosts[@]} -ge 1 ] || { echo "error: $2 names no host" >&2; exit 2; }
head=${hosts[0]}

# Ray takes nobody without the cluster's token. It is on no command line, where others on a host would see it.
RAY_AUTH_TOKEN=${RAY_AUTH_TOKEN:-$(head -c 32 /dev/urandom | od -An -tx1 | tr -d ' \n')}

on() {  # HOST WELL FAILED COMMAND...: a line for sh, whatever the shell is there; what it says is shown if it fails
  local host=$1 well=$2 failed=$3 line said; shift 3
  line="read -r RAY_AUTH_TOKEN; export RAY_AUTH_TOKEN RAY_AUTH_MODE=token RAY_USAGE_STATS_ENABLED=0; $*"
  # shellcheck disable=SC2029  # it is made here, and meant to be
  if said=$(${SSH:-ssh} "$host" "sh -c '${line//\'/\'\\\'\'}'" 2>&1 <<< "$RAY_AUTH_TOKEN"); then
    # Without a route to the world Ray asks the host for its own name, which Debian says is at 127.0.1.1.
    if [ "$well" = head ] && [ ${#hosts[@]} -gt 1 ] && grep -q 'Local node IP: 127\.' <<< "$said"; then
      echo "error: $host is $(grep -o '127\.[0-9.]*' <<< "$said" | head -n 1) to itself, where no other host reaches it;" \
        "after down, HEAD_OPTIONS=--node-ip-address=ADDRESS" >&2
      return 1
    fi
    echo "$host: $well" >&2
  else
    [ -z "$said" ] || tail -n 5 <<< "$said" | sed "s/^/$host: /" >&2
    echo "error: $host $failed" >&2
    return 1
  fi
}

on_each() {  # WELL FAILED COMMAND HOST...: side by side
  local well=$1 failed=$2 command=$3 status=0 host pid pids=(); shift 3
  for host; do on "$host" "$well" "$failed" "$command" & pids+=($!); done
  for pid in "${pids[@]}"; do wait "$pid" || status=1; done
  return $status
}

up() {
  local address=${HEAD_ADDRESS:-${head#*@}}:$port start="$venv/bin/ray start --log-color=false" status=0
  on "$head" head 'did not become the head' \
    "$start --head --port=$port --include-dashboard=false --disable-usage-stats ${HEAD_OPTIONS:-}"
  on_each joined 'could not join' "$start --address=$address ${NODE_OPTIONS:-}" "${hosts[@]:1}" || status=1
  echo "# on $head, or another of the hosts:"
  echo "export RAY_AUTH_MODE=token RAY_AUTH_TOKEN=$RAY_AUTH_TOKEN"
  echo "$venv/bin/swarmer sweep FILE --ray $address"
  return $status
}

down() { on_each stopped 'could not be stopped' "$venv/bin/ray stop" "${hosts[@]}"; }

case $action in up) up ;; down) down ;; *) usage ;; esac
