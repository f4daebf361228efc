"""A connection to a bridge: questions out, answers in, each within a time limit."""

import time
from uuid import uuid4

import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.errors import SimulatorError
from eigenfail_workers.bridge.faults import error_of
from eigenfail_workers.bridge.messages import (
    MAX_MESSAGE_BYTES,
    PROTOCOL,
    Answer,
    Close,
    Closed,
    Error,
    Hello,
    Message,
    Observations,
    Refusal,
    Welcome,
    encode,
    in_words,
    read_answer,
)

HELLO_S = 10.0
"""So long a bridge may take to come up, or to come back."""

ANSWER_S = 30.0
LINGER_MS = 200
DELIMITER = b""
"""The empty frame that a REQ puts before its question, and a REP gives back."""


class Connection:
    """One session with a bridge. It is over after the first error; open another one then.

    Args:
        address: that was checked.
        answer_s: how long an answer may take. [s]
        hello_s: how long the answer to the hello may take. [s]

    Attributes:
        welcome: what the bridge is, and knows.

    Raises:
        SimulatorError: nobody answers there, or not by the protocol, or it refuses.
    """

    def __init__(self, address: str, answer_s: float = ANSWER_S, hello_s: float = HELLO_S) -> None:
        self.address = address
        self.session = uuid4().hex
        self._answer_s = answer_s
        self._ids = 0
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, LINGER_MS)
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.IPV6, int("[" in address))
        self._news: zmq.Socket[bytes] = self._socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._news, zmq.POLLIN)
        try:
            self.welcome = self._introduced(hello_s)
        except SimulatorError:
            self._disconnect()
            raise

    def _introduced(self, within_s: float) -> Welcome:
        try:
            self._socket.connect(self.address)
        except zmq.ZMQError as error:
            raise self._trouble(f"cannot be connected to: {error}") from None
        self.send(Hello(PROTOCOL, self.session))
        answer = self._receive(within_s)
        if isinstance(answer, Refusal):
            raise self._trouble(f"refuses: {in_words(answer.reason)}")
        if not isinstance(answer, Welcome):
            raise self._trouble(f"answered a hello with {type(answer).__name__.lower()}")
        if answer.protocol != PROTOCOL:
            raise self._trouble(f"speaks protocol {answer.protocol}, and not {PROTOCOL}")
        return answer

    @property
    def is_alive(self) -> bool:
        """Whether the bridge has not gone away, as far as is known."""
        return not self._news.poll(0)

    def next_id(self) -> int:
        """A number that no request of this session had before."""
        self._ids += 1
        return self._ids

    def send(self, request: Message) -> None:
        """Ask; several questions may be under way.

        Raises:
            SimulatorError: it cannot be sent.
        """
        try:
            self._socket.send_multipart((DELIMITER, encode(request)), zmq.NOBLOCK)
        except zmq.ZMQError as error:
            raise self._trouble(f"takes no message: {error}") from None

    def receive(self) -> Observations | Closed:
        """The next answer.

        Raises:
            EpisodeError: there is none in time, it does not follow the protocol, or is an error.
            InvalidValue: it is an error, for which the campaign is to blame.
        """
        answer = self._receive(self._answer_s)
        if isinstance(answer, Error):
            raise error_of(answer.fault, answer.message)
        if not isinstance(answer, (Observations, Closed)):
            raise self._trouble(f"said {type(answer).__name__.lower()} in the middle of episodes")
        return answer

    def _receive(self, within_s: float) -> Answer:
        until_s = time.monotonic() + within_s
        while (left_s := until_s - time.monotonic()) > 0.0:
            ready = dict(self._poller.poll(int(left_s * 1000.0) + 1))
            if self._socket in ready:
                *_, data = self._socket.recv_multipart()
                return read_answer(data)
            if self._news in ready:
                recv_monitor_message(self._news)
                raise self._trouble("went away")
        raise self._trouble(f"did not answer within {within_s:g} s")

    def _trouble(self, what: str) -> SimulatorError:
        problem = f"The bridge at {self.address} {what}."
        return SimulatorError(problem, "Look at its own log; `eigenfail doctor --bridge` tries it.")

    def close(self) -> None:
        """Say goodbye, without waiting for an answer, and disconnect; once is enough."""
        if not self._socket.closed:
            try:
                self.send(Close(self.session, self.next_id()))
            finally:
                self._disconnect()

    def drop(self) -> None:
        """Disconnect from a bridge that is in trouble."""
        if not self._socket.closed:
            self._disconnect()

    def _disconnect(self) -> None:
        self._socket.disable_monitor()
        self._news.close(linger=0)
        self._socket.close()
