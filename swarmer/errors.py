"""The errors a user may meet, by who is at fault.

SwarmerError            exit status 1 unless a subclass says otherwise
├── BadInput            the caller's: a setting, a file, an option      exit status 2
└── RunFailed           the run's: disk full, too many FLSs died        exit status 1
    └── PluginFailed    a plugin's: it raised, or gave what cannot be
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Self


class SwarmerError(Exception):
    """Base of every error that ends a command with one line instead of a traceback."""

    exit_status = 1


class BadInput(SwarmerError):
    """Something the user gave cannot be used; the line names field, value and what is allowed.

    >>> str(BadInput("lease_ms", -5, "milliseconds, 1 to 60000 (default 250)"))
    'lease_ms: -5 is not allowed; milliseconds, 1 to 60000 (default 250)'
    """

    exit_status = 2
    lines: tuple[str, ...]  # all that is wrong; str() is the first one

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        line = f"{field}: {shown(value)} is not allowed; {allowed}"
        self.lines = (line,)
        super().__init__(line)

    @classmethod
    def saying(cls, *lines: str) -> Self:
        """From ready lines `field: what is wrong`; the first is shown, all are kept in `lines`.

        >>> str(BadInput.saying("radio.los: no such setting", "seed: -1 is out of range"))
        'radio.los: no such setting (and 1 more)'
        """
        error = cls.__new__(cls)
        error.field, error.value, error.allowed = lines[0].partition(":")[0], None, ""
        error.lines = lines
        more = f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""
        error.args = (lines[0] + more,)
        return error

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way between two processes, though `__init__` does not take what `args` holds."""
        return type(self).saying, self.lines, self.__dict__


class RunFailed(SwarmerError):
    """A run that began could not be finished; what it has is on disk."""


class PluginFailed(RunFailed):
    """A plugin of another package raised, or gave what cannot be; the line names it and its package."""


def shown(value: object, limit: int = 80) -> str:
    """`value` on one line of at most `limit` characters, as an error message quotes it."""
    try:
        text = repr(value[:limit]) if isinstance(value, str) else str(value)
    except (ValueError, RecursionError):  # an integer of more digits than Python prints
        text = "a value too long to show"
    text = "".join(letter if letter.isprintable() else " " for letter in text)
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
