"""The one connection of a process to its bridge, made anew after trouble."""

import atexit
import os
from contextlib import suppress
from functools import cache

from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE, check_address
from eigenfail.errors import InvalidValue, SimulatorError
from eigenfail_workers.bridge.connection import ANSWER_S, HELLO_S, Connection


class Line:
    """Shared by all engines of a process: a bridge may hold one session alone.

    Args:
        address: of the bridge.
        answer_s: how long an answer may take. [s]
        hello_s: how long the answer to a hello may take. [s]
    """

    def __init__(self, address: str, answer_s: float = ANSWER_S, hello_s: float = HELLO_S) -> None:
        self.address = check_address(address)
        self._limits = answer_s, hello_s
        self._connection: Connection | None = None

    @property
    def is_open(self) -> bool:
        """Whether there is a connection that is thought to be good."""
        return self._connection is not None

    def connection(self) -> Connection:
        """The connection; raises SimulatorError if there is no bridge that lets us in."""
        if self._connection is None:
            self._connection = Connection(self.address, *self._limits)
        return self._connection

    def renew(self) -> None:
        """Let go of a connection whose bridge went away, while nothing runs on it."""
        if self._connection is not None and not self._connection.is_alive:
            self.drop()

    def drop(self) -> None:
        """The connection is in trouble: the next episode gets another one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.drop()

    def close(self) -> None:
        """Say goodbye."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(SimulatorError):  # it is gone already
                connection.close()


def line_of_this_worker() -> Line:
    """To the bridge that whoever started this process has named.

    Raises:
        InvalidValue: none was named, or not one that it may connect to.
    """
    address = os.environ.get(ADDRESS_VARIABLE)
    if not address:
        remedy = f"Start it with {ADDRESS_OPTION} ADDRESS, or with {ADDRESS_VARIABLE}."
        raise InvalidValue("simulator", "this worker has no bridge.", remedy)
    return shared(address)


@cache
def shared(address: str) -> Line:
    """The line to an address, the same each time, until the process ends."""
    line = Line(address)
    atexit.register(line.close)
    return line
