"""The event log in sentences: what happened to an FLS and what it did because of it, a line for each event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from swarmer.observe.trace_file import Record

FATE_WORDS = {
    "run": "of another run", "sender": "from nobody in this run", "address": "not for it any more",
    "range": "out of range", "own": "from its own swarm", "lost": "lost at the receiver",
    "delayed": "held back by the radio", "replayed": "received before or out of date", "answered": "answered at once",
}  # fmt: skip
# What does not change how a story goes on; shown only if everything is.
QUIET_FATES = {"run", "sender", "address", "range", "own", "delayed", "queued", "noted", "dropped"}
EVENT_WORDS = {
    "launch": "launched", "landed": "landed", "measured": "measured its anchor", "bound over": "waited long enough",
    "lease over": "a lease ran out", "renew due": "half a lease is over", "thaw due": "its thaw timer is over",
    "battery low": "its battery is low",
    "new shape": "the next shape begins",
}  # fmt: skip
STATE_WIDTH = len("BusyLocalizing -> Available")
PAIRED = {"BusyAnchor", "BusyLocalizing"}


@dataclass(slots=True)
class Scene:
    """One event at one FLS, and all that came of it at once."""

    t_s: float
    fid: int
    first: Record
    before: list[object] | None = None  # [state, ξ, epoch, flying, leases]
    after: list[object] | None = None
    words: list[str] = field(default_factory=list)
    more: list[Record] = field(default_factory=list)  # what was sent, flown and measured because of it
    quiet: bool = False

    def line(self, points: int) -> str:
        """Aligned columns: second, FID, state, Swarm-ID, what happened; points: F."""
        digits = len(str(points))
        state = change(self.before, self.after, 0, " -> ")
        xi = change(self.before, self.after, 1, "->")
        columns = f"{self.t_s:10.4f} s  {self.fid:>{digits}}  {state:<{STATE_WIDTH}}  "
        return f"{columns}{'xi ' + xi if xi else '':<{5 + 2 * digits}}  {'; '.join(self.words)}".rstrip()


def fate_words(fate: str) -> str:
    """What became of a datagram at a receiver (`result.FATES`)."""
    return FATE_WORDS.get(fate, fate)


def change(before: list[object] | None, after: list[object] | None, at: int, arrow: str) -> str:
    """One part of a state, or how it changed."""
    old, new = (state[at] if state else None for state in (before, after or before))
    if old is None or new is None or old == new:
        return str(old if new is None else new) if (old or new) else ""
    return f"{old}{arrow}{new}"


def scenes(records: Iterable[Record]) -> Iterator[Scene]:
    """Gather records into scenes: what is sent and flown belongs to the event before it, and so does a measurement
    taken at once.
    """
    scene: Scene | None = None
    for record in records:
        kind = record.get("is")
        if scene is not None and _belongs(record, scene):
            _go_on(scene, record)
            continue
        if scene is not None:
            yield scene
        scene = None
        if kind in _BEGINNINGS:
            scene = Scene(record["t"], record["fid"], record)
            _BEGINNINGS[kind](scene, record)
        elif kind in ("sent", "flew"):  # its event is not among these records
            scene = Scene(record["t"], record["fid"], record)
            _go_on(scene, record)
    if scene is not None:
        yield scene


def _belongs(record: Record, scene: Scene) -> bool:
    if record.get("fid") != scene.fid or record.get("t") != scene.t_s:
        return False
    if record["is"] in ("sent", "flew"):
        return True
    measured = record["is"] == "handled" and record["event"] == "measured"
    return measured and scene.after is not None and scene.after[0] == "BusyLocalizing"


def _go_on(scene: Scene, record: Record) -> None:
    scene.quiet = False
    scene.more.append(record)
    if record["is"] == "sent":
        scene.words.append(sent_words(record))
    elif record["is"] == "flew":
        scene.words.append(f"flies {record['cells']:.2f} cells, until {record['until']:.4f} s")
    elif "after" in record:
        scene.after = record["after"]


def sent_words(record: Record) -> str:
    """A datagram that is sent: kind, addressee, id, and what its sender's end of the radio makes of it."""
    copies = record.get("copies", 1)
    fate = {0: ", lost at the sender", 1: ""}.get(copies, f", {copies} copies")
    return f"{record['kind']} to {record['to']} [{record['message']}]{fate}"


def _made(scene: Scene, record: Record) -> None:
    replaced = record["incarnation"]
    scene.words.append(
        f"takes the place of its predecessor, incarnation {replaced}" if replaced else "is ready"
    )


def _ended(scene: Scene, record: Record) -> None:
    scene.words.append("failed: went dark" if record["how"] == "failed" else "departed to charge")


def _heard(scene: Scene, record: Record) -> None:
    fate = record["fate"]
    scene.words.append(f"{record['kind']} {sender(record['message'])}: {fate_words(fate)}")
    scene.quiet = fate in QUIET_FATES


def _handled(scene: Scene, record: Record) -> None:
    scene.before, scene.after = record["before"], record.get("after")
    event = record["event"]
    datagram = "xi" in record
    text: str
    if datagram:
        text = f"{record.get('kind', event)} {sender(record['cause'], record['xi'])}"
        if record.get("joins"):
            text += ", a newcomer"
    else:
        text = str(EVENT_WORDS.get(event, event))
        if event == "landed" and record["before"][0] == "Deploying":
            text = "landed: lit"
    scene.words.append(text + _pairing(record))
    if why := record.get("why"):
        scene.words.append(why)
    if judged := record.get("judged"):
        scene.words.append(f"judges what waited: {', '.join(judged)}")
    after = record.get("after")
    if after and after[2] != record["before"][2]:
        scene.words.append(f"epoch {record['before'][2]}->{after[2]}")
    if after and after[4] != record["before"][4] and after[4]:
        scene.words.append(f"{after[4]} lease" + ("s" if after[4] > 1 else ""))
    scene.quiet = not after and "why" not in record and "judged" not in record


def _pairing(record: Record) -> str:
    """Who anchors, if this event paired two FLSs."""
    before, after = record["before"], record.get("after")
    if (
        record["event"] not in ("ACCEPT", "ACK")
        or not after
        or after[0] not in PAIRED
        or after[0] == before[0]
    ):
        return ""
    own, theirs = _number(before[1]), _number(record["xi"])
    anchors = after[0] == "BusyAnchor"
    lower = own < theirs if anchors else theirs < own
    who = record["fid"] if anchors else record["cause"].partition(".")[0]
    return f"{', lower' if lower else ''}: {who} anchors"


def _number(xi: str) -> tuple[int, ...]:
    return tuple(map(int, xi.split(".")))


_BEGINNINGS = {"made": _made, "ended": _ended, "heard": _heard, "handled": _handled}


def sender(message: str, xi: str | None = None) -> str:
    """`from 4 (xi 4) [4.0#203]`."""
    fid = message.partition(".")[0]
    known = f" (xi {xi})" if xi not in (None, "0") else ""
    return f"from {fid if fid != '0' else 'the engine'}{known} [{message}]"
