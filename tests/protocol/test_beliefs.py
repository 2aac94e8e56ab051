from swarmer.messages import Kind, Message, Swarm, To
from swarmer.protocol.beliefs import Beliefs


def heard(sender, swarm):
    return Message(Kind.NEIGHBOUR, sender, 0, 0, swarm, 1, (0.0, 0.0, 0.0), To.FLS, Swarm(9, 0))


def test_complete_is_when_every_planned_neighbour_said_so_itself():
    mine, beliefs = Swarm(1, 0), Beliefs((2, 3))
    assert not beliefs.complete(mine)
    beliefs.note(heard(2, mine))
    beliefs.note(heard(4, mine))  # no planned neighbour: says nothing about 3
    assert beliefs.of(4) is None
    assert not beliefs.complete(mine)
    beliefs.note(heard(3, mine))
    assert beliefs.complete(mine)
    assert not beliefs.complete(Swarm(1, 1)), "a replaced owner's swarm is another"


def test_the_last_word_counts():
    beliefs = Beliefs((2,))
    beliefs.note(heard(2, Swarm(1, 0)))
    beliefs.note(heard(2, Swarm(2, 0)))
    assert not beliefs.complete(Swarm(1, 0))
    assert beliefs.complete(Swarm(2, 0))


def test_what_is_forgotten_is_not_believed():
    beliefs = Beliefs((2, 3))
    for fid in (2, 3):
        beliefs.note(heard(fid, Swarm(1, 0)))
    beliefs.forget(2)
    beliefs.forget(77)
    assert beliefs.of(2) is None
    assert not beliefs.complete(Swarm(1, 0))
    beliefs.note(heard(2, Swarm(1, 0)))
    beliefs.clear()
    assert beliefs.of(3) is None


def test_who_has_no_neighbours_is_complete():
    assert Beliefs(()).complete(Swarm(1, 0))
