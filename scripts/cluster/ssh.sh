#!/usr/bin/env bash
# Ray on a list of hosts, over ssh:  scripts/cluster/ssh.sh up HOSTS [VENV]   then   swarmer sweep FILE --ray HEAD:6379
#                                    scripts/cluster/ssh.sh down HOSTS [VENV]
# HOSTS: a file with a host a line, as ssh takes it; the first becomes the head. VENV: where swarmer[cluster] is
# installed on every host (default ~/swarmer). SSH: what starts a program on a host (default ssh).
# PORT: of the head (default 6379). The sweep is started on one of the hosts, with the token that `up` prints.
set -euo pipefail

usage() { sed -n '2,6s/^# //p' "$0" >&2; exit 2; }
if [ $# -lt 2 ] || [ ! -r "$2" ]; then usage; fi
action=$1 venv=${3:-\~/swarmer} port=${PORT:-6379}
mapfile -t hosts < <(sed 's/#.*//; s/[[:space:]]//g; /^$/d' "$2")
[ ${#hosts[@]} -ge 1 ] || { echo "error: $2 names no host" >&2; exit 2; }
head=${hosts[0]}

on() {  # HOST COMMAND...: the command is a line for the host's shell, which reads the token first
  local host=$1; shift
  # shellcheck disable=SC2029  # it is made here, and meant to be
  ${SSH:-ssh} "$host" "read -r RAY_AUTH_TOKEN; export RAY_AUTH_TOKEN RAY_AUTH_MODE=token; $*" <<< "$RAY_AUTH_TOKEN"
}

# Ray takes nobody without the cluster's token. It is on no command line, where others on a host would see it.
RAY_AUTH_TOKEN=${RAY_AUTH_TOKEN:-$(head -c 32 /dev/urandom | od -An -tx1 | tr -d ' \n')}

up() {
  local address=${HEAD_ADDRESS:-${head#*@}}:$port start="RAY_USAGE_STATS_ENABLED=0 $venv/bin/ray start" failed=0
  on "$head" "$start --head --port=$port --include-dashboard=false --disable-usage-stats ${HEAD_OPTIONS:-}" >&2
  local joining=()
  for host in "${hosts[@]:1}"; do
    on "$host" "$start --address=$address ${NODE_OPTIONS:-}" >&2 & joining+=($!)
  done
  for at in "${!joining[@]}"; do
    wait "${joining[$at]}" || { echo "error: ${hosts[at + 1]} could not join" >&2; failed=1; }
  done
  echo "export RAY_AUTH_MODE=token RAY_AUTH_TOKEN=$RAY_AUTH_TOKEN"
  echo "swarmer sweep FILE --ray $address"
  return $failed
}

down() {
  for host in "${hosts[@]}"; do on "$host" "$venv/bin/ray stop" >&2 || echo "$host: could not be stopped" >&2; done
}

case $action in up) up ;; down) down ;; *) usage ;; esac
