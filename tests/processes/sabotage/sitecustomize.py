"""Makes the k-th call of something fail in a process that is being tested, and in those that it starts.

Python imports this file as it begins, if its folder is on PYTHONPATH. SWARMER_SABOTAGE says what: `os.fork 3 EAGAIN`
lets the third fork of each process fail, `mmap.mmap 1 ENOMEM` the first mapping. `*` for the number: all of them.
"""

import errno
import importlib
import os


def _spoil(spoken):
    place, which, why = spoken.split()
    module, _, name = place.rpartition(".")
    owner, _, inner = module.partition(":")
    home = importlib.import_module(owner)
    if inner:
        home = getattr(home, inner)
    real, calls = getattr(home, name), 0

    def spoilt(*arguments, **named):
        nonlocal calls
        calls += 1
        if which in ("*", str(calls)):
            number = getattr(errno, why)
            raise OSError(number, os.strerror(number))
        return real(*arguments, **named)

    setattr(home, name, spoilt)


if os.environ.get("SWARMER_SABOTAGE"):
    _spoil(os.environ["SWARMER_SABOTAGE"])
