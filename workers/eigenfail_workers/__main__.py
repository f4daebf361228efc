"""A worker started by hand: `python -m eigenfail_workers --connect tcp://host:port`."""

import os
import platform
import signal
import sys
from pathlib import Path
from types import FrameType

from eigenfail import logs
from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE, EPISODE_OPTION, check_address
from eigenfail.command_line import Parser
from eigenfail.errors import EigenfailError
from eigenfail.files import read_private
from eigenfail.processes import PARENT_VARIABLE, die_with_parent
from eigenfail.values.access import redact
from eigenfail.wire.keys import WORKER_KEY_VARIABLE, WorkerKey, read_worker_key
from eigenfail_workers.limits import CPU, MEMORY, OUTPUT, read_limits
from eigenfail_workers.worker.parent import Parent

KEY_FIELD = "--key-file"


def read_key(file: str | None) -> WorkerKey | None:
    """Return the key in a file, or None if no file is named.

    Raises:
        InvalidValue: the file does not hold a key, or other users can read it.
    """
    if not file:
        return None
    return read_worker_key(read_private(Path(file), KEY_FIELD), KEY_FIELD)


def main() -> None:
    """Serve one hub until it says goodbye, or until SIGTERM or Ctrl-C."""
    if PARENT_VARIABLE in os.environ:  # the services have started it
        die_with_parent()
    try:
        logs.configure("worker")
        serve()
    except EigenfailError as error:
        sys.stderr.write(redact(f"{error}\n"))
        sys.exit(error.exit_code)


def serve() -> None:
    """Serve the hub that the command line names.

    Raises:
        InvalidValue: an address, a limit or the file of the key is not valid.
        Unauthorized: the hub does not accept this worker.
        ServiceUnreachable: what listens at the address is not the hub.
        ServiceError: no child process can start here.
    """
    parser = Parser(prog="eigenfail worker", description=__doc__)
    parser.add_argument("--connect", required=True, help="address of the hub, tcp://host:port")
    # Unique on a machine, so that a log tells workers apart that were given no name.
    parser.add_argument("--name", default=f"{platform.node()}-{os.getpid()}")
    parser.add_argument(EPISODE_OPTION, help="wall time of an episode [s]")
    parser.add_argument(
        "--key-file",
        default=os.environ.get(WORKER_KEY_VARIABLE),
        help="key for a hub that requires keys",
    )
    parser.add_argument(MEMORY.option, help="memory of simulator and planner [MiB]")
    parser.add_argument(CPU.option, help="processor time of both for an episode [s]")
    parser.add_argument(OUTPUT.option, help="printed output passed on for an episode [KiB]")
    parser.add_argument(
        ADDRESS_OPTION,
        default=os.environ.get(ADDRESS_VARIABLE),
        help='bridge for campaigns with simulator "bridge", tcp://127.0.0.1:port',
    )
    arguments = parser.parse_args()
    if arguments.bridge:
        # Child processes read it from the environment.
        os.environ[ADDRESS_VARIABLE] = check_address(arguments.bridge)
    key = read_key(arguments.key_file)
    limits = read_limits(
        arguments.memory_limit,
        arguments.cpu_limit,
        arguments.episode_limit,
        arguments.output_limit,
    )
    parent = Parent(arguments.connect, arguments.name, key, limits)

    def shut_down(_signal: int, _frame: FrameType | None) -> None:
        parent.shut_down()

    signal.signal(signal.SIGTERM, shut_down)
    signal.signal(signal.SIGINT, shut_down)
    parent.serve()
    for number in (signal.SIGTERM, signal.SIGINT):  # another one would kill the ending interpreter
        signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    main()
