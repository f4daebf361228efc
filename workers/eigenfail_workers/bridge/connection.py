"""A connection to a bridge: questions out, answers in, each within a time limit."""

import time
from uuid import uuid4

import zmq
from zmq.utils.monitor import recv_monitor_message

from eigenfail.errors import BridgeLost, EpisodeError, SimulatorError
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
from eigenfail_workers.bridge.patience import Patience, patience_of_this_worker, pauses

LOOK = "Look at its own log; `eigenfail doctor --bridge` tries it."
LINGER_MS = 200
DELIMITER = b""
"""The empty frame that a REQ puts before its question, and a REP gives back."""


class Connection:
    """One session with a bridge. It is over after the first error; open another one then.

    Args:
        address: that was checked.
        patience: with it; that of this worker, unless it is given.
        left_s: how long all of it may take until there is a welcome. [s]

    Attributes:
        welcome: what the bridge is, and knows.

    Raises:
        BridgeLost: nobody answers there, or it has no room for so long.
        SimulatorError: it answers otherwise than by the protocol, or refuses.
    """

    def __init__(
        self, address: str, patience: Patience | None = None, left_s: float | None = None
    ) -> None:
        self.address = address
        self.session = uuid4().hex
        self.patience = patience or patience_of_this_worker()
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
            self.welcome = self._introduced(self.patience.episode_s if left_s is None else left_s)
        except EpisodeError:
            self._disconnect()
            raise

    def _introduced(self, left_s: float) -> Welcome:
        try:
            self._socket.connect(self.address)
        except zmq.ZMQError as error:
            raise self._trouble(f"cannot be connected to: {error}") from None
        until_s = time.monotonic() + left_s
        for pause_s in pauses():
            self.send(Hello(PROTOCOL, self.session))
            answer = self._greeting(until_s - time.monotonic())
            if not (isinstance(answer, Refusal) and answer.full):
                break
            if time.monotonic() + pause_s > until_s:
                raise self._lost(f"has no room: {in_words(answer.reason)}")
            time.sleep(pause_s)
        return self._let_in(answer)

    def _greeting(self, left_s: float) -> Answer:
        within_s = max(0.0, min(self.patience.hello_s, left_s))
        answer = self._receive(within_s)
        if answer is None:
            raise self._lost(f"did not answer within {within_s:.3g} s")
        return answer

    def _let_in(self, answer: Answer) -> Welcome:
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
            BridgeLost: it cannot be sent.
        """
        try:
            self._socket.send_multipart((DELIMITER, encode(request)), zmq.NOBLOCK)
        except zmq.ZMQError as error:
            raise self._lost(f"takes no message: {error}") from None

    def receive(self, within_s: float) -> Observations | Closed:
        """The next answer.

        Args:
            within_s: the time that is left to the episodes; an answer may take less. [s]

        Raises:
            BridgeLost: the bridge went away, or knows nothing of this session.
            EpisodeError: there is none in time, it does not follow the protocol, or is an error.
            InvalidValue: it is an error, for which the campaign is to blame.
        """
        answer_s = self.patience.answer_s
        answer = self._receive(min(within_s, answer_s))
        if answer is None and within_s < answer_s:
            raise self.too_slow()
        if answer is None:
            problem = f"The bridge at {self.address} did not answer within {answer_s:g} s."
            raise SimulatorError(problem, self.patience.remedy)
        if isinstance(answer, Error):
            if answer.lost:
                raise self._lost(f"knows nothing of this session: {in_words(answer.message)}")
            raise error_of(answer.fault, answer.message)
        if not isinstance(answer, (Observations, Closed)):
            raise self._trouble(f"said {type(answer).__name__.lower()} in the middle of episodes")
        return answer

    def _receive(self, within_s: float) -> Answer | None:
        """The next answer; none if there is none in time."""
        until_s = time.monotonic() + within_s
        while (left_s := until_s - time.monotonic()) > 0.0:
            ready = dict(self._poller.poll(int(left_s * 1000.0) + 1))
            if self._socket in ready:
                *_, data = self._socket.recv_multipart()
                return read_answer(data)
            if self._news in ready:
                recv_monitor_message(self._news)
                raise self._lost("went away")
        return None

    def too_slow(self) -> SimulatorError:
        """What is said of an episode that is given up."""
        episode_s = self.patience.episode_s
        problem = f"The bridge at {self.address} took longer than {episode_s:g} s over an episode."
        return SimulatorError(problem, self.patience.remedy)

    def _trouble(self, what: str) -> SimulatorError:
        return SimulatorError(f"The bridge at {self.address} {what}.", LOOK)

    def _lost(self, what: str) -> BridgeLost:
        return BridgeLost(f"The bridge at {self.address} {what}.", LOOK)

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
