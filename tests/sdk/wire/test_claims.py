"""What a worker says of a task that it holds: what the hub finds, and for that task alone."""

from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail.testing.examples import floats
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import (
    EpisodeSetup,
    EpisodeTask,
    PolicySource,
    PriorSource,
    Source,
    TrajectorySource,
)
from eigenfail.wire.messages import (
    FINGERPRINT_BYTES,
    Lease,
    Setup,
    encode,
    fingerprint_task,
    is_same_task,
    read_hub_message,
)

SOURCES: tuple[Source, ...] = (
    PriorSource(),
    PolicySource(4),
    TrajectorySource(floats(1, 5, 2)),
)


def setup(**changes: Any) -> EpisodeSetup:
    settings = {"speed_mps": 1e2, "names": ["a", "b"], "depth": 3}
    fields: dict[str, Any] = {"name": "t", "method": "ast", "episodes": 9}
    return CampaignSpec(**fields | {"planner_settings": settings} | changes).setup()


def task(source: Source = SOURCES[0], index: int = 1, seed: int = 2**63 - 1) -> EpisodeTask:
    return EpisodeTask(index, seed, source)


def sent(message: Any) -> Any:
    return read_hub_message(encode(message))


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: type(source).__name__)
def test_a_worker_finds_what_the_hub_finds_after_a_restart(source: Source) -> None:
    stored = msgspec.json.decode(msgspec.json.encode(setup()), type=EpisodeSetup)
    (there,) = sent(Lease(1, (task(source),))).tasks
    told = fingerprint_task(sent(Setup(1, setup())).setup, there)
    assert told == fingerprint_task(stored, task(source))
    assert len(told) == FINGERPRINT_BYTES
    assert is_same_task(there, task(source))


def test_the_order_of_settings_does_not_count() -> None:
    turned = dict(reversed(setup().planner_settings.items()))
    assert fingerprint_task(setup(planner_settings=turned), task()) == fingerprint_task(
        setup(), task()
    )


@pytest.mark.parametrize(
    "other",
    [
        task(index=2),
        task(seed=7),
        task(PolicySource(4)),
        task(PolicySource(5)),
        task(TrajectorySource(floats(2, 5, 2))),
        task(TrajectorySource(np.zeros((0, 2), np.float32))),
    ],
    ids=lambda other: f"{other.index}-{other.seed}-{other.source_kind}",
)
def test_another_task_is_another(other: EpisodeTask) -> None:
    mine = task(PolicySource(3))
    assert fingerprint_task(setup(), other) != fingerprint_task(setup(), mine)
    assert not is_same_task(mine, other)


def test_so_is_the_same_of_another_campaign() -> None:
    for changes in ({"planner": "idm"}, {"planner_settings": {}}, {"scenario": "merge_in"}):
        assert fingerprint_task(setup(**changes), task()) != fingerprint_task(setup(), task())
