"""The process of one learner: `python -m eigenfail_services.hub.learner_process ADDRESS`.

It speaks with the hub over one PAIR socket and keeps nothing that its checkpoint does not hold.
"""

import os
import signal
import sys

import zmq

from eigenfail import logs, plugins
from eigenfail.errors import EigenfailError, LearnerDiverged
from eigenfail.processes import die_with_parent
from eigenfail.settings import read_settings
from eigenfail.wire.messages import (
    Diverged,
    Message,
    Observed,
    Proposed,
    Start,
    Trouble,
    encode,
    read_learner_command,
)
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.hub.learner_curve import KEY_VARIABLE, unlock


def begin(start: Start) -> Rounds:
    """The rounds of a new learner, or of the one that a checkpoint describes."""
    method = plugins.load(plugins.METHODS, start.method)
    learner = method(start.context, read_settings(method.Settings, start.settings, "settings"))
    rounds = Rounds(learner, start.campaign_seed, start.context.episodes, start.rules)
    if start.checkpoint is not None:
        rounds.restore(start.checkpoint)
    return rounds


def proposed(rounds: Rounds) -> Proposed:
    """What is open now, and how to come back to it."""
    opened = rounds.open()
    return Proposed(
        rounds=opened,
        checkpoint=rounds.checkpoint(),
        because=rounds.because,
        estimate=rounds.estimate(),
        trained_episodes=rounds.trained_episodes(),
    )


class LearnerProcess:
    """Answers each command with the rounds that are open after it."""

    def __init__(self, address: str, key: str) -> None:
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PAIR)
        unlock(self._socket, key)
        self._socket.connect(address)

    def serve(self) -> None:
        """Start as told, then observe round after round until told to stop."""
        start = self._hear()
        if not isinstance(start, Start):
            return
        rounds = begin(start)
        self._say(proposed(rounds))
        while isinstance(command := self._hear(), Observed):
            rounds.complete(command.results)
            self._say(proposed(rounds))

    def complain(self, problem: str) -> None:
        """Say why the learner cannot go on."""
        self._say(Trouble(problem))

    def confess(self, error: LearnerDiverged) -> None:
        """Say that the learner is not to be trusted since its last checkpoint."""
        self._say(Diverged(error.problem, error.remedy))

    def close(self) -> None:
        """Send what is left and disconnect."""
        self._socket.close(linger=1_000)

    def _hear(self) -> Message:
        return read_learner_command(self._socket.recv())

    def _say(self, message: Message) -> None:
        self._socket.send(encode(message))


def main() -> None:
    """Serve the hub at the address in the command line."""
    die_with_parent()
    logs.configure("services")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    process = LearnerProcess(sys.argv[1], os.environ.pop(KEY_VARIABLE))
    try:
        process.serve()
    except LearnerDiverged as error:
        process.confess(error)
    except EigenfailError as error:
        process.complain(str(error))
    finally:
        process.close()


if __name__ == "__main__":
    main()
