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
from eigenfail.private_files import read_private
from eigenfail.values.access import redacted
from eigenfail.wire.curve import WorkerKey, read_worker_key
from eigenfail_workers.episode_limit import read_episode_limit
from eigenfail_workers.worker.limits import CPU_OPTION, MEMORY_OPTION, read_limits
from eigenfail_workers.worker.parent import Parent

KEY_VARIABLE = "EIGENFAIL_WORKER_KEY_FILE"
KEY_FIELD = "--key-file"


def key_in(file: str | None) -> WorkerKey | None:
    """The key in a file; none if no file is named.

    Raises:
        InvalidValue: the file holds none, or everybody can read it.
    """
    if not file:
        return None
    return read_worker_key(read_private(Path(file), KEY_FIELD), KEY_FIELD)


def main() -> None:
    """Serve one hub until it says goodbye, or until SIGTERM or Ctrl-C."""
    try:
        logs.configure("worker")
        serve()
    except EigenfailError as error:
        sys.stderr.write(redacted(f"{error}\n"))
        sys.exit(error.exit_code)


def serve() -> None:
    """Do what the command line says.

    Raises:
        InvalidValue: the hub's address is none, or the bridge's, or a limit, or the file of the key
            holds none.
        Unauthorized: the hub does not let this worker in.
        ServiceUnreachable: whoever listens at its address is not the hub.
        ServiceError: no inner process can start here.
    """
    parser = Parser(prog="eigenfail worker", description=__doc__)
    parser.add_argument("--connect", required=True, help="the hub's address, tcp://host:port")
    parser.add_argument("--name", default=f"{platform.node()}-{os.getpid()}")
    parser.add_argument(EPISODE_OPTION, help="wall time [s]")
    parser.add_argument(
        "--key-file", default=os.environ.get(KEY_VARIABLE), help="of the key that the hub asks for"
    )
    parser.add_argument(MEMORY_OPTION, help="of simulator and planner [MiB]")
    parser.add_argument(CPU_OPTION, help="processor time of both for an episode [s]")
    parser.add_argument(
        ADDRESS_OPTION,
        default=os.environ.get(ADDRESS_VARIABLE),
        help='the bridge on which campaigns with simulator "bridge" run, tcp://127.0.0.1:port',
    )
    arguments = parser.parse_args()
    if arguments.bridge:
        os.environ[ADDRESS_VARIABLE] = check_address(arguments.bridge)
    key, episode_s = key_in(arguments.key_file), read_episode_limit(arguments.episode_limit)
    limits = read_limits(arguments.memory_limit, arguments.cpu_limit, episode_s)
    parent = Parent(arguments.connect, arguments.name, episode_s, key, limits)

    def leave(_signal: int, _frame: FrameType | None) -> None:
        parent.leave()

    signal.signal(signal.SIGTERM, leave)
    signal.signal(signal.SIGINT, leave)
    parent.serve()
    for number in (signal.SIGTERM, signal.SIGINT):  # as the interpreter ends, one more would kill
        signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    main()
