"""What a command that leads to a host says when it does not come to an agent."""

import pytest
from helpers import wait_for

from swarmer.engines.cluster.launch import Program


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (["bash: python3: command not found", "Connection closed.", "bye"], "bash: python3: command not found"),
        (["/usr/bin/python: No module named swarmer", "logout"], "/usr/bin/python: No module named swarmer"),
        (["ssh: Could not resolve hostname pine"], "ssh: Could not resolve hostname pine"),
        (["welcome", "bye"], "bye"),
        ([], ""),
    ],
)  # fmt: skip
def test_the_line_that_says_why_is_told_whatever_a_shell_adds(said, told):
    program = Program(["sh", "-c", 'for line; do echo "$line" >&2; done; exit 1', "sh", *said], b"{}")
    try:
        wait_for(program.ended)
        assert program.last_words() == told
    finally:
        program.end()
