"""What the network thread answers at once, as a table (rules 8 and 9)."""

import pytest

from swarmer.messages import Kind, Message, Swarm, To
from swarmer.protocol.race import CANCEL, DROP, NOTE, NOTE_AND_ANSWER, QUEUE, answer, judge
from swarmer.protocol.records import View

MINE, THEIRS = Swarm(5, 0), Swarm(7, 0)
STATES = {  # awake, flying, available, anchoring
    "D": (False, False, False, False),
    "D flying": (False, True, False, False),
    "A": (True, False, True, False),
    "BA": (True, False, False, True),
    "Wa": (True, False, False, True),
    "BL": (True, False, False, False),
    "BL flying": (True, True, False, False),
    "Wl": (True, False, False, False),
    "W flying": (True, True, False, False),
}


def view(state, epoch=3):
    awake, flying, available, anchoring = STATES[state]
    return View(awake, epoch, flying, available, anchoring, MINE, 4)


def message(kind, swarm=THEIRS, sender=7, other=MINE, epoch=3, challenge=11):
    return Message(
        kind,
        sender,
        0,
        epoch,
        swarm,
        1,
        (0.0, 0.0, 0.0),
        To.FLS,
        Swarm(5, 0),
        challenge=challenge,
        other=other,
    )


def test_what_is_answered_by_cancelling_is_answered_once():
    """The handler does not see it again; all other verdicts leave one of the two to do the rest, or neither."""
    assert (CANCEL.reply, CANCEL.queue, CANCEL.note) == (Kind.LEASE_CANCEL, False, False)
    assert (QUEUE.reply, QUEUE.queue, QUEUE.note) == (None, True, False)
    assert (DROP.reply, DROP.queue, DROP.note) == (None, False, False)
    assert (NOTE.reply, NOTE.queue, NOTE.note) == (None, False, True)
    assert (NOTE_AND_ANSWER.reply, NOTE_AND_ANSWER.queue, NOTE_AND_ANSWER.note) == (
        Kind.NEIGHBOUR,
        False,
        True,
    )


def verdict(message, state, neighbours=frozenset({7}), reply=True):
    return judge(message, view(state), neighbours, reply)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ("D", DROP), ("D flying", DROP), ("A", QUEUE), ("BA", QUEUE), ("Wa", QUEUE), ("BL", NOTE), ("BL flying", DROP),
        ("Wl", NOTE), ("W flying", DROP),
    ],
)  # fmt: skip
def test_a_challenge_of_another_swarm(state, expected):
    assert verdict(message(Kind.CHALLENGE_INIT), state) == expected


@pytest.mark.parametrize("state", STATES)
def test_a_challenge_of_the_own_swarm_ends_here(state):
    init = message(Kind.CHALLENGE_INIT, swarm=MINE)
    deaf = "flying" in state or state == "D"
    assert verdict(init, state) == (DROP if deaf else NOTE_AND_ANSWER)
    assert verdict(init, state, reply=False) == (DROP if deaf else NOTE)
    assert verdict(init, state, neighbours=frozenset({8})) == (DROP if deaf else NOTE)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ("D", QUEUE), ("D flying", QUEUE), ("A", QUEUE), ("BA", QUEUE), ("Wa", QUEUE), ("BL", CANCEL),
        ("BL flying", CANCEL), ("Wl", CANCEL), ("W flying", CANCEL),
    ],
)  # fmt: skip
def test_an_ack_that_cannot_pair_is_cancelled_at_once(state, expected):
    assert verdict(message(Kind.CHALLENGE_ACK), state) == expected


def test_an_ack_for_a_swarm_that_is_no_more():
    late = message(Kind.CHALLENGE_ACK, other=Swarm(6, 0))
    assert verdict(late, "A") == verdict(late, "BA") == CANCEL
    assert verdict(message(Kind.CHALLENGE_ACK, other=Swarm(5, 1)), "A") == CANCEL
    assert verdict(late, "D") == QUEUE


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("kind", [Kind.CHALLENGE_INIT, Kind.CHALLENGE_ACK, Kind.FOLLOW_MERGE, Kind.THAW])
@pytest.mark.parametrize("epoch", [2, 4])
def test_another_epoch_is_for_the_handler(state, kind, epoch):
    assert verdict(message(kind, epoch=epoch), state) == QUEUE


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("kind", sorted(set(Kind) - {Kind.CHALLENGE_INIT, Kind.CHALLENGE_ACK}))
def test_all_else_is_for_the_handler(state, kind):
    assert verdict(message(kind), state) == QUEUE


def test_the_answer_is_the_state_as_published():
    reply = answer(message(Kind.CHALLENGE_ACK), Kind.LEASE_CANCEL, view("A"), 5, 2, (1.0, 2.0, 3.0))
    assert (reply.kind, reply.sender, reply.incarnation, reply.epoch) == (Kind.LEASE_CANCEL, 5, 2, 3)
    assert (reply.swarm, reply.size, reply.truth) == (MINE, 4, (1.0, 2.0, 3.0))
    assert (reply.to, reply.addressee.xi, reply.challenge) == (To.FLS, 7, 11)
