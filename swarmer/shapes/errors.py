"""What is said of a shape that cannot be used."""

from __future__ import annotations

from swarmer.errors import BadInput, SwarmerError


class BadShape(BadInput):
    """A shape cannot be used; free text, on one line that starts with `shape: `.  Exit status 2.

    >>> str(BadShape("no 'dragn'; did you mean 'dragon'?"))
    "shape: no 'dragn'; did you mean 'dragon'?"
    """

    def __init__(self, text: str) -> None:
        self.field, self.value, self.allowed = "shape", None, ""
        SwarmerError.__init__(self, "shape: " + " ".join(text.split()))
