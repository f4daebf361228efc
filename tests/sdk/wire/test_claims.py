"""What a worker says of a task that it holds: what the hub finds, and for that task alone."""

from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail.testing.examples import floats
from eigenfail.values import episode
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.wire import messages

SOURCES: tuple[episode.Source, ...] = (
    episode.PriorSource(),
    episode.PolicySource(4),
    episode.TrajectorySource(floats(1, 5, 2)),
)


def setup(**changes: Any) -> episode.EpisodeSetup:
    settings = {"speed_mps": 1e2, "names": ["a", "b"], "depth": 3}
    fields: dict[str, Any] = {"name": "t", "method": "ast", "episodes": 9}
    return CampaignSpec(**fields | {"planner_settings": settings} | changes).setup()


def task(
    source: episode.Source = SOURCES[0], index: int = 1, seed: int = 2**63 - 1
) -> episode.EpisodeTask:
    return episode.EpisodeTask(index, seed, source)


def sent(message: Any) -> Any:
    return messages.read_hub_message(messages.encode(message))


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: type(source).__name__)
def test_a_worker_finds_what_the_hub_finds_after_a_restart(source: episode.Source) -> None:
    stored = msgspec.json.decode(msgspec.json.encode(setup()), type=episode.EpisodeSetup)
    (there,) = sent(messages.Lease(1, (task(source),))).tasks
    told = messages.fingerprint_task(sent(messages.Setup(1, setup())).setup, there)
    assert told == messages.fingerprint_task(stored, task(source))
    assert len(told) == messages.FINGERPRINT_BYTES
    assert messages.is_same_task(there, task(source))


def test_the_order_of_settings_does_not_count() -> None:
    turned = dict(reversed(setup().planner_settings.items()))
    assert messages.fingerprint_task(
        setup(planner_settings=turned), task()
    ) == messages.fingerprint_task(setup(), task())


@pytest.mark.parametrize(
    "other",
    [
        task(index=2),
        task(seed=7),
        task(episode.PolicySource(4)),
        task(episode.PolicySource(5)),
        task(episode.TrajectorySource(floats(2, 5, 2))),
        task(episode.TrajectorySource(np.zeros((0, 2), np.float32))),
    ],
    ids=lambda other: f"{other.index}-{other.seed}-{other.source_kind}",
)
def test_another_task_is_another(other: episode.EpisodeTask) -> None:
    mine = task(episode.PolicySource(3))
    assert messages.fingerprint_task(setup(), other) != messages.fingerprint_task(setup(), mine)
    assert not messages.is_same_task(mine, other)


def test_so_is_the_same_of_another_campaign() -> None:
    for changes in ({"planner": "idm"}, {"planner_settings": {}}, {"scenario": "merge_in"}):
        assert messages.fingerprint_task(setup(**changes), task()) != messages.fingerprint_task(
            setup(), task()
        )
