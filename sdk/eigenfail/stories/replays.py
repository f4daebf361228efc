"""A stored episode, run again in this process from its noise alone."""

from typing import Any

from eigenfail import plugins
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.values import (
    CampaignSpec,
    EpisodeResult,
    EpisodeTask,
    ExplainedEpisode,
    Replayed,
    TrajectorySource,
)

DEFAULT = "default"
INFRASTRUCTURE = "infrastructure"


def replay_episode(spec: CampaignSpec, stored: EpisodeResult) -> Replayed:
    """Inject the stored noise again, with the campaign's planner, scenario and simulator.

    Raises:
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    engine = load_engine()(spec.setup())
    try:
        (again,) = engine.run([same_noise(stored)])
    finally:
        engine.close()
    return compare(stored, again)


def explain_episode(spec: CampaignSpec, stored: EpisodeResult) -> tuple[Replayed, ExplainedEpisode]:
    """The same, with the planner's account of each step.

    Raises:
        InvalidValue: the episode has no course to explain.
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    if stored.fault is not None and stored.fault.kind == INFRASTRUCTURE:
        raise InvalidValue("episode", f"It has no course to explain: {stored.fault.message}")
    explained = load_here(plugins.EXPLAINERS)(spec.setup(), same_noise(stored))
    return compare(stored, explained.result), explained


def same_noise(stored: EpisodeResult) -> EpisodeTask:
    """The task of running it again."""
    return EpisodeTask(stored.index, stored.seed, TrajectorySource(stored.noise.z))


def compare(stored: EpisodeResult, again: EpisodeResult) -> Replayed:
    """The two results by their digests."""
    digests = stored.digest(), again.digest()
    return Replayed(
        index=stored.index,
        stored_outcome=stored.outcome,
        stored_digest=digests[0],
        outcome=again.outcome,
        digest=digests[1],
        same=digests[0] == digests[1],
    )


def load_engine() -> Any:
    """What runs episodes on this machine; see `load_here`."""
    return load_here(plugins.ENGINES)


def load_here(group: str) -> Any:
    """What does the work of a group on this machine.

    Raises:
        ServiceError: the world is not installed here.
    """
    try:
        return plugins.load(group, DEFAULT)
    except InvalidValue as error:
        raise ServiceError(
            f"Episodes cannot be run here: {error.problem}", "Run: pip install 'eigenfail[worker]'"
        ) from error
