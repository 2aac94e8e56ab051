"""The errors a user may meet, by who is at fault.

    SwarmerError            exit status 1 unless a subclass says otherwise
    ├── BadInput            the caller's: a setting, a file, an option      exit status 2
    └── RunFailed           the run's: disk full, too many FLSs died        exit status 1
"""


class SwarmerError(Exception):
    """Base of every error that ends a command with one line instead of a traceback."""

    exit_status = 1


class BadInput(SwarmerError):
    """Something the user gave cannot be used; the line names field, value and what is allowed.

    >>> str(BadInput("lease_ms", -5, "milliseconds, 1 to 60000 (default 250)"))
    'lease_ms: -5 is not allowed; milliseconds, 1 to 60000 (default 250)'
    """

    exit_status = 2

    def __init__(self, field: str, value: object, allowed: str) -> None:
        self.field, self.value, self.allowed = field, value, allowed
        super().__init__(f"{field}: {shown(value)} is not allowed; {allowed}")


class RunFailed(SwarmerError):
    """A run that began could not be finished; what it has is on disk."""


def shown(value: object, limit: int = 80) -> str:
    """`value` on one line of at most `limit` characters, as an error message quotes it."""
    text = repr(value) if isinstance(value, str) else str(value)
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 1] + "…"
