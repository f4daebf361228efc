"""A worker started by hand: `python -m eigenfail_workers --connect tcp://host:port`."""

import argparse
import os
import platform
import signal
import sys
from types import FrameType

from eigenfail.errors import EigenfailError
from eigenfail_workers.worker.parent import Parent


def main() -> None:
    """Serve one hub until it says goodbye, or until SIGTERM or Ctrl-C."""
    try:
        serve()
    except EigenfailError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)


def serve() -> None:
    """Do what the command line says.

    Raises:
        InvalidValue: the hub's address is none.
    """
    parser = argparse.ArgumentParser(prog="eigenfail worker", description=__doc__)
    parser.add_argument("--connect", required=True, help="the hub's address, tcp://host:port")
    parser.add_argument("--name", default=f"{platform.node()}-{os.getpid()}")
    parser.add_argument("--episode-limit", type=float, default=60.0, help="wall time [s]")
    arguments = parser.parse_args()
    parent = Parent(arguments.connect, arguments.name, arguments.episode_limit)

    def leave(_signal: int, _frame: FrameType | None) -> None:
        parent.leave()

    signal.signal(signal.SIGTERM, leave)
    signal.signal(signal.SIGINT, leave)
    parent.serve()


if __name__ == "__main__":
    main()
