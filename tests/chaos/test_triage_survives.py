"""Triage while the controller is killed: what was answered is kept, and nothing by halves."""

from collections.abc import Callable
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
from eigenfail_services.store import open_store
from eigenfail_services.store.triage import episode_subject, mode_subject

pytestmark = [pytest.mark.service, pytest.mark.timeout(deadlines.TEST_S)]

EPISODES = 10
KILLS = 3
ANSWERS_EACH = 5


class Clerk(Thread):
    """Makes numbered changes until the service is gone; knows the last one that was answered."""

    def __init__(self, url: str, change: Callable[[Client, int], object], first: int) -> None:
        super().__init__()
        self.answered = first
        self._url, self._change = url, change

    def run(self) -> None:
        """Change, until a change is not answered."""
        with Client(self._url) as client:
            while True:
                try:
                    self._change(client, self.answered + 1)
                except EigenfailError:
                    return
                self.answered += 1


def fields(number: int) -> dict[str, object]:
    """Fields that all tell the number of their change."""
    ticket = f"https://tickets.example/{number}"
    return {"owner": f"{number}", "labels": [f"{number}"], "ticket": ticket}


def number_of(triage: Triage) -> int:
    """The number of the change that triage is of; all of its fields agree on it."""
    number = int(triage.owner or 0)
    if number:
        assert triage.labels == (f"{number}",)
        assert triage.ticket == f"https://tickets.example/{number}"
    return number


@pytest.mark.fault("SIGKILL of the controller")
def test_answered_triage_outlives_the_controller(stage: Stage) -> None:
    store = open_store(stage.url)
    one, many = crashed(store), crashed(store, EPISODES)
    analysis = analysed(store, one, analysis_result())
    mode = mode_subject(analysis, 1)
    changes: tuple[Callable[[Client, int], object], ...] = (
        lambda client, n: client.triage.change_mode(analysis, 1, **fields(n)),
        lambda client, n: client.triage.change_episodes(many.id, "", **fields(n)),
        lambda client, n: client.triage.add_mode_note(analysis, 1, f"{n}"),
    )
    kept = [0] * len(changes)
    answers = 0
    for _ in range(KILLS):
        controller = stage.controller()
        clerks = [
            Clerk(controller.url, change, first)
            for change, first in zip(changes, kept, strict=True)
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
        rows = {
            number_of(store.triage.get(episode_subject(many.id, index)))
            for index in range(EPISODES)
        }
        assert len(rows) == 1, "A change of many was made by halves."
        notes = [int(note.text) for note in store.triage.notes(mode, 100_000).items]
        assert notes == list(range(len(notes), 0, -1)), "A note is lost, or came twice."
        kept = [number_of(store.triage.get(mode)), rows.pop(), len(notes)]
        for clerk, number in zip(clerks, kept, strict=True):
            # The last change may have been kept, and its answer lost.
            assert number - clerk.answered in {0, 1}
    lines = store.audit.page(100_000).items
    assert len([line for line in lines if line.status == 200]) >= answers
    stage.read()
    store.close()
