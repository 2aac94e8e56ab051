"""From symptom to cause: what the event log says of the moments at which HD rose, in sentences.

`Cause` holds what is said of one moment and which FLSs take part in it; `cause_page` shows them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from swarmer.observe.kept_scenes import Moment
from swarmer.observe.moves import Change, Flight, Move, Moves
from swarmer.observe.rises import Off, Rise
from swarmer.observe.words import cells

LEAD_S = 0.15  # of the story before a rise: a pairing and its flight take about as long
NAMED = 4  # FLSs that a sentence names; of more it says how many
TOLD = 3  # reasons that are told for one moment
CAST_MOST = 8


class Cause(NamedTuple):
    """Why HD rose, as far as the log tells."""

    rise: Rise
    sentences: tuple[str, ...]
    moves: tuple[Move, ...]
    moment: Moment  # the story that belongs to it


class _Reason(NamedTuple):
    """What an FLS did, or did not do, while HD rose."""

    kind: str  # lit | flew | missed | stayed
    move: Move | None = None
    change: Change | None = None


def cause_of(rise: Rise, log: Moves) -> Cause:
    """What led to a rise."""
    reasons: dict[tuple[str, object], tuple[_Reason, list[Off]]] = {}
    for off in rise.off:
        reason = _reason(off, rise, log)
        key = (reason.kind, off.fid if reason.change else id(reason.move))
        reasons.setdefault(key, (reason, []))[1].append(off)
    told = list(reasons.values())[:TOLD]
    sentences = [sentence for reason, offs in told for sentence in _sentences(reason, offs, rise, log)]
    sentences += _meanwhile(rise, log)
    moves = tuple(dict.fromkeys(reason.move.message for reason, _ in told if reason.move))
    concerned = tuple(log.moves[name] for name in moves)
    cast = _cast(told, concerned)
    from_s = min([rise.from_s, *(move.t_s for move in concerned)]) - LEAD_S
    return Cause(rise, tuple(sentences), concerned, Moment(cast, max(0.0, from_s), rise.to_s))


def _reason(off: Off, rise: Rise, log: Moves) -> _Reason:
    for change in log.changes:
        if change.fid == off.fid and change.what == "lit" and rise.from_s < change.t_s <= rise.to_s:
            return _Reason("lit", change=change)
    flights = [flight for flight in flights_in(rise, log.flights.get(off.fid, ())) if flight.move]
    if flights:
        return _Reason("flew", max(flights, key=lambda flight: flight.cells).move)
    for move in reversed(log.moves.values()):
        if rise.from_s - LEAD_S <= move.t_s <= rise.to_s and off.fid in move.missed():
            return _Reason("missed", move)
    return _Reason("stayed")


def flights_in(rise: Rise, flights: Iterable[Flight]) -> list[Flight]:
    """Those that were on their way between the two samples."""
    return [flight for flight in flights if flight.from_s <= rise.to_s and flight.until_s > rise.from_s]


def _sentences(reason: _Reason, offs: list[Off], rise: Rise, log: Moves) -> list[str]:
    worst = offs[0]
    was = "dark before" if worst.before_cells != worst.before_cells else f"{cells(worst.before_cells)} before"
    many = len(offs) > 1
    subject = f"{flss([off.fid for off in offs])} {'are' if many else 'is'} {'up to ' if many else ''}"
    lead = f"{subject}{cells(worst.after_cells)} cells off ({was}): "
    they = "they" if many else "it"
    if reason.change is not None:
        return [f"{lead}it {_landing(reason.change, log)}, as far off as dead reckoning left it."]
    if reason.move is None:
        others = f"{rise.moved} other{'s' * (rise.moved > 1)} did" if rise.moved else "the centroid did"
        return [f"{lead}{they} did not move; {others}."]
    move = reason.move
    if reason.kind == "missed":
        why = move.missed()[worst.fid]
        return [f"{lead}{they} did not fly the vector of FLS {move.localizer} [{move.message}]: {why}."]
    return [lead + _flew(move, worst, many, rise, log), *_others(move, offs)]


def _landing(change: Change, log: Moves) -> str:
    """That an FLS has landed, and whose place it takes."""
    gone = [
        one for one in log.changes if one.fid == change.fid and one.what == "dark" and one.t_s < change.t_s
    ]
    if not gone:
        return f"{change.words} at {change.t_s:.4f} s"
    return f"{gone[-1].words} at {gone[-1].t_s:.4f} s, was {change.words} at {change.t_s:.4f} s"


def _flew(move: Move, worst: Off, many: bool, rise: Rise, log: Moves) -> str:
    flight = next(flight for flight in move.flights if flight.fid == worst.fid)
    against = _against(move, rise)
    way = "" if flight.until_s <= rise.to_s else f", still on the way at {rise.to_s:.2f} s"
    if worst.fid == move.localizer and not many:
        return f"it localized{against} at {move.t_s:.4f} s and flew {cells(flight.cells)} cells{way} [{move.message}]."
    return (
        f"{'they' if many else 'it'} flew {cells(flight.cells)} cells{way}, the vector of FLS {move.localizer}, which "
        f"localized{against} at {move.t_s:.4f} s [{move.message}]."
    )


def _against(move: Move, rise: Rise) -> str:
    """The anchor, and how far it was off itself: whoever localizes against it gets the same error, and its own."""
    if not 1 <= move.anchor <= len(rise.before_by_fls):
        return ""
    off = float(rise.before_by_fls[move.anchor - 1])
    return f" against FLS {move.anchor}" + (f", {cells(off)} cells off itself," if off == off else "")


def _others(move: Move, offs: list[Off]) -> list[str]:
    """Who else flew that vector, and who should have."""
    named = {off.fid for off in offs} | {move.localizer}
    said = []
    if others := [fid for fid in move.flown_by if fid not in named]:
        said.append(f"{flss(others)} of its swarm flew it, too.")
    by_reason: dict[str, list[int]] = {}
    for fid, why in move.missed().items():
        by_reason.setdefault(why, []).append(fid)
    said += [f"{flss(fids)} of its swarm did not fly it: {why}." for why, fids in by_reason.items()]
    return said


def _meanwhile(rise: Rise, log: Moves) -> list[str]:
    """What else happened in those moments that moves HD."""
    during = [change for change in log.changes if rise.from_s < change.t_s <= rise.to_s]
    said = []
    if dark := [change.fid for change in during if change.what == "dark"]:
        said.append(f"{flss(dark)} went dark in these moments.")
    new = {change.fid for change in during if change.what == "lit"}  # these take up the epoch that they find
    if thawed := {change.fid for change in during if change.what == "thawed"} - new:
        said.append(f"{len(thawed)} FLS{'s' * (len(thawed) > 1)} thawed in these moments.")
    return said


def _cast(told: list[tuple[_Reason, list[Off]]], moves: Sequence[Move]) -> tuple[int, ...]:
    """Those who are off, whose vectors and anchors those are, who missed them; as many as a picture can hold."""
    fids: list[int] = [offs[0].fid for _, offs in told]
    for move in moves:
        fids += [move.localizer, *([move.anchor] if move.anchor else [])]
    fids += [off.fid for _, offs in told for off in offs[1:3]]
    fids += [fid for move in moves for fid in list(move.missed())[:2]]
    return tuple(dict.fromkeys(fids))[:CAST_MOST]


def flss(fids: Sequence[int]) -> str:
    """FLSs by their FIDs.

    >>> flss([7]), flss([7, 3]), flss([7, 3, 9, 1, 5, 2])
    ('FLS 7', 'FLS 7 and 3', 'FLS 7, 3, 9, 1 and 2 more')
    """
    if len(fids) <= NAMED:
        *most, last = map(str, fids)
        return f"FLS {', '.join(most)} and {last}" if most else f"FLS {last}"
    return f"FLS {', '.join(map(str, fids[:NAMED]))} and {len(fids) - NAMED} more"
