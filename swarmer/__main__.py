"""Where the installed commands begin: Ctrl-C is quiet before anything is imported that takes time."""

from __future__ import annotations

from swarmer.interrupts import at_once

at_once()  # until `cli.leave` takes over


def main() -> None:
    """The command `swarmer`, and `python -m swarmer`."""
    from swarmer import cli

    cli.main()


def main_run() -> None:
    """The command `swarmer-run`."""
    from swarmer import cli

    cli.main_run()


if __name__ == "__main__":
    main()
