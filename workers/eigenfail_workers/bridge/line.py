"""The one connection of a process to its bridge, made anew after trouble."""

import atexit
import os
import time
from contextlib import suppress
from functools import cache

from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE, check_address
from eigenfail.errors import BridgeLost, InvalidValue
from eigenfail_workers.bridge.connection import Connection
from eigenfail_workers.bridge.patience import Patience, patience_of_this_worker, pauses


class Line:
    """Shared by all engines of a process: a bridge may hold one session alone.

    Args:
        address: of the bridge.
        patience: with it; that of this worker, unless it is given.
    """

    def __init__(self, address: str, patience: Patience | None = None) -> None:
        self.address = check_address(address)
        self.patience = patience or patience_of_this_worker()
        self._connection: Connection | None = None
        self._was_there = False

    @property
    def is_open(self) -> bool:
        """Whether there is a connection that is thought to be good."""
        return self._connection is not None

    def connection(self, left_s: float) -> Connection:
        """The connection, made anew if need be.

        A bridge that was there is waited for as long as may be, another only until it has had the
        time to come up.

        Args:
            left_s: how long this may take. [s]

        Raises:
            BridgeLost: there is no bridge by then, or it has no room.
            SimulatorError: it answers otherwise than by the protocol, or refuses.
        """
        if self._connection is None:
            self._connection = self._opened(time.monotonic() + left_s)
        return self._connection

    def _opened(self, until_s: float) -> Connection:
        silent_until_s = until_s if self._was_there else time.monotonic() + self.patience.hello_s
        for pause_s in pauses():
            try:
                found = Connection(self.address, self.patience, until_s - time.monotonic())
            except BridgeLost:
                if time.monotonic() + pause_s > min(until_s, silent_until_s):
                    self._was_there = False
                    raise
                time.sleep(pause_s)
            else:
                break
        self._was_there = True
        return found

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
            with suppress(BridgeLost):  # it is gone already
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
