"""The page about scaling, from what was counted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scaling import words
from scaling.model import COSTS, HOST, OWNER_MS, Growth, Measured, Need, need, per_fls, seconds

BIG = (1_000, 10_000, 100_000, 1_000_000)
SCALES = (1.0, 0.1)
GROWING = ("SET_WAITING", "SET_AVAILABLE", "FOLLOW_MERGE", "NEIGHBOUR", "THAW")
FREE, OWNED = "centralized", "roster"


def page(kept: dict[str, Measured]) -> str:
    """All of it. kept: by `POLICY F`, as `measure` gives them."""
    free, owned = of_policy(kept, FREE), of_policy(kept, OWNED)
    growth = Growth(free)
    parts = [
        "<!-- made by scripts/scaling_page.py; do not edit -->",
        "# Toward a million FLSs",
        words.INTRODUCTION,
        "## How many hosts",
        words.HOSTS.format(cores=HOST.cores, memory=HOST.memory_gb, busy=round(100 * HOST.busy)),
        hosts(growth),
        words.WALLS,
        "## What a formation takes",
        words.FORMATIONS,
        formations(free),
        laws(growth),
        "Delivered to an FLS in a formation, by kind:",
        kinds(free),
        words.KINDS,
        "## The first wall: an owner that counts",
        words.OWNER.format(ms=OWNER_MS, per_s=round(1e3 / OWNER_MS), million=round(OWNER_MS * 1e3)),
        owners(owned, free),
        words.OWNER_FINDING,
        "## What crosses from host to host",
        words.CROSSING,
        crossings(free),
        "## What things cost",
        table(
            ("", "", "printed by"),
            [(one.what, f"{one.value:g} {one.unit}", f"`{one.how}`") for one in COSTS],
        ),
        "## Do the laws hold?",
        words.CHECK,
        checks(free),
        "## What would help",
        words.HELP,
        "## Assumptions",
        words.ASSUMPTIONS,
    ]
    return "\n\n".join(parts) + "\n"


def of_policy(kept: dict[str, Measured], policy: str) -> list[Measured]:
    """The formations under one thaw policy, smallest first."""
    return [one for key, one in kept.items() if key.split()[0] == policy]


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """In Markdown."""
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def formations(free: list[Measured]) -> str:
    """What a formation takes, by size."""
    head = (
        "FLSs",
        "s",
        "sent",
        "delivered",
        "for many, of all",
        "largest",
        "in the busiest 0.1 s",
        "p99 late, ms",
    )
    return table(head, [
        (f"{one['points']:,}", f"{seconds(one):.1f}", f"{per_fls(one, 'sent'):.1f}",
         f"{per_fls(one, 'delivered'):.0f}", f"{per_fls(one, 'broadcasts') / per_fls(one, 'sent'):.1%}",
         f"{max(kind['largest'] for kind in one['kinds'].values()):,}",
         f"{one['busiest_bin'] / one['points']:.1f}", f"{one['handled_late_ms'][1]:.0f}")
        for one in free
    ])  # fmt: skip


def laws(growth: Growth) -> str:
    """The exponents, in words."""
    longer, more = (1000 ** growth.exponent(name) for name in ("seconds", "delivered"))
    return (
        f"The time of a formation grows as F^{growth.exponent('seconds'):.2f}, what an FLS is delivered as "
        f"F^{growth.exponent('delivered'):.2f}:\na thousand times the FLSs take {longer:.0f} times as long, and each "
        f"gets {more:.1f} times as much. So in a *second* an FLS of\na large display gets less than one of a small "
        "one, and a host carries more of them."
    )


def kinds(free: list[Measured]) -> str:
    """Deliveries by kind and size."""
    rows = []
    for one in free:
        each = [per_fls(one, "delivered", kind) for kind in GROWING]
        rest = per_fls(one, "delivered") - sum(each)
        rows.append((f"{one['points']:,}", *(f"{value:.1f}" for value in [*each, rest])))
    return table(("FLSs", *(f"`{kind}`" for kind in GROWING), "all others"), rows)


def owners(owned: list[Measured], free: list[Measured]) -> str:
    """What an owner that counts costs."""
    at_once = {one["points"]: seconds(one) for one in free}
    head = (
        "FLSs",
        "s, `centralized`",
        "s, `roster`",
        "COUNT sent, by FLS",
        "to the busiest FLS",
        "p99 late, ms",
    )
    return table(head, [
        (f"{one['points']:,}", f"{at_once[one['points']]:.1f}", f"{seconds(one):.1f}",
         f"{per_fls(one, 'sent', 'COUNT'):.1f}", f"{one['busiest_fls']:,}", f"{one['handled_late_ms'][1]:,.0f}")
        for one in owned if one["points"] in at_once
    ])  # fmt: skip


def crossings(free: list[Measured]) -> str:
    """Copies between hosts, by FLS and formation, by FLSs on a host."""
    pers = sorted({per for one in free for per in one["per_host"]})
    rows = []
    for one in free:
        copies = {
            per: sum(kind["crossings"][index] for kind in one["kinds"].values()) / one["points"]
            for index, per in enumerate(one["per_host"])
        }
        if copies:
            rows.append(
                (f"{one['points']:,}", *(f"{copies[per]:.2f}" if per in copies else "" for per in pers))
            )
    return table(("FLSs", *(f"{per:,} on a host" for per in pers)), rows)


def hosts(growth: Growth) -> str:
    """The main table."""
    head = ("FLSs", "time scale", "hosts", "FLSs on each", "bound by", "copies/s at a relay", "relay, cores",
            "filters, cores")  # fmt: skip
    return table(head, [row(need(growth, points, scale)) for points in BIG for scale in SCALES])


def row(one: Need) -> tuple[str, ...]:
    """Of the main table."""
    return (
        f"{one.points:,}", f"{one.scale:g}", f"{one.hosts:,}", f"{one.each:,}", one.bound,
        f"{one.relayed:,.0f}", f"{one.relay_busy:.2f}", f"{one.filters:.2f}",
    )  # fmt: skip


def checks(free: list[Measured]) -> str:
    """The largest formation, predicted from the smaller ones."""
    *smaller, largest = free
    growth, points = Growth(smaller), largest["points"]
    rows = [
        ("s of a formation", growth.of("seconds", points), seconds(largest)),
        ("delivered by FLS", growth.of("delivered", points), per_fls(largest, "delivered")),
        ("broadcasts by FLS", growth.of("broadcasts", points), per_fls(largest, "broadcasts")),
    ]
    for index, per in enumerate(largest["per_host"]):
        counted = sum(kind["crossings"][index] for kind in largest["kinds"].values()) / points
        rows.append((f"copies by FLS, {per:,} on a host", growth.copies("crossings", points, per), counted))
    return table(
        (f"{points:,} FLSs", "predicted from less", "counted", "counted / predicted"),
        [(name, f"{said:.3g}", f"{found:.3g}", f"{found / said:.2f}") for name, said, found in rows],
    )
