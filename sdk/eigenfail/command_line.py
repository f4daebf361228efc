"""Command lines of the programs that are no `eigenfail` command."""

import argparse
from typing import NoReturn

from eigenfail.values.access import redacted


class Parser(argparse.ArgumentParser):
    """A parser that repeats no key and no password in its errors."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the command line, and end with 2."""
        super().error(redacted(message))
