"""Settings that only one engine heeds: declared where the setting is, and told when they are changed for nothing."""

import ast
from pathlib import Path

import pytest

from swarmer.config import load_config, setting_facts
from swarmer.errors import BadInput

SWARMER = Path(__file__).resolve().parent.parent / "swarmer"
# What only the process engine runs; `specs.setup` besides, what its dispatchers are told.
OF_PROCESSES = {
    "engines/process.py", "engines/real_time.py", "engines/dispatcher.py", "engines/governor.py",
    "engines/trial.py", "engines/measured.py",
    "engines/limits.py", "engines/kernel_services.py", "engines/warm_up.py", "engines/doctor.py", "fls_process.py",
    "fls_loops.py", "udp_wrapper.py",
}  # fmt: skip
OF_VIRTUAL = {"engines/virtual.py"}
OF_CLUSTERS = {
    f"engines/cluster/{name}.py" for name in ("agent", "engine", "hosts", "launch", "on_ray", "relay")
}
FREE = {"engine"}  # picks one


def read(path: Path, setup: bool) -> set[str]:
    """The names of attributes that a file reads. setup: also what dispatchers are told."""
    tree = ast.parse(path.read_text("utf-8"))
    if path.name == "specs.py" and not setup:
        tree.body = [part for part in tree.body if getattr(part, "name", "") != "setup"]
    if path.name == "config.py":  # `contradictions` names what is refused, too
        tree.body = [part for part in tree.body if getattr(part, "name", "") != "contradictions"]
    return {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


def reads(without: set[str]) -> set[str]:
    files = [path for path in SWARMER.rglob("*.py") if str(path.relative_to(SWARMER)) not in without]
    return set().union(*(read(path, setup=not without >= OF_PROCESSES) for path in files))


@pytest.mark.parametrize(
    ("engine", "other"),
    [("process", OF_PROCESSES | OF_CLUSTERS), ("virtual", OF_VIRTUAL), ("cluster", OF_CLUSTERS)],
)
def test_what_nobody_but_one_engine_reads_says_so(engine, other):
    elsewhere = reads(without=other) | FREE
    # The processes of a cluster heed what processes heed, and more.
    engines = (engine, "cluster") if engine == "process" else (engine,)
    for fact in setting_facts():
        name = fact.name.rpartition(".")[2]
        if name not in elsewhere:
            assert fact.only in engines, (
                f"{fact.name} is read by the engine {engine} alone: declare only={engine!r}"
            )


def test_a_group_named_after_an_engine_is_that_engines():
    for fact in setting_facts():
        group = fact.name.partition(".")[0]
        if group in ("process", "virtual", "cluster"):
            assert fact.only == group, fact.name


@pytest.mark.parametrize(
    ("engine", "settings", "told"),
    [
        ("virtual", {"process.pin": False}, "process.pin: false has no effect with the engine virtual"),
        ("virtual", {"fls_loop": "threads"}, "fls_loop: threads has no effect with the engine virtual"),
        ("virtual", {"radio.kernel_filter": "off"}, 'radio.kernel_filter: "off" has no effect'),
        (
            "process",
            {"virtual.handling_ms": 3},
            "virtual.handling_ms: 3 has no effect with the engine process",
        ),
        ("virtual", {"virtual.handling_ms": 3, "radio.loss": 0.1, "radio.mac": True}, None),
        ("process", {"fls_loop": "threads", "radio.port": 5000}, None),
        ("cluster", {"fls_loop": "threads", "radio.carrier": "broadcast", "cluster.relay_loss": 0.1}, None),
        (
            "process",
            {"cluster.relay_loss": 0.1},
            "cluster.relay_loss: 0.1 has no effect with the engine process",
        ),
    ],
)
def test_a_setting_that_the_engine_does_not_heed_is_told(engine, settings, told):
    lines = load_config(engine=engine, **settings).ignored()
    if told is None:
        assert lines == []
    else:
        [line] = lines
        assert line.startswith(told)


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"lambda_ms": 1e-6}, "lambda_ms"),
        ({"thaw.h_s": 1e-9}, "thaw.h_s"),
        ({"failure.battery_s": 1e-9}, "failure.battery_s"),
        ({"challenge_on_available": True, "accept_gap_ms": 1e-6}, "accept_gap_ms"),
    ],
)
def test_what_would_make_emulated_time_stand_still_is_refused(settings, name):
    with pytest.raises(BadInput) as refused:
        load_config(**settings)
    assert name in str(refused.value)
