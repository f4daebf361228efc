"""Replays of stored episodes, with the planner's own account of each step."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec
import numpy as np

from eigenfail import functions, plugins, processes
from eigenfail.errors import EigenfailError, InvalidValue, ServiceError
from eigenfail.process_state import ProcessState
from eigenfail.values import episode
from eigenfail.values.arrays import encode_array
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import SCENARIO, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.operations import DRAWN_AGAIN
from eigenfail.values.proof import ExplainedEpisode, Replayed
from eigenfail.values.records import EpisodeRow
from eigenfail.worlds import resolve_disturbance, world_of

MODULE = "eigenfail.explanations"
"""The module that answers a `ReplayQuestion` in a process of its own."""


# A new process takes seconds to load plug-ins, which many episodes share.
_BATCH = 50
"""Episodes of one question. If its process dies or hangs, each of them is tried again alone."""


START_S = 120.0


EPISODE_S = 60.0
"""Wall time to load plug-ins, and for each episode; a worker allows the same."""


LONGEST_TWICE_S = 45.0
"""A failure that took longer than this is not run a second time without noise."""


DEFAULT = "default"


INFRASTRUCTURE = "infrastructure"


class ReplayQuestion(msgspec.Struct, frozen=True, eq=False, tag=True):
    """Episodes of one campaign to run one after another."""

    spec: CampaignSpec
    tasks: tuple[episode.EpisodeTask, ...]


class ReplayedOutcome(msgspec.Struct, frozen=True):
    """Outcome of a replay; `problem` is the reason for an error, and empty otherwise."""

    outcome: episode.Outcome
    digest: str
    problem: str = ""


_encoder = msgspec.msgpack.Encoder(enc_hook=encode_array)


_answers = msgspec.msgpack.Decoder(list[ReplayedOutcome])


def replay_in_process(
    spec: CampaignSpec, tasks: Sequence[episode.EpisodeTask]
) -> Iterator[ReplayedOutcome | ServiceError]:
    """Run episodes of one campaign in processes that do not run other campaigns.

    An episode that changes process-wide state ends its process: the next one begins in a new one.

    Args:
        spec: specification of the campaign.
        tasks: at least one episode.

    Yields:
        the outcome of each episode in order, or a ServiceError if its process died or hung.

    Raises:
        InputError: the campaign cannot be run here.
    """
    place = 0
    while place < len(tasks):
        for answer in _ask_process(spec, tasks[place : place + _BATCH]):
            yield answer
            place += 1


def _ask_process(
    spec: CampaignSpec, tasks: Sequence[episode.EpisodeTask]
) -> Sequence[ReplayedOutcome | ServiceError]:
    question = _encoder.encode(ReplayQuestion(spec, tuple(tasks)))
    try:
        answer = processes.ask(MODULE, question, START_S + EPISODE_S * len(tasks))
    except ServiceError as error:
        # A separate process for each episode shows which of them ended the process.
        return [error] if len(tasks) == 1 else [_ask_process(spec, [each])[0] for each in tasks]
    return _answers.decode(answer)


def answer_replays(question: ReplayQuestion) -> bytes:
    """Return the outcomes of episodes up to the first one that changed process-wide state."""
    plugins.keep_import_effects()
    # After the import of plug-ins, whose effects are part of the state that episodes begin
    # with.
    engine, outcomes = load_engine()(question.spec.setup()), list[ReplayedOutcome]()
    state = ProcessState()
    try:
        for result in engine.run(question.tasks):
            problem = f"{result.fault.kind}: {result.fault.message}" if result.fault else ""
            outcomes.append(ReplayedOutcome(result.outcome, result.digest(), problem))
            # Later outcomes would depend on this one: the next question begins a fresh process.
            if result.fault and state.changes():
                break
    finally:
        with suppress(Exception):  # the results are there, whatever breaks at the end
            engine.close()
    return _encoder.encode(outcomes)


def replay_episode(spec: CampaignSpec, stored: episode.EpisodeResult) -> Replayed:
    """Inject the stored noise again, with the campaign's planner, scenario and simulator.

    Raises:
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    run = partial(run_once, spec, make_replay_task(stored))
    again = run()
    return _find_unsteadiness(run, again, compare_results(stored, again))


def redraw_episode(spec: CampaignSpec, row: EpisodeRow) -> Replayed:
    """Run an episode whose noise was pruned, with noise drawn again from its seed.

    Raises:
        InvalidValue: the noise does not follow from the seed.
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    if row.source != DRAWN_AGAIN:
        problem = f"Its noise by {row.source} is gone, and does not follow from its seed."
        raise InvalidValue("episode", problem, "Restore a backup from before the pruning.")
    run = partial(run_once, spec, make_redraw_task(row.index, row.seed))
    again = run()
    return _find_unsteadiness(run, again, _compare(row.index, (row.outcome, row.digest), again))


def run_once(spec: CampaignSpec, task: episode.EpisodeTask) -> episode.EpisodeResult:
    """Run an episode in this process.

    Raises:
        InvalidValue: its function is not allowed to run here.
    """
    again = f"{functions.ALLOWED_VARIABLE}={spec.planner.partition(':')[0]} eigenfail"
    remedy = f"It is run in your own process: `{again} episode replay CAMPAIGN/INDEX`."
    world_of(spec.simulator).refuse_unlisted(spec.planner, remedy)
    plugins.keep_import_effects()
    # With its scene, which tells where two courses part; a digest does not cover it.
    engine = load_engine()(msgspec.structs.replace(spec.setup(), scene_every=1))
    try:
        result: episode.EpisodeResult = next(iter(engine.run([task])))
    finally:
        engine.close()
    return result


def explain_episode(
    spec: CampaignSpec, stored: episode.EpisodeResult
) -> tuple[Replayed, ExplainedEpisode]:
    """Run an episode again with its stored noise, with the planner's account of each step.

    A failure is run once more without noise.

    Raises:
        InvalidValue: the episode does not have a course to explain.
        ServiceError: the world is not installed here.
        UnknownName: a plug-in of the campaign is not installed here.
    """
    if stored.fault is not None and stored.fault.kind == INFRASTRUCTURE:
        raise InvalidValue("episode", f"It has no course to explain: {stored.fault.message}")
    plugins.keep_import_effects()
    explain = partial(load_here(plugins.EXPLAINERS), spec.setup())
    began_s = time.monotonic()
    explained: ExplainedEpisode = explain(make_replay_task(stored))
    replayed = compare_results(stored, explained.result)
    # A service has a limited time for its answer: the account counts for more.
    if time.monotonic() - began_s < LONGEST_TWICE_S:
        explained = add_undisturbed(explained, explain, stored, resolve_disturbance(spec))

    again = partial(explain, make_replay_task(stored))
    return _find_unsteadiness(lambda: again().result, explained.result, replayed), explained


def add_undisturbed(
    explained: ExplainedEpisode,
    explain: Callable[[episode.EpisodeTask], ExplainedEpisode],
    stored: episode.EpisodeResult,
    disturbance: DisturbanceModel,
) -> ExplainedEpisode:
    """Run a failure once more without noise, and add that run to its explanation.

    Otherwise, a planner that also fails without noise would look like one that fails only under
    noise that a search has found.

    Args:
        explained: the replay of the episode.
        explain: runs a task of the episode's campaign; see `Explainer`.
        stored: the episode.
        disturbance: the model of its noise, with its channels written out.
    """
    if (stored.is_failure or explained.result.is_failure) and len(stored.noise.z):
        with suppress(EigenfailError):  # the account is there, whatever becomes of a second run
            undisturbed = explain(make_undisturbed_task(stored, disturbance))
            return msgspec.structs.replace(explained, undisturbed=undisturbed)
    return explained


def _find_unsteadiness(
    run: Callable[[], episode.EpisodeResult], again: episode.EpisodeResult, replayed: Replayed
) -> Replayed:
    """Replay an episode again if its replay differs, and add how the two replays differ, if so.

    The same noise and the same code must give the same episode. The second replay distinguishes a
    stack that does not repeat itself from a stack that was changed since.
    """
    if replayed.same:
        return replayed
    with suppress(EigenfailError):  # a stack that cannot run once more says nothing of chance
        once_more = run()
        if once_more.digest() != again.digest():
            return msgspec.structs.replace(replayed, unsteady=describe_change(again, once_more))
    return replayed


def describe_change(one: episode.EpisodeResult, other: episode.EpisodeResult) -> str:
    """Return how two episodes of the same noise differ."""
    phrases = []
    if one.outcome is not other.outcome:
        phrases.append(f"outcome {one.outcome.word} and {other.outcome.word}")
    distances_m = [each.measures.robustness_m for each in (one, other) if each.measures]
    if len(distances_m) == 2 and distances_m[0] != distances_m[1]:
        phrases.append(f"robustness {distances_m[0]:.6g} m and {distances_m[1]:.6g} m")
    if one.steps != other.steps:
        phrases.append(f"{one.steps} and {other.steps} steps")
    first = _find_first_difference(one, other)
    if first is not None:
        phrases.append(f"the vehicles are elsewhere from step {first} on")
    return ", ".join(phrases) or "the same course, and other measures"


def _find_first_difference(one: episode.EpisodeResult, other: episode.EpisodeResult) -> int | None:
    """Return the first step at which two courses differ; None if they do not differ."""
    if one.scene is None or other.scene is None:
        return None
    courses = one.scene.vehicles, other.scene.vehicles
    # Another number of vehicles: there is no step from which on they differ.
    if courses[0].shape[1:] != courses[1].shape[1:]:
        return None
    for step, (here, there) in enumerate(zip(*courses, strict=False)):
        if not np.array_equal(here, there, equal_nan=True):
            return step
    return None


def make_replay_task(stored: episode.EpisodeResult) -> episode.EpisodeTask:
    """Return the task that runs a stored episode with its noise."""
    return episode.EpisodeTask(stored.index, stored.seed, episode.TrajectorySource(stored.noise.z))


def make_undisturbed_task(
    stored: episode.EpisodeResult, disturbance: DisturbanceModel
) -> episode.EpisodeTask:
    """Return the task that runs a stored episode without noise, in its scenario.

    Channels of the scenario keep their noise, since it chose the scenario.
    """
    first = zip(disturbance.list_channels(), stored.noise.z[0].tolist(), strict=True)
    u = tuple(z if split_name(each.name).target == SCENARIO else 0.0 for each, z in first)
    # z = 0 would begin an event that lasts for more than half of the time. After its one row a
    # trajectory injects nothing, and no event begins.
    z = disturbance.noise_shape.step_back(u, None, tuple(stored.noise.sigma[0].tolist()))
    source = episode.TrajectorySource(np.array([z], np.float32))
    return episode.EpisodeTask(stored.index, stored.seed, source)


def compare_results(stored: episode.EpisodeResult, again: episode.EpisodeResult) -> Replayed:
    """Compare two results by their digests."""
    return _compare(stored.index, (stored.outcome, stored.digest()), again)


def _compare(
    index: int, stored: tuple[episode.Outcome, str], again: episode.EpisodeResult
) -> Replayed:
    outcome, digest = stored
    return Replayed(
        index=index,
        stored_outcome=outcome,
        stored_digest=digest,
        outcome=again.outcome,
        digest=again.digest(),
        same=digest == again.digest(),
    )


def make_redraw_task(index: int, seed: int) -> episode.EpisodeTask:
    """Return the task that draws the noise of an episode again from its seed."""
    return episode.EpisodeTask(index, seed, episode.PriorSource())


def load_engine() -> Any:
    """Load the engine that runs episodes on this machine; see `load_here`."""
    return load_here(plugins.ENGINES)


def load_here(group: str) -> Any:
    """Load the default plug-in of a group.

    Raises:
        ServiceError: a simulator is not installed here.
    """
    try:
        return plugins.load(group, DEFAULT)
    except InvalidValue as error:
        raise ServiceError(
            f"Episodes cannot be run here: {error.problem}",
            "Run in a clone: pip install '.[worker]'",
        ) from error
