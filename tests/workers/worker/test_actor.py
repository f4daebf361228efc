"""What an actor makes of a worker that is refused."""

import pytest

from eigenfail.errors import Unauthorized
from eigenfail_workers.worker import actor


class Refused:
    """A worker that a hub refuses, some times."""

    lives = times = 0

    def __init__(self, *_arguments, **_named) -> None:
        type(self).lives += 1

    def serve(self) -> None:
        if self.lives <= self.times:
            raise Unauthorized("Not you.")


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch) -> type[Refused]:
    monkeypatch.setattr(actor, "PAUSE_S", 0.0)
    made = type("Refused", (Refused,), {})
    monkeypatch.setattr(actor, "Parent", made)
    return made


@pytest.mark.fault(
    "Ray worker refused by the hub",
    group="processes",
    outcome="It connects again, five times in all, and then ends with the hub's reason.",
)
def test_one_refusal_is_not_the_last_word(refused) -> None:
    refused.times = actor.MAX_REFUSALS - 1
    actor.WorkerActor().run("tcp://127.0.0.1:1", "w")
    assert refused.lives == actor.MAX_REFUSALS


@pytest.mark.fault("Ray worker refused by the hub")
def test_a_hub_that_goes_on_refusing_is_believed(refused) -> None:
    refused.times = 1_000_000
    with pytest.raises(Unauthorized):
        actor.WorkerActor().run("tcp://127.0.0.1:1", "w")
    assert refused.lives == actor.MAX_REFUSALS
