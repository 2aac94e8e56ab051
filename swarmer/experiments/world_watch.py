"""What looks after the worlds of a technique that is not ours: does it lead anywhere, and does it ever come back?"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence
from math import dist
from types import FrameType
from typing import TYPE_CHECKING, Any

from swarmer.engines.result import Witness
from swarmer.errors import RunFailed
from swarmer.messages import FOLLOW_MERGE
from swarmer.protocol.events import Measured, Send

if TYPE_CHECKING:
    from swarmer.engines.result import Seen
    from swarmer.messages import Stamp
    from swarmer.protocol.events import Action
    from swarmer.protocol.events import Event as Happening

ENOUGH = 10  # localizations, before anybody judges
TINY = 1e-6  # cells
TOO_LONG = "s of processor time"  # what it says of a world that takes too long


class Nearer(Witness):
    """Counts the localizations by which an FLS comes nearer to where its anchor says that it belongs.

    By what was measured, so that neither the sensor nor the flight matters. A right technique leaves nothing to fly.
    """

    def __init__(self) -> None:
        self.all = self.nearer = 0

    def handled(
        self, fls: Seen, event: Happening, actions: Sequence[Action], cause: Stamp | None, now_s: float
    ) -> None:
        anchor = fls.machine.anchor
        if type(event) is not Measured or anchor is None:
            return
        for action in actions:
            if type(action) is Send and action.message.kind == FOLLOW_MERGE:
                wanted = [there - here for there, here in zip(anchor.truth, fls.machine.truth, strict=True)]
                left = [part - flown for part, flown in zip(event.vector, action.message.vector, strict=True)]
                before = dist(event.vector, wanted)
                if before > TINY:
                    self.all += 1
                    self.nearer += dist(left, wanted) < before

    def wrong(self) -> str | None:
        """What is wrong with the technique, if anything."""
        if self.all < ENOUGH or 2 * self.nearer >= self.all:
            return None
        return (
            f"the technique leads away: {self.all - self.nearer} of {self.all} localizations left the FLS no nearer to "
            "where its anchor says that it belongs"
        )


class TookTooLong(RunFailed):
    """A world took more of the processor than any should."""


@contextlib.contextmanager
def processor_time(limit_s: float) -> Iterator[None]:
    """Raises TookTooLong in the middle of what takes longer, wherever that is; by the processor's time, not the wall's.

    Only where there are such clocks, and in the main thread.
    """
    if not hasattr(signal, "SIGPROF") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(_: int, frame: FrameType | None) -> Any:
        at = (
            f" in {frame.f_code.co_name}, line {frame.f_lineno} of {frame.f_code.co_filename}"
            if frame
            else ""
        )
        raise TookTooLong(f"more than {limit_s:g} {TOO_LONG}{at}")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
