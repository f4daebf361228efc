"""Triage while the controller is killed: what was answered is kept, and nothing by halves."""

from threading import Thread

import deadlines
import pytest
from stage import Stage
from started import wait_until
from store_checks.modes import analysed, crashed

from eigenfail.client import Client
from eigenfail.errors import EigenfailError
from eigenfail.testing.examples import analysis_result
from eigenfail.values.triage import Triage
from eigenfail_services.store.store import open_store

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

KILLS = 3
ANSWERS_EACH = 5
MODES = (1, 2)


class Clerk(Thread):
    """Makes numbered changes until the service is gone; knows the last one that was answered."""

    def __init__(self, url: str, analysis: int, mode: int, first: int) -> None:
        super().__init__()
        self.answered = first
        self._url, self._analysis, self._mode = url, analysis, mode

    def run(self) -> None:
        """Change, until a change is not answered."""
        with Client(self._url) as client:
            while True:
                number = self.answered + 1
                ticket = f"https://tickets.example/{number}"
                try:
                    client.triage.change_mode(
                        self._analysis, self._mode, ticket=ticket, note=f"{number}"
                    )
                except EigenfailError:
                    return
                self.answered += 1


def number_of(triage: Triage) -> int:
    """The number of the change that triage is of; all of its fields agree on it."""
    number = int(triage.note or 0)
    if number:
        assert triage.ticket == f"https://tickets.example/{number}"
    return number


@pytest.mark.fault("SIGKILL of the controller")
def test_answered_triage_outlives_the_controller(stage: Stage) -> None:
    store = open_store(stage.url)
    analysis = analysed(store, crashed(store), analysis_result())
    kept = [0] * len(MODES)
    answers = 0
    for _ in range(KILLS):
        controller = stage.controller()
        clerks = [
            Clerk(controller.url, analysis, mode, first)
            for mode, first in zip(MODES, kept, strict=True)
        ]
        for clerk in clerks:
            clerk.start()
        goals = [first + ANSWERS_EACH for first in kept]
        wait_until(
            lambda clerks=clerks, goals=goals: all(
                clerk.answered >= goal for clerk, goal in zip(clerks, goals, strict=True)
            ),
            "changes are answered",
        )
        controller.kill()
        for clerk in clerks:
            clerk.join()
        answers += sum(clerk.answered - first for clerk, first in zip(clerks, kept, strict=True))
        kept = [number_of(store.analyses.get_triage(analysis, mode)) for mode in MODES]
        for clerk, number in zip(clerks, kept, strict=True):
            # The last change may have been kept, and its answer lost.
            assert number - clerk.answered in {0, 1}
    lines = store.audit.page(100_000).items
    assert len([line for line in lines if line.status == 200]) >= answers
    stage.read()
    store.close()
