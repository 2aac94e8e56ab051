"""What a command that leads to a host says when it does not come to an agent."""

import pytest
from helpers import wait_for

from swarmer.engines.cluster.launch import Program


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (["sh: python3: not found", "Connection closed."], "sh: python3: not found; Connection closed."),
        (["Unauthorised access is refused", "Killed"], "Unauthorised access is refused; Killed"),
        (["welcome", "to", "pine", "No module named swarmer"], "to; pine; No module named swarmer"),
        ([], ""),
    ],
)  # fmt: skip
def test_the_last_lines_are_told_for_a_shell_may_add_some(said, told):
    program = Program(["sh", "-c", 'for line; do echo "$line" >&2; done; exit 1', "sh", *said], b"{}")
    try:
        wait_for(program.ended)
        assert program.last_words() == told
    finally:
        program.end()
