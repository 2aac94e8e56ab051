"""Several witnesses of a run in virtual time as one (`result.Witness`)."""

from __future__ import annotations

from typing import Any

from swarmer.engines.result import Witness


def witness_of(witnesses: tuple[Witness, ...]) -> Witness | None:
    """One that tells all of them, in their order; None if there are none, so that an engine need not ask."""
    if not witnesses:
        return None
    return witnesses[0] if len(witnesses) == 1 else Witnesses(witnesses)


class Witnesses(Witness):
    """Tells each of several."""

    def __init__(self, witnesses: tuple[Witness, ...]) -> None:
        self._all = witnesses

    def made(self, *what: Any) -> None:
        for witness in self._all:
            witness.made(*what)

    def handled(self, *what: Any) -> None:
        for witness in self._all:
            witness.handled(*what)

    def sent(self, *what: Any) -> None:
        for witness in self._all:
            witness.sent(*what)

    def heard(self, *what: Any) -> None:
        for witness in self._all:
            witness.heard(*what)

    def flew(self, *what: Any) -> None:
        for witness in self._all:
            witness.flew(*what)

    def ended(self, *what: Any) -> None:
        for witness in self._all:
            witness.ended(*what)
