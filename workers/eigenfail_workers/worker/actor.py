"""The worker as Ray sees it. Ray places it and starts it again; it is never asked what happened."""

import platform
import time
from itertools import count

import structlog

from eigenfail import logs
from eigenfail.errors import InputError, Unauthorized
from eigenfail.processes import end_now
from eigenfail.wire.curve import WorkerKey
from eigenfail_workers.worker.parent import Parent

PAUSE_S = 5.0
"""Before another try: what fails at once keeps no machine busy, and last words are sent."""

MAX_REFUSALS = 5

log = structlog.get_logger()


class WorkerActor:
    """Made into a Ray actor by whoever launches it."""

    def place(self) -> str:
        """The machine that Ray has placed it on."""
        return platform.node()

    def run(self, address: str, name: str, key: WorkerKey | None = None) -> None:
        """Serve the hub at the address until it says goodbye; show it the key, if there is one.

        When its process ends, Ray starts another one and calls this anew; not so when this raises.
        Therefore it raises only what another process would not change.

        Raises:
            InputError: the address or a limit is none.
            Unauthorized: the hub refused this worker five times.
        """
        logs.configure("worker")
        try:
            self._serve(address, name, key)
        except (InputError, Unauthorized):
            raise
        except Exception:
            log.exception("worker ends, and is started again", worker=name)
            time.sleep(PAUSE_S)
            end_now(3)

    def _serve(self, address: str, name: str, key: WorkerKey | None) -> None:
        """A connection that was cut within its handshake is taken for a refusal, too."""
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
