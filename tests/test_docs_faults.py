"""Every example of the page on faults does what it says: it is run, in virtual time, with every invariant checked."""

import re
from pathlib import Path

import pytest
from stories import Story, one_swarm

from swarmer.faults import PARTITION, WHAT, from_text
from swarmer.yaml_file import parse

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "faults.md").read_text("utf-8")
EXAMPLES = [text for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if text.startswith("faults:")]


def names(text):
    return sorted({row["what"] for row in parse(text)["faults"]})


@pytest.mark.parametrize("text", EXAMPLES, ids=lambda text: "+".join(names(text)))
def test_an_example_runs_and_one_swarm_forms_after_it(text):
    points = Story(duration_s=0.1).plan.cloud.points.tolist()
    schedule = from_text(text, len(points), points, 1)
    story = Story(faults=schedule, duration_s=14.0)
    told = [event.text for event in story.audience.events if event.kind == "fault"]
    assert sum(text.startswith("begins: ") for text in told) == len(schedule.faults)
    assert story.end.lit.all()
    last = max((fault.ends_s for fault in schedule.faults if fault.for_s is not None), default=0.0)
    assert any(one_swarm(sample) for sample in story.audience.samples if sample.t_s > last)


def test_the_page_has_an_example_of_every_fault():
    shown = {what for text in EXAMPLES for what in names(text)}
    assert shown == {*WHAT, PARTITION}


def test_the_page_names_every_place():
    from swarmer.fault_places import SHAPES

    for keys in SHAPES:
        assert any(all(f"{key}:" in line for key in keys) for line in PAGE.splitlines()), keys
