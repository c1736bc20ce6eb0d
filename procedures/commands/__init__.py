"""The command line `palpate`."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; see `root.run`."""
    try:
        from palpate.procedures.commands.root import run  # takes 0.2 s, in which Ctrl-C can come, too

        run()
    except KeyboardInterrupt:
        sys.stderr.write("palpate: interrupted\n")
        sys.exit(130)
