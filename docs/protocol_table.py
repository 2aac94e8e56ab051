"""The protocol's table as a page shows it: drawn from `swarmer.state_machine.TABLE` whenever the docs are built."""

from __future__ import annotations

from html import escape
from typing import NamedTuple

from swarmer.messages import Kind
from swarmer.observe.palette import STATE_COLOURS, STATES
from swarmer.protocol.events import Local
from swarmer.state_machine import TABLE, State

SHORT = {
    State.DEPLOYING: "D", State.AVAILABLE: "A", State.BUSY_ANCHOR: "BA", State.BUSY_LOCALIZING: "BL",
    State.WAITING: "W",
}  # fmt: skip
LOCAL_WORDS = {
    Local.CHALLENGE_DUE: "challenge due", Local.BOUND_OVER: "bound over", Local.LEASE_OVER: "lease over",
    Local.RENEW_DUE: "renew due", Local.THAW_DUE: "thaw due", Local.REPORT_DUE: "report due",
    Local.LAUNCH: "launch", Local.LANDED: "landed",
    Local.MEASURED: "measured", Local.BATTERY_LOW: "battery low",
    Local.NEW_SHAPE: "new shape",
}  # fmt: skip

# What each rule of the table does, and the numbers of the page's rules that it follows.
WORDS: dict[str, tuple[str, str]] = {
    "launch": ("1", "Fly to the own point by dead reckoning; start the thaw timer."),
    "light_up": ("1, 15", "Light up, take the own FID as Swarm-ID, start the challenge timer; or fly on, if the "
                 "shape has changed."),
    "challenge_due": ("2, 9", "Challenge, unless R-Complete; widen the range if the last challenge found no taker."),
    "skip_tick": ("2", "Busy: this tick passes. (With `waiting_ends: tick` it ends Waiting.)"),
    "accept": ("3, 9, 10", "Another swarm: accept if Available, or if anchoring and the Swarm-IDs allow it. The own "
               "swarm: answer NEIGHBOUR if the sender is a planned neighbour."),
    "answer_neighbour": ("9", "Localizing: only the question of a planned neighbour of the own swarm has an answer."),
    "take_acceptance": ("4", "The first acceptance of the open challenge pairs; any other is cancelled."),
    "take_more": ("4", "A challenger that became anchor takes later acceptances too, while M allows."),
    "take_ack": ("4, 8", "Pair, if the acceptance is remembered and the Swarm-ID it named is still ours; else cancel."),
    "refuse": ("8", "Answer LEASE_CANCEL, so that the sender does not wait for nothing."),
    "localize": ("5", "Compute V, take the anchor's Swarm-ID, tell the old swarm, fly (below the threshold: merge)."),
    "finish": ("5", "Landed: tell the anchor that it may go."),
    "renew_lease": ("5", "Half a lease is over and the localization is not: renew."),
    "cancelled": ("5, 7", "The anchor cancels this pairing: on the ground give up, free the swarm; in flight finish."),
    "forget_accept": ("3", "The challenger has somebody else: that acceptance is forgotten."),
    "free": ("7", "FIN: that lease is over. After the last one: Available, and the swarm is told so."),
    "finished_first": ("7", "FIN that has overtaken its ACK: the accept is forgotten, so the ACK will be cancelled."),
    "cancel_lease": ("7", "As FIN, but nobody has merged; only if it is of the challenge that the lease is for."),
    "lease_over": ("7", "A localizer was not heard of for a lease: as if it had finished."),
    "renewed": ("5", "Extend the lease, or grant one where rule 3 allows; else cancel."),
    "wait": ("4", "Stand still: the sender's pairing concerns the whole swarm."),
    "resume": ("7", "The sender no longer holds this FLS; when nobody does, Available."),
    "note_size": ("4", "Only the swarm's size is news."),
    "follow": ("5, 6", "Fly V."),
    "merge": ("5, 6", "Take the new Swarm-ID; an anchor keeps its leases."),
    "follow_merge": ("5, 6", "Take the new Swarm-ID, then fly V."),
    "follower_landed": ("6, 15", "The flight is over; or there is a way on, if the shape has changed."),
    "bound_over": ("7", "Nobody said anything for max(λ, 2δ): go on alone."),
    "thaw_due": ("11", "Begin the next epoch: THAW to all, and obey it."),
    "rearm_thaw": ("11", "Not lit yet: try again later."),
    "hear_thaw": ("11, 12", "Without epochs: thaw at most once per λ, and repeat it by chance."),
    "hear_leave": ("13", "Forget what the sender's Swarm-ID was."),
    "hear_count": ("11", "`roster`, `census`: the sender is in this FLS's swarm, or leaves it. All are there: thaw."),
    "hear_roll_call": ("11", "`roster`: report again, if the owner of the own swarm asks."),
    "hear_announcement": ("11", "`corner`: another swarm objects; the same one repeats it by chance, and thaws at 3 "
                          "copies."),
    "hear_abort": ("11", "`corner`: forget the copies; a corner tries again later."),
    "report_due": ("11", "By the policy's clock: `roster` asks the missing, `census` reports, a `corner` announces."),
    "change_shape": ("15", "Begin the first epoch of the next shape and fly to the own point in it; who has none "
                     "leaves. Who flies does so after its landing."),
    "leave": ("13", "On the ground: tell the neighbours, free who waits, go."),
}  # fmt: skip


def table_html() -> str:
    """Events down, states across; a cell names the rule and the states it may lead to."""
    head = "".join(
        f"<th>{escape(name)} ({SHORT[state]})</th>" for state, name in zip(State, STATES, strict=True)
    )
    rows = "".join(_row(key) for key in _keys())
    return f"<table><thead><tr><th>event</th>{head}</tr></thead><tbody>{rows}</tbody></table>"


def rules_html() -> str:
    """Every rule that the table names, in the order in which it first does."""
    rows = "".join(
        f'<tr id="{name}"><td>{_said(name)}</td><td>{_marked(words)}</td><td>{numbers}</td></tr>'
        for name, (numbers, words) in ((name, WORDS[name]) for name in named())
    )
    return (
        "<table><thead><tr><th>in the table</th><th>what it does</th><th>rule</th></tr></thead>"
        f"<tbody>{rows}</tbody></table>"
    )


def named() -> list[str]:
    """The names of the rules that the table uses."""
    return list(dict.fromkeys(rule.act.__name__ for state in State for rule in TABLE[state].values()))


def word(key: Kind | Local) -> str:
    """An event as the page calls it."""
    return LOCAL_WORDS[key] if isinstance(key, Local) else key.name


def _keys() -> list[Kind | Local]:
    used = {key for state in State for key in TABLE[state]}
    return sorted(used, key=int)


def _row(key: Kind | Local) -> str:
    cells = "".join(_cell(state, key) for state in State)
    return f"<tr><td><strong>{word(key)}</strong></td>{cells}</tr>"


def _cell(state: State, key: Kind | Local) -> str:
    rule = TABLE[state].get(key)
    if rule is None:
        return "<td></td>"
    leads = ", ".join(SHORT[after] for after in rule.leads_to if after is not state)
    arrow = f" → {leads}" if leads else ""
    return f'<td><a href="#{rule.act.__name__}">{_said(rule.act.__name__)}</a>{arrow}</td>'


def _said(name: str) -> str:
    return name.replace("_", " ").replace("fls", "FLS")


def _marked(text: str) -> str:
    parts = escape(text).split("`")
    return "".join(f"<code>{part}</code>" if i % 2 else part for i, part in enumerate(parts))


# -- the picture -----------------------------------------------------------------------------------------------------

WIDTH, HEIGHT, BOX, TALL, LINE = 1000, 500, 164, 48, 18
PLACES = {
    State.DEPLOYING: (120, 80), State.AVAILABLE: (500, 80), State.BUSY_ANCHOR: (120, 420),
    State.WAITING: (500, 420), State.BUSY_LOCALIZING: (880, 420),
}  # fmt: skip


class Way(NamedTuple):
    """How a transition is drawn: from and to which points, and where its words stand."""

    start: tuple[int, int]
    end: tuple[int, int]
    words: tuple[int, int]  # of the first line
    anchor: str  # start | middle | end


D, A, BA, BL, W = State
WAYS = {
    (D, A): Way((200, 80), (418, 80), (310, 68), "middle"),
    (BA, A): Way((130, 397), (438, 105), (226, 205), "end"),
    (A, BA): Way((470, 105), (170, 395), (258, 345), "start"),
    (A, W): Way((490, 105), (490, 395), (480, 228), "end"),
    (W, A): Way((510, 397), (510, 105), (520, 232), "start"),
    (A, BL): Way((530, 105), (830, 395), (742, 345), "end"),
    (BL, A): Way((870, 397), (562, 105), (774, 205), "start"),
    (BL, W): Way((798, 420), (582, 420), (690, 444), "middle"),
    (W, BA): Way((418, 430), (202, 430), (310, 454), "middle"),
    (BA, W): Way((202, 410), (418, 410), (310, 402), "middle"),
}


def transitions() -> dict[tuple[State, State], list[str]]:
    """Which events may lead from one state to another, by the table."""
    found: dict[tuple[State, State], list[str]] = {}
    for state in State:
        for key in sorted(TABLE[state], key=int):
            for after in TABLE[state][key].leads_to:
                if after is not state:
                    found.setdefault((state, after), []).append(word(key))
    return found


def picture_svg() -> str:
    """The states and every way between them."""
    ways = "".join(_way(WAYS[pair], words) for pair, words in transitions().items())
    boxes = "".join(
        _box(state, name, colour) for state, name, colour in zip(State, STATES, STATE_COLOURS, strict=True)
    )
    return (
        f'<div><svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="The five states and the events that lead '
        'from one to another" style="width:100%;height:auto" font-family="sans-serif">'
        '<defs><marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" markerHeight="8" '
        'orient="auto"><path d="M0 0 10 5 0 10z" fill="currentColor"/></marker></defs>'
        f"{ways}{boxes}</svg></div>"
    )


def _box(state: State, name: str, colour: str) -> str:
    x, y = PLACES[state]
    return (
        f'<rect x="{x - BOX // 2}" y="{y - TALL // 2}" width="{BOX}" height="{TALL}" rx="8" fill="{colour}"/>'
        f'<text x="{x}" y="{y + 6}" text-anchor="middle" font-size="18" fill="#0b0e14">{name}</text>'
    )


def _way(way: Way, words: list[str]) -> str:
    (x1, y1), (x2, y2) = way.start, way.end
    x, y = way.words
    lines = "".join(
        f'<text x="{x}" y="{y + LINE * i}" text-anchor="{way.anchor}" font-size="14.5" '
        f'fill="currentColor">{text}</text>'
        for i, text in enumerate(words)
    )
    return (
        f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="currentColor" stroke-width="1.3" '
        f'marker-end="url(#tip)"/>{lines}'
    )
