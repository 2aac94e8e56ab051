"""What a datagram costs on each carrier, to one FLS and to a swarm, with many others listening."""

from __future__ import annotations

import socket
import time
from statistics import median

from bench.receivers import GRID, Cost, Receivers, membership
from bench.tables import ratio, show
from swarmer.messages import Swarm
from swarmer.udp_wrapper import BROADCAST, Filter, address_of, open_socket

COUNTS = (100, 760, 1727)
MEMBERS = 10  # of the swarm that is told something
CHANGES = 300

COLUMNS = (
    "sockets", "unicast to 1", f"to {MEMBERS} by unicast", "", "broadcast, kernel filter", "",
    "broadcast, Python rule", "", "multicast", "",
)  # fmt: skip
NOTES = (
    f"µs of processor time per message, sender and all receivers together; one process each; a swarm of {MEMBERS};",
    "ratios are to one unicast datagram. Python rule: every process wakes up, decodes and drops it.",
    "multicast: one group per swarm, joined by its members.",
)


def run(repeat: int) -> None:
    """Print both tables."""
    costs, changes = [], []
    for count in COUNTS:
        with Receivers(count, MEMBERS) as receivers:
            costs.append(row(receivers, repeat))
            changes.append(change(receivers))
    show("datagrams: µs per message", COLUMNS, costs, NOTES)
    show(
        "datagrams: µs for an FLS to change its swarm",
        ("sockets", "new filter on two sockets", "leave one group, join another", ""), changes,
        ["the filter is patched and attached to both sockets, as at every merge and thaw"],
    )  # fmt: skip


def row(receivers: Receivers, repeat: int) -> list[object]:
    """All carriers in turn, `repeat` times."""
    ways = (
        (receivers.to_one, 300), (receivers.to_members, 60), (receivers.broadcast_filtered, 100),
        (receivers.broadcast_plain, max(5, 5000 // receivers.count)), (receivers.multicast_group, 100),
    )  # fmt: skip
    found: list[list[Cost]] = [[receivers.cost(send, times) for send, times in ways] for _ in range(repeat)]
    middle = [median(cost[at].total_us for cost in found) for at in range(len(ways))]
    cells: list[object] = [receivers.count, middle[0]]
    for cost in middle[1:]:
        cells += [cost, ratio(cost, middle[0])]
    return cells


def change(receivers: Receivers) -> list[object]:
    """What it costs to be of another swarm, by filter and by group."""
    ears = receivers.ears(1)
    rule = Filter(ears, GRID, True)
    address = address_of(receivers.count + 2)
    with (
        open_socket(address, receivers.filtered) as one,
        open_socket(BROADCAST, receivers.filtered, shared=True) as two,
    ):
        began = time.perf_counter()
        for number in range(CHANGES):
            rule.patch(Swarm(number + 1, 0))
            rule.attach(two)
            rule.attach(one)
        filters = 1e6 * (time.perf_counter() - began) / CHANGES
    groups = change_groups(receivers.group_mouth)
    return [receivers.count, filters, groups, ratio(groups, filters)]


def change_groups(sock: socket.socket) -> float:
    """µs for leaving a group and joining another."""
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership(60_000))
    began = time.perf_counter()
    for number in range(60_000, 60_000 + CHANGES):
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_DROP_MEMBERSHIP, membership(number))
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership(number + 1))
    return 1e6 * (time.perf_counter() - began) / CHANGES
