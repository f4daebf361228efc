"""The worker as a Ray actor. Ray places and restarts it; nothing requests results from it."""

import platform
import time
from itertools import count

import structlog

from eigenfail import logs
from eigenfail.errors import InputError, Unauthorized
from eigenfail.processes import end_now
from eigenfail.wire.keys import WorkerKey
from eigenfail_workers.worker.parent import Parent

PAUSE_S = 5.0
"""Pause before another attempt, so that repeated failures use little time and logs are flushed."""

MAX_REFUSALS = 5

log = structlog.get_logger()


class WorkerActor:
    """Runs a worker; the launcher turns it into a Ray actor."""

    def place(self) -> str:
        """Return the name of the machine on which Ray has placed the actor."""
        return platform.node()

    def run(self, address: str, name: str, key: WorkerKey | None = None) -> None:
        """Serve the hub at an address until it says goodbye.

        If the process of the actor ends, Ray starts another one and calls this method again. If the
        method raises, Ray does not. Therefore the method raises only errors that another process
        would meet, too.

        Args:
            address: address of the hub.
            name: name of the worker.
            key: for a hub that requires keys.

        Raises:
            InputError: the address or a limit is not valid.
            Unauthorized: the hub refused this worker five times.
        """
        logs.configure("worker")
        try:
            self._serve(address, name, key)
        except (InputError, Unauthorized):
            raise
        except Exception:
            log.exception("worker ends, and is started again", worker=name)
            # Not by an exit, which would wait for the threads of a broken worker.
            time.sleep(PAUSE_S)
            end_now(3)

    def _serve(self, address: str, name: str, key: WorkerKey | None) -> None:
        # A connection that is cut during its handshake looks like a refusal: hence more attempts.
        for refusals in count(1):
            try:
                Parent(address, name, key=key).serve()
            except Unauthorized as error:
                if refusals == MAX_REFUSALS:
                    raise
                log.warning("refused, trying again", worker=name, why=str(error))
                time.sleep(PAUSE_S)
            else:
                return
