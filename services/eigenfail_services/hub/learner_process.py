"""The process of one learner: `python -m eigenfail_services.hub.learner_process ADDRESS`.

It talks to the hub over one PAIR socket and keeps nothing that its checkpoint does not hold.
"""

import os
import signal
import sys

import zmq

from eigenfail import logs, plugins
from eigenfail.errors import EigenfailError, LearnerDiverged, read_text
from eigenfail.processes import die_with_parent
from eigenfail.settings import read_settings
from eigenfail.wire import messages
from eigenfail_services.campaigns.rounds import Rounds
from eigenfail_services.hub.learner_link import KEY_VARIABLE, encrypt_caller


def create_rounds(start: messages.Start) -> Rounds:
    """Return the rounds of a new learner, or of the learner in a checkpoint."""
    method = plugins.load(plugins.METHODS, start.method)
    learner = method(start.context, read_settings(method.Settings, start.settings, "settings"))
    rounds = Rounds(learner, start.campaign_seed, start.context.episodes, start.rules)
    if start.checkpoint is not None:
        rounds.restore(start.checkpoint)
    return rounds


def make_proposal(rounds: Rounds) -> messages.Proposed:
    """Return the message with the open rounds and the learner's checkpoint."""
    opened = rounds.open()
    return messages.Proposed(
        rounds=opened,
        checkpoint=rounds.checkpoint(),
        stopped_because=rounds.stopped_because,
        estimate=rounds.estimate(),
        trained_episodes=rounds.trained_episodes(),
    )


class LearnerProcess:
    """Answers each command of the hub with the rounds that are open after it.

    Args:
        address: address of the hub's socket.
        key: the public key of that socket.
    """

    def __init__(self, address: str, key: str) -> None:
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.PAIR)
        encrypt_caller(self._socket, key)
        self._socket.connect(address)

    def serve(self) -> None:
        """Create the learner, then observe round after round until the hub stops the process."""
        start = self._receive()
        if not isinstance(start, messages.Start):
            return
        rounds = create_rounds(start)
        self.send(make_proposal(rounds))
        while isinstance(command := self._receive(), messages.Observed):
            rounds.complete(command.results)
            self.send(make_proposal(rounds))

    def send(self, message: messages.Message) -> None:
        """Send a message to the hub."""
        self._socket.send(messages.encode(message))

    def close(self) -> None:
        """Send queued messages and disconnect."""
        self._socket.close(linger=1_000)

    def _receive(self) -> messages.Message:
        return messages.read_learner_command(self._socket.recv())


def main() -> None:
    """Serve the hub at the address in the command line."""
    die_with_parent()
    logs.configure("services")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    plugins.keep_import_effects()
    # Taken out of the environment, which processes that the method starts inherit.
    process = LearnerProcess(sys.argv[1], os.environ.pop(KEY_VARIABLE))
    try:
        process.serve()
    except LearnerDiverged as error:
        process.send(messages.Diverged(error.problem, error.remedy))
    except EigenfailError as error:
        process.send(messages.Trouble(read_text(error)))
    finally:
        process.close()


if __name__ == "__main__":
    main()
