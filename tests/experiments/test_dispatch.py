"""Runs given to machines, without Ray: no machine gets more than it carries, a lost one costs no run."""

import pytest

from swarmer.engines.ray_session import Node
from swarmer.errors import BadInput, RunFailed
from swarmer.experiments import dispatch
from swarmer.experiments.dispatch import TRIES, Ledger, Lost, at_once, check_room, outcomes
from swarmer.experiments.experiment import read_experiment
from swarmer.experiments.needs import Needs
from swarmer.experiments.one_run import Outcome
from swarmer.experiments.runs import expand

SMALL = Needs(1, 100)
MACHINE = Needs(1, 100, machine=True)


def node(name, cores=2, memory_mb=1000.0):
    return Node(name, f"10.0.0.{name}", cores, memory_mb)


class Machines:
    """A crew whose machines finish what is oldest first, and are lost when told."""

    def __init__(self, *nodes, lose=(), fail=()):
        self.there = list(nodes)
        self.lose, self.fail = list(lose), fail  # numbers of begun runs; seeds
        self.begun, self.at, self.most = [], {}, {}
        self.made = []

    def nodes(self):
        return list(self.there)

    def begin(self, run, needs, where):
        handle = len(self.begun)
        self.begun.append((run, needs, where))
        self.at[handle] = where
        here = [self.begun[one][1] for one, place in self.at.items() if place == where]
        assert len([one for one in here if one.machine]) <= 1
        assert len(here) == 1 or not any(one.machine for one in here)
        self.most[where.id] = max(self.most.get(where.id, 0), sum(one.cores for one in here))
        return handle

    def wait(self, begun, limit_s):
        return [min(begun)]

    def outcome(self, ended, run):
        where = self.at.pop(ended)
        if ended in self.lose:
            self.there = [one for one in self.there if one != where]
            raise Lost(f"{where.name} was lost")
        self.made.append(run.path)
        return Outcome("failed", "for a reason") if run.config.seed in self.fail else Outcome("done")


@pytest.fixture
def runs(write):
    return expand(read_experiment(str(write("base: {engine: virtual, shape: sphere, points: 12}\nseeds: 8"))))


def ended(runs, crew, says=None, clock=None):
    more = {} if clock is None else {"clock": clock}
    said = [] if says is None else says
    return {
        run.config.seed: outcome
        for run, outcome in outcomes(runs, crew, lambda run: None, lambda: None, said.append, **more)
    }


def test_every_run_is_made_once_and_no_machine_has_more_than_it_carries(runs):
    crew = Machines(node("1", 2), node("2", 3))
    assert {outcome.status for outcome in ended(runs, crew).values()} == {"done"}
    assert len(crew.made) == len(set(crew.made)) == 8
    assert crew.most == {"1": 2, "2": 3}


def test_memory_counts_as_cores_do(runs):
    crew = Machines(node("1", 8, runs[0].needs.memory_mb * 2.5))
    assert len(ended(runs, crew)) == 8
    assert crew.most == {"1": 2}


def test_runs_of_processes_have_a_machine_each(write):
    runs = expand(read_experiment(str(write("base: {engine: process, shape: sphere, points: 12}\nseeds: 5"))))
    crew = Machines(node("1", 2), node("2", 2))  # asserts that none stands beside another
    assert len(ended(runs, crew)) == 5
    assert {where.id for _, _, where in crew.begun} == {"1", "2"}


def test_a_lost_machines_run_is_made_elsewhere_and_told(runs):
    crew, said = Machines(node("1"), node("2"), lose=[1]), []
    assert {outcome.status for outcome in ended(runs, crew, said).values()} == {"done"}
    assert len(crew.made) == 8
    assert len(crew.begun) > 8
    assert ["lost; it is made anew" in line for line in said] == [True]
    lost = crew.begun[1][2].id
    assert lost not in {where.id for _, _, where in crew.begun[5:]}


def test_a_worker_that_is_killed_is_not_its_machine(runs):
    crew = Machines(node("1", 1))
    outcome, killed = crew.outcome, []

    def first_is_killed(ended, run):
        if not killed:
            killed.append(run)
            crew.at.pop(ended)
            raise Lost("its worker was killed", machine_gone=False)
        return outcome(ended, run)

    crew.outcome = first_is_killed
    assert {one.status for one in ended(runs, crew).values()} == {"done"}
    assert len(crew.begun) == 9


def test_a_run_that_loses_machine_after_machine_is_given_up(runs):
    crew = Machines(*(node(str(at), 1) for at in range(4)), lose=[0, 1, 2])
    [outcome] = ended(runs[:1], crew).values()
    assert outcome == Outcome("failed", f"its machine was lost {TRIES} times, the last: 10.0.0.2 was lost")
    assert len(crew.begun) == TRIES


def test_a_run_that_fails_by_itself_is_not_made_again(runs):
    crew = Machines(node("1"), fail=[3])
    assert ended(runs, crew)[3] == Outcome("failed", "for a reason")
    assert len(crew.begun) == 8


def test_without_machines_it_waits_and_then_gives_up(runs, monkeypatch):
    monkeypatch.setattr(dispatch, "LOOK_EVERY_S", 0)
    crew, times = Machines(node("1", 1), lose=[0]), iter(range(0, 10_000, 30))
    with pytest.raises(RunFailed, match="no node of the cluster is left"):
        ended(runs, crew, clock=lambda: next(times))


def test_a_machine_that_comes_late_is_used(runs, monkeypatch):
    monkeypatch.setattr(dispatch, "LOOK_EVERY_S", 0)
    crew = Machines(node("1", 1), lose=[0])
    late = iter([[node("1", 1)], [], [node("2", 1)]])
    crew.nodes = lambda: next(late, [node("2", 1)])
    assert {outcome.status for outcome in ended(runs, crew).values()} == {"done"}
    assert {where.id for _, _, where in crew.begun[1:]} == {"2"}


def test_what_fits_nowhere_is_refused_by_name(write):
    runs = expand(read_experiment(str(write("base: {engine: virtual, shape: sphere}\nneeds: {cores: 4}"))))
    with pytest.raises(
        BadInput, match=r"too few slots: seed-1 needs 4 cores and .* has 3 cores and 1,000 MB"
    ):
        check_room([node("1", 2), node("2", 3)], runs)
    check_room([node("1", 2), node("2", 4)], runs)
    with pytest.raises(BadInput, match="no node has any"):
        check_room([], runs)


def test_how_many_at_once():
    assert at_once([node("1", 2), node("2", 3)], [SMALL] * 9) == 5
    assert at_once([node("1", 2), node("2", 3)], [MACHINE] * 9) == 2
    assert at_once([node("1", 2)], [SMALL, MACHINE]) == 1
    assert at_once([node("1", 2)], []) == 0


def test_a_run_goes_where_most_is_free():
    ledger = Ledger([node("1", 2), node("2", 4)])
    placed = [ledger.place(SMALL).id for _ in range(6)]
    assert placed == ["2", "2", "1", "2", "1", "2"]
    assert ledger.place(SMALL) is None
    ledger.free(node("1", 2), SMALL)
    assert ledger.place(SMALL).id == "1"
    ledger.lose(node("2", 4))
    ledger.free(node("2", 4), SMALL)
    assert ledger.place(SMALL) is None
    ledger.update([node("1", 2), node("2", 4)])
    assert ledger.place(SMALL) is None  # Ray takes some seconds to say that a machine is dead
    ledger.update([node("1", 2), node("3", 4)])
    assert ledger.place(SMALL).id == "3"
