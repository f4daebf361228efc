"""A stored episode, run again in this process from its noise alone."""

from typing import Any

from eigenfail import functions, plugins
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.values import (
    CampaignSpec,
    EpisodeResult,
    EpisodeTask,
    ExplainedEpisode,
    Outcome,
    PriorSource,
    Replayed,
    TrajectorySource,
)
from eigenfail.values.records import EpisodeRow
from eigenfail.values.retention import DRAWN_AGAIN

DEFAULT = "default"
INFRASTRUCTURE = "infrastructure"


def replay_episode(spec: CampaignSpec, stored: EpisodeResult) -> Replayed:
    """Inject the stored noise again, with the campaign's planner, scenario and simulator.

    Raises:
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    return compare(stored, run_once(spec, same_noise(stored)))


def redraw_episode(spec: CampaignSpec, row: EpisodeRow) -> Replayed:
    """Draw the noise of an episode again from its seed, and run it: for one that lost it.

    Raises:
        InvalidValue: its noise does not follow from its seed.
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    if row.source != DRAWN_AGAIN:
        problem = f"Its noise by {row.source} is gone, and does not follow from its seed."
        raise InvalidValue("episode", problem, "Restore a backup from before the pruning.")
    again = run_once(spec, EpisodeTask(row.index, row.seed, PriorSource()))
    return compared(row.index, (row.outcome, row.digest), again)


def run_once(spec: CampaignSpec, task: EpisodeTask) -> EpisodeResult:
    """One episode in this process.

    Raises:
        InvalidValue: its function may not be run here.
    """
    if spec.simulator == functions.SIMULATOR:
        again = f"{functions.ALLOWED_VARIABLE}={spec.planner.partition(':')[0]} eigenfail"
        remedy = f"It is run in your own process: `{again} episode replay CAMPAIGN/INDEX`."
        functions.refuse_unlisted(spec.planner, remedy)
    engine = load_engine()(spec.setup())
    try:
        result: EpisodeResult = next(iter(engine.run([task])))
    finally:
        engine.close()
    return result


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
    return compared(stored.index, (stored.outcome, stored.digest()), again)


def compared(index: int, stored: tuple[Outcome, str], again: EpisodeResult) -> Replayed:
    """A stored outcome and digest, and what came of another run."""
    outcome, digest = stored
    return Replayed(
        index=index,
        stored_outcome=outcome,
        stored_digest=digest,
        outcome=again.outcome,
        digest=again.digest(),
        same=digest == again.digest(),
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
