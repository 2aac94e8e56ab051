import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "processes"))  # helpers for real processes


@pytest.fixture
def write(tmp_path):
    """Make an experiment file of a text; its path."""

    def make(text, name="x.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return make
