"""A short life that nobody sees, before the real one: what is first done costs many times what it costs later."""

from __future__ import annotations

from swarmer.fls_process import RunSpec
from swarmer.fls_spec import FlsSpec
from swarmer.messages import Kind, Message, Stamp, Swarm, To, decode, encode
from swarmer.physics.dead_reckoning import MODELS
from swarmer.physics.flight import plan_flight, position_at
from swarmer.plan import make_machine, make_velocity
from swarmer.protocol import race
from swarmer.protocol.events import Due, Fly, Landed, Launch, Received, Timer
from swarmer.radio import Ears, ReplayWindow, heard
from swarmer.state_machine import Identity, StateMachine
from swarmer.streams import stream

SPECIALISE, TOUCH = (
    40,
    6,
)  # rounds: until the interpreter has specialised the code; until the pages are copied


def warm_up(run: RunSpec, spec: FlsSpec, rounds: int) -> None:
    """Do once, on a scratch machine, what an FLS does all the time.

    In the dispatcher the interpreter specialises the code, once for all that are forked later. In an FLS the pages that
    will be written to are copied now: all FLSs land and challenge together, and that is no time for it.
    """
    identity = Identity(spec.fid, 0, spec.truth)
    machine = make_machine(run.rules, identity, spec.neighbours, spec.reach, stream(0, "warm-up"))
    ears = Ears(run.run, spec.fid, Swarm(spec.fid, 0), spec.truth, machine.beliefs.neighbours)
    window = ReplayWindow()
    machine.handle(Launch(spec.origin), 0.0)
    machine.handle(Landed(), 1.0)
    for number in range(1, rounds + 1):
        for message in _scenes(machine, spec):
            data = encode(message, Stamp(run.run, number, spec.truth, 1.0), run.key)
            received, stamp = decode(data, run.key)
            heard(received, stamp, ears, run.rules.count)
            window.fresh(received.sender, 0, number)
            race.judge(received, machine, machine.beliefs.neighbours, True)
            _live(run, spec, machine, received, float(number))
        machine.handle(Due(Timer.CHALLENGE), float(number))


def _live(run: RunSpec, spec: FlsSpec, machine: StateMachine, message: Message, now: float) -> None:
    velocity = make_velocity(run.rules)
    for action in machine.handle(Received(message), now):
        if isinstance(action, Fly):
            model = MODELS[run.rules.dead_reckoning]
            flown = model(action.vector, run.rules.epsilon, run.rules.dim, stream(0, "flight"))
            position_at(plan_flight(spec.truth, flown, 0.0, velocity), 0.1, velocity)
            machine.handle(Landed(), now)


def _scenes(machine: StateMachine, spec: FlsSpec) -> list[Message]:
    """What an FLS hears most."""
    other = spec.fid % 1000 + 1
    mine, me = machine.swarm, Swarm(spec.fid, 0)
    init = Message(Kind.CHALLENGE_INIT, other, 0, 0, Swarm(other, 0), 1, spec.truth, To.ALL, challenge=1)
    return [
        init,
        init._replace(kind=Kind.SET_WAITING, to=To.SWARM, addressee=mine),
        init._replace(kind=Kind.SET_AVAILABLE, to=To.SWARM, addressee=mine),
        init._replace(kind=Kind.NEIGHBOUR, to=To.FLS, addressee=me),
        init._replace(kind=Kind.CHALLENGE_ACCEPT, to=To.FLS, addressee=me),
        init._replace(
            kind=Kind.FOLLOW_MERGE, to=To.SWARM, addressee=mine, other=mine, vector=(1.0, 1.0, 1.0)
        ),
    ]
