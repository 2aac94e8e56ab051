"""The worlds of this room are plain modules."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
