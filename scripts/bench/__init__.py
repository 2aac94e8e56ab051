"""The tables of `scripts/bench.py`, a file for each subject."""
