"""The connection of a worker to a bridge: requests and answers, each within a time limit."""

import atexit
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from uuid import uuid4

import msgspec
import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.bridges import ADDRESS_OPTION, ADDRESS_VARIABLE, EPISODE_OPTION, check_address
from eigenfail.errors import BridgeLost, EpisodeError, InvalidValue, SimulatorError
from eigenfail_workers.bridge import messages
from eigenfail_workers.limits import read_episode_limit

HELLO_S = 10.0
MARGIN_S = 10.0
MIN_PAUSE_S = 0.1
MAX_PAUSE_S = 2.0
LOOK = "Look at its own log; `eigenfail doctor --bridge` tries it."
LINGER_MS = 200
DELIMITER = b""
"""The empty frame that a REQ socket puts before its request, and a REP socket returns."""


class BridgeTimeouts(msgspec.Struct, frozen=True):
    """Time limits for a bridge; all follow from the wall time of an episode. [s]

    Attributes:
        limit_s: wall time of an episode after which the worker kills the waiting process.
        episode_s: wall time after which an episode is given up; n episodes side by side may take n
            times as long.
        answer_s: limit for an answer.
        hello_s: limit for the answer to a hello: the time that a bridge has to start up.
    """

    limit_s: float
    episode_s: float
    answer_s: float
    hello_s: float

    @property
    def remedy(self) -> str:
        """Advice for a bridge that takes too long."""
        return (
            "Make it faster, or its episodes shorter, or give the worker a longer "
            f"{EPISODE_OPTION} than {self.limit_s:g} s."
        )


def make_timeouts(limit_s: float) -> BridgeTimeouts:
    """Return the time limits that follow from the wall time of an episode. [s]"""
    # The error is reported before the worker kills this process, which would name no cause. Short
    # limits get a margin in proportion.
    margin_s = min(MARGIN_S, limit_s / 6.0)
    return BridgeTimeouts(limit_s, limit_s - margin_s, limit_s / 2.0, min(HELLO_S, limit_s / 6.0))


def read_timeouts() -> BridgeTimeouts:
    """Return the time limits that follow from the environment of this process.

    Raises:
        InvalidValue: the variable does not hold a number of seconds.
    """
    return make_timeouts(read_episode_limit())


def _iterate_pauses() -> Iterator[float]:
    """Yield the pause before each further attempt, doubled each time. [s]"""
    pause_s = MIN_PAUSE_S
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, MAX_PAUSE_S)


class Connection:
    """One session with a bridge. An error ends the session; open another connection then.

    Args:
        address: address of the bridge, already checked.
        timeouts: time limits for the bridge; default: the limits of this worker.
        left_s: time limit for opening the session. [s]

    Attributes:
        welcome: what the bridge offers.

    Raises:
        BridgeLost: no bridge answers, or all of its sessions are in use.
        SimulatorError: the bridge violates the protocol, or refuses the session.
    """

    def __init__(
        self, address: str, timeouts: BridgeTimeouts | None = None, left_s: float | None = None
    ) -> None:
        self.address = address
        self.session = uuid4().hex
        self.timeouts = timeouts or read_timeouts()
        self._last_id = 0
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, LINGER_MS)
        self._socket.setsockopt(zmq.MAXMSGSIZE, messages.MAX_MESSAGE_BYTES)
        # ZeroMQ connects to an address of IPv6 only with this option.
        self._socket.setsockopt(zmq.IPV6, int("[" in address))
        self._monitor: zmq.Socket[bytes] = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._monitor, zmq.POLLIN)
        try:
            self.welcome = self._open_session(self.timeouts.episode_s if left_s is None else left_s)
        except EpisodeError:
            self.drop()
            raise

    def _open_session(self, left_s: float) -> messages.BridgeWelcome:
        try:
            self._socket.connect(self.address)
        except zmq.ZMQError as error:
            raise self._make_error(f"cannot be connected to: {error}") from None
        until_s = time.monotonic() + left_s
        for pause_s in _iterate_pauses():
            answer = self._say_hello(until_s - time.monotonic())
            # A full bridge frees a session when another worker has ended: it is asked again for a
            # while.
            if not (isinstance(answer, messages.BridgeRefusal) and answer.full):
                break
            if time.monotonic() + pause_s > until_s:
                raise self._make_loss(f"has no room: {messages.sanitize(answer.reason)}")
            time.sleep(pause_s)
        if isinstance(answer, messages.BridgeRefusal):
            raise self._make_error(f"refuses: {messages.sanitize(answer.reason)}")
        if not isinstance(answer, messages.BridgeWelcome):
            raise self._make_error(f"answered a hello with {answer.__struct_config__.tag}")
        if answer.protocol != messages.PROTOCOL:
            known = f"protocol {messages.PROTOCOL}"
            problem = (
                f"The bridge at {self.address} speaks protocol {answer.protocol}, not {known}."
            )
            raise SimulatorError(problem, f"Change the bridge to {known}: docs/bridge.md has it.")
        return answer

    def _say_hello(self, left_s: float) -> messages.Answer:
        within_s = max(0.0, min(self.timeouts.hello_s, left_s))
        self.send(messages.BridgeHello(messages.PROTOCOL, self.session))
        data = self._receive(within_s)
        if data is None:
            raise self._make_loss(f"did not answer within {within_s:.3g} s")
        return messages.read_answer(data)

    @property
    def is_alive(self) -> bool:
        """True if no disconnection of the bridge has been noticed."""
        return not self._monitor.poll(0)

    def next_id(self) -> int:
        """Return a request number that is new in this session."""
        self._last_id += 1
        return self._last_id

    def send(self, request: messages.BridgeMessage) -> None:
        """Send a request; several may be pending.

        Raises:
            BridgeLost: the request cannot be sent.
        """
        try:
            self._socket.send_multipart((DELIMITER, messages.encode(request)), zmq.NOBLOCK)
        except zmq.ZMQError as error:
            raise self._make_loss(f"takes no message: {error}") from None

    def receive(self, within_s: float) -> messages.Observations | messages.Closed:
        """Return the next answer.

        Args:
            within_s: time that is left to the episodes; an answer may be allowed less. [s]

        Raises:
            BridgeLost: the bridge has disconnected, or does not know this session.
            EpisodeError: no answer comes in time, it violates the protocol, or it is an error.
            InvalidValue: the answer is an error that the campaign has caused.
        """
        answer_s = self.timeouts.answer_s
        data = self._receive(min(within_s, answer_s))
        # Two limits run at once: the message names the one that has ended the wait.
        if data is None and within_s < answer_s:
            raise self.make_timeout()
        if data is None:
            problem = f"The bridge at {self.address} did not answer within {answer_s:g} s."
            raise SimulatorError(problem, self.timeouts.remedy)
        answer = messages.read_answer(data)
        if isinstance(answer, messages.BridgeError):
            if answer.lost:
                raise self._make_loss(
                    f"knows nothing of this session: {messages.sanitize(answer.message)}"
                )
            raise messages.make_error(answer.fault, answer.message)
        if not isinstance(answer, (messages.Observations, messages.Closed)):
            tag = answer.__struct_config__.tag
            raise self._make_error(f"said {tag} in the middle of episodes")
        return answer

    def _receive(self, within_s: float) -> bytes | None:
        """Return the bytes of the next answer, or None if none comes in time."""
        until_s = time.monotonic() + within_s
        while (left_s := until_s - time.monotonic()) > 0.0:
            ready = dict(self._poller.poll(int(left_s * 1000.0) + 1))
            if self._socket in ready:
                # A REP socket answers with a delimiter, a DEALER socket may leave it out: the data
                # come last.
                *_, data = self._socket.recv_multipart()
                return data
            # After the socket: an answer that was sent before the end is still taken.
            if self._monitor in ready:
                recv_monitor_message(self._monitor)
                raise self._make_loss("went away")
        return None

    def make_timeout(self) -> SimulatorError:
        """Return the error of an episode that has taken too long."""
        episode_s = self.timeouts.episode_s
        problem = f"The bridge at {self.address} took longer than {episode_s:g} s over an episode."
        return SimulatorError(problem, self.timeouts.remedy)

    def _make_error(self, predicate: str) -> SimulatorError:
        return SimulatorError(f"The bridge at {self.address} {predicate}.", LOOK)

    def _make_loss(self, predicate: str) -> BridgeLost:
        return BridgeLost(f"The bridge at {self.address} {predicate}.", LOOK)

    def close(self) -> None:
        """End the session without waiting for an answer, and disconnect."""
        if not self._socket.closed:
            try:
                self.send(messages.CloseRequest(self.session, self.next_id()))
            finally:
                self.drop()

    def drop(self) -> None:
        """Disconnect without ending the session; later calls do nothing."""
        if not self._socket.closed:
            self._socket.disable_monitor()
            self._monitor.close(linger=0)
            self._socket.close()


class SharedConnection:
    """The connection that all engines of a process share, and that is reopened after an error.

    One process has one connection, because a bridge may hold a single session.

    Args:
        address: address of the bridge.
        timeouts: time limits for the bridge; default: the limits of this worker.
    """

    def __init__(self, address: str, timeouts: BridgeTimeouts | None = None) -> None:
        self.address = check_address(address)
        self.timeouts = timeouts or read_timeouts()
        self._connection: Connection | None = None
        self._was_reachable = False

    @property
    def is_open(self) -> bool:
        """True if there is a connection without a known error."""
        return self._connection is not None

    def get(self, left_s: float) -> Connection:
        """Return the connection, opened if necessary.

        A bridge that was reachable before is awaited for the whole remaining time. Any other bridge
        is awaited only for the time that a bridge has to start up.

        Args:
            left_s: time limit. [s]

        Raises:
            BridgeLost: no bridge answers by then, or all of its sessions are in use.
            SimulatorError: the bridge violates the protocol, or refuses the session.
        """
        if self._connection is None:
            self._connection = self._open(time.monotonic() + left_s)
        return self._connection

    def _open(self, until_s: float) -> Connection:
        give_up_s = until_s
        # A bridge that has run before is probably starting again. One that never answered is
        # probably not there, and an episode must not wait out its whole limit for that.
        if not self._was_reachable:
            give_up_s = min(until_s, time.monotonic() + self.timeouts.hello_s)
        for pause_s in _iterate_pauses():
            try:
                found = Connection(self.address, self.timeouts, until_s - time.monotonic())
            except BridgeLost:
                if time.monotonic() + pause_s > give_up_s:
                    self._was_reachable = False
                    raise
                time.sleep(pause_s)
            else:
                break
        self._was_reachable = True
        return found

    def drop_if_dead(self) -> None:
        """Drop a connection whose bridge has disconnected while no episode was running."""
        if self._connection is not None and not self._connection.is_alive:
            self.drop()

    def drop(self) -> None:
        """Drop a connection with an error; the next episode opens another one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.drop()

    def close(self) -> None:
        """End the session and disconnect."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(BridgeLost):  # the bridge may have disconnected already
                connection.close()


def connect_from_environment() -> SharedConnection:
    """Return the connection to the bridge that the environment of this process names.

    Raises:
        InvalidValue: the environment names no bridge, or one that the worker must not connect to.
    """
    address = os.environ.get(ADDRESS_VARIABLE)
    if not address:
        remedy = f"Start it with {ADDRESS_OPTION} ADDRESS, or with {ADDRESS_VARIABLE}."
        raise InvalidValue("simulator", "this worker has no bridge.", remedy)
    return _get_shared(address)


@cache
def _get_shared(address: str) -> SharedConnection:
    connection = SharedConnection(address)
    # A bridge that holds a single session would refuse the next process until this one is closed.
    atexit.register(connection.close)
    return connection
