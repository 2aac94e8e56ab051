"""The worlds of this room are plain modules; `scripts/soak.py` finds them in the same way."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
