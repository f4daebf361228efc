"""References in the settings of a campaign: noise, episodes and learners of earlier campaigns.

The references are checked once, before the campaign is created, and stored with it. Everything they
name has ended by then: only noise can still be lost. So the claim of a campaign reads the
references in its row as the context of the learner.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from eigenfail.contracts import Injection, Reference
from eigenfail.errors import InputError, InvalidValue, NotFound, ProtocolError
from eigenfail.methods import traits_of
from eigenfail.values.analysis import Analysis, FailureMode
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import FINAL_STATES, Campaign, EpisodeForm
from eigenfail.values.episode import EpisodeResult, Outcome, TrajectorySource, learner_seed
from eigenfail.values.learning import Experience, LearnerContext, Predecessor
from eigenfail.values.proof import ReplayKind
from eigenfail.worlds import world_of
from eigenfail_services import resolution
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.campaigns.validation import check_estimates, list_drawn, list_varied

if TYPE_CHECKING:  # a spec is checked without SQLAlchemy, which takes its time to load
    from eigenfail_services.store.store import Store

MOST_READ = 100_000
"""Episodes that are looked through as data, of all campaigns together."""

MOST_EPISODES = 10_000
MOST_NUMBERS = 25_000_000
"""Most numbers of noise, which travel in one message."""


AT_BIRTH = frozenset({Reference.OWN_LEARNER, Reference.EPISODES})
"""References that only a new learner reads: the state of a restored one has their effect."""

FAILURE_SETTINGS = ("campaign", "episode", "analysis", "mode")
"""Settings that name one failure: the first two together, or the last two."""


def check_references(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Make sure that everything that the settings of a campaign name can be used.

    Raises:
        InvalidValue: a reference does not exist; or a campaign to build on has not ended, has
            learnt nothing, is pruned, or has episodes of another length or with other channels; or
            its method is not installed here.
    """
    references = campaign.references
    _check_noise(campaign, store)
    for field, number in references.learners.items():
        _check_predecessor(campaign, field, number, store)
    for field, numbers in references.data.items():
        _check_data(campaign, field, numbers, store)


def _check_noise(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Make sure that the noise that is injected exists, and means the same here.

    Raises:
        InvalidValue: it does not.
    """
    noise, searching = campaign.references.noise, campaign.searching
    for name, number in (("analysis", noise.analysis), ("campaign", noise.campaign)):
        if number is not None:
            field = f"{searching.field}.{name}"
            with refuse_missing(field):
                source = store.analyses.get(number).campaign if name == "analysis" else number
                before = store.campaigns.get(source)
            _check_channels(before, field, campaign.form.channels)
    injects = searching.traits.injects
    if injects is Injection.FAILURES and noise.campaign is not None:
        _check_failures(campaign, noise.campaign, store)
    if injects is Injection.ONE_FAILURE:
        _check_failure(campaign, store)
    if injects is Injection.TRAJECTORIES:
        _check_trajectories(noise, searching.field, store)


@contextmanager
def refuse_missing(field: str) -> Iterator[None]:
    """Raise InvalidValue for a field if the block does not find something that the field names."""
    try:
        yield
    except NotFound as error:
        raise InvalidValue(field, error.problem, error.remedy) from error


def _check_trajectories(noise: resolution.NamedNoise, field: str, store: "Store") -> None:
    """Check that the noise that a replay names exists.

    The failures of a whole campaign are not read: their number is not bounded.

    Args:
        noise: the noise.
        field: path of the settings that name the noise.
        store: store with the noise.

    Raises:
        InvalidValue: nothing is named; or the analysis is not done, has found no mode, or lacks the
            named mode; or an episode does not have a result.
    """
    if noise.analysis is None and noise.campaign is None:
        problem = "they name neither an analysis nor a campaign whose noise is replayed."
        raise InvalidValue(field, problem, 'Give "analysis", or "campaign".')
    if noise.analysis is None and not noise.episodes:
        return
    with refuse_missing(f"{field}.episodes"):
        known = read_trajectories(noise, store)
    if not known:
        problem = "that analysis found no failure mode to replay."
        raise InvalidValue(f"{field}.analysis", problem, "Name one that has failure modes.")


def _check_failure(campaign: resolution.ResolvedCampaign, store: "Store") -> None:
    """Make sure that one failure is named, and that all replays will be in its scenario.

    Raises:
        InvalidValue: the settings do not name exactly one failure; the episode or mode does not
            exist; the episode did not end in a collision; or the scenario's parameters vary or are
            chosen by the noise.
    """
    noise, method = campaign.references.noise, campaign.searching
    settings = method.settings
    named = {each for each in FAILURE_SETTINGS if getattr(settings, each, None) is not None}
    if named not in ({"campaign", "episode"}, {"analysis", "mode"}):
        words = ", ".join(sorted(named)) or "nothing"
        remedy = 'Give "campaign" and "episode", or "analysis" and "mode", and nothing else.'
        raise InvalidValue(method.field, f"they name {words}, which is not one failure.", remedy)
    if noise.campaign is not None and noise.episode is not None:
        _check_collision(noise.campaign, noise.episode, f"{method.field}.episode", store)
    # The noise is read only to refuse the campaign now if an analysis has no such mode.
    read_trajectories(noise, store)
    for name in campaign.spec.disturbance.searched_parameters:
        problem = "is chosen by the noise, and minimal takes noise away that could be without."
        remedy = f"Leave out the channel scenario.{name}, and give the parameter a value."
        raise InvalidValue(f"scenario_parameters.{name}", problem, remedy)
    for name in list_varied(campaign.spec):
        raise InvalidValue(
            f"scenario_parameters.{name}",
            "varies, so that each replay would be in another scenario than the failure.",
            "`eigenfail episode shrink CAMPAIGN/EPISODE` fixes what the episode drew; or give a"
            " value, for a mode that of its medoid.",
        )


def _check_collision(campaign: int, episode: int, field: str, store: "Store") -> None:
    with refuse_missing(field):
        result = store.episodes.get(campaign, episode)
    if not result.is_failure:
        problem = f"episode {campaign}/{episode} is {result.outcome.word}, not a collision."
        remedy = f"`eigenfail episode list {campaign} --outcome collision` lists failures."
        raise InvalidValue(field, problem, remedy)


def _check_failures(campaign: resolution.ResolvedCampaign, number: int, store: "Store") -> None:
    """Check that an earlier campaign has failures that can be injected here.

    Raises:
        InvalidValue: it has not ended, is without failures, or has episodes of another length.
    """
    field = f"{campaign.searching.field}.campaign"
    before = _find_ended(number, field, store)
    if not before.counts.failures:
        problem = f"campaign {before.id} has no failure to start from."
        raise InvalidValue(field, problem, "Name a campaign with failures, such as one of ast.")
    _check_horizon(before, field, campaign.form.steps)


def _check_predecessor(
    campaign: resolution.ResolvedCampaign, field: str, number: int, store: "Store"
) -> None:
    """Make sure that the learner of an earlier campaign can be continued or used.

    Args:
        campaign: the campaign that names it.
        field: the setting that names it.
        number: id of the earlier campaign.
        store: store with the earlier campaign.

    Raises:
        InvalidValue: it has not ended, has other channels, or has learnt nothing of use; or its
            method is not installed here.
    """
    searching, before = campaign.searching, _find_ended(number, field, store)
    _check_channels(before, field, campaign.form.channels)
    setting = field.removeprefix(f"{searching.field}.")
    if searching.traits.references[setting] is Reference.OWN_LEARNER:
        if before.spec.method != searching.name:
            there = before.spec.method
            problem = f"campaign {before.id} is one of {there} and has no policy of"
            remedy = f"Name a campaign of {searching.name}."
            raise InvalidValue(field, f"{problem} {searching.name}.", remedy)
    else:
        learnt = find_knowledge(before, field)
        if campaign.spec.stop.cv is not None and searching is campaign.method:
            check_estimates(learnt, "stop.cv", of_exploits=True)
    # The state is read only to see that it can be read: a claim could not refuse the campaign any
    # more.
    _read_last_state(before, field, store)


def _check_data(
    campaign: resolution.ResolvedCampaign, field: str, numbers: Sequence[int], store: "Store"
) -> None:
    """Make sure that a campaign can learn from the episodes of earlier ones.

    Raises:
        InvalidValue: a campaign has not ended, has not completed an episode, or its robustness
            means something else; its noise has another form or was pruned; or there are too many
            episodes.
    """
    spec, completed = campaign.spec, 0
    for before in [_find_ended(number, field, store) for number in sorted(set(numbers))]:
        if not before.counts.completed:
            problem = f"campaign {before.id} has not completed a single episode."
            raise InvalidValue(field, problem, "Name one that has.")
        _check_horizon(before, field, campaign.form.steps)
        there = before.spec.all_requirements, before.spec.importance
        if there != (spec.all_requirements, spec.importance):
            problem = f"campaign {before.id} has other requirements, or another importance."
            raise InvalidValue(field, problem, "Name campaigns that have the same.")
        _check_channels(before, field, campaign.form.channels)
        _refuse_pruned(before.id, field, store)
        completed += before.counts.completed
    if completed > MOST_READ:
        problem = (
            f"{completed:,} episodes are more than the {MOST_READ:,} that can be looked through."
        )
        raise InvalidValue(field, problem, "Name fewer or smaller campaigns.")


def _refuse_pruned(campaign: int, field: str, store: "Store") -> None:
    # What pruning has left is another sample than the campaign's episodes.
    if records := store.retention.of(campaign):
        lost = sum(each.weight.episodes for each in records)
        problem = f"the noise of {lost:,} episodes of campaign {campaign} was pruned."
        raise InvalidValue(field, problem, "Name another, or restore a backup from before.")


def _check_channels(before: Campaign, field: str, channels: tuple[str, ...]) -> None:
    """Make sure that the noise of an earlier campaign has the same channels as here.

    Channels of functions may have other names.

    Raises:
        InvalidValue: it has other channels, or the same in another order.
    """
    there = before.form.channels
    if len(there) != len(channels):
        problem = (
            f"the noise of campaign {before.id} has another number of channels: {len(there)} "
            f"there, {len(channels)} here."
        )
        raise InvalidValue(field, problem, "Name one whose noise has as many channels.")
    if there != channels and world_of(before.spec.simulator).has_road:
        problem = (
            f"the noise of campaign {before.id} has other channels: {', '.join(there)} there, "
            f"{', '.join(channels)} here."
        )
        raise InvalidValue(field, problem, "Name one with the same channels in the same order.")


def _check_horizon(before: Campaign, field: str, steps: int) -> None:
    """Make sure that the episodes of an earlier campaign have as many steps as here.

    Raises:
        InvalidValue: they have not.
    """
    there = before.form.steps
    if there != steps:
        problem = (
            f"the episodes of campaign {before.id} have {there} steps, here they have {steps}."
        )
        raise InvalidValue(field, problem, "Name campaigns in scenarios of as many steps.")


def _find_ended(campaign: int, field: str, store: "Store") -> Campaign:
    """Return an earlier campaign that a setting names.

    Raises:
        InvalidValue: it does not exist, or has not ended.
    """
    # A campaign that goes on would make a later one depend on the clock.
    with refuse_missing(field):
        before = store.campaigns.get(campaign)
    if before.state not in FINAL_STATES:
        problem = f"campaign {campaign} is {before.state} and has not ended."
        remedy = f"Wait for its end (`eigenfail campaign watch {campaign}`), or cancel it."
        raise InvalidValue(field, problem, remedy)
    return before


def find_knowledge(before: Campaign, field: str) -> resolution.ResolvedMethod:
    """Return the method of an earlier campaign, whose knowledge is to be used.

    Raises:
        InvalidValue: the method is not installed here, learns nothing that can be used, or refuses
            its settings by now.
    """
    try:
        method = resolution.resolve_method(before.spec.method, before.spec.settings)
        learning = resolution.find_searching(method)
    except InputError as error:
        raise InvalidValue(field, f"campaign {before.id}: {error.problem}", error.remedy) from error
    if not learning.description.exploits:
        problem = (
            f"campaign {before.id} is one of {learning.name}, which learns nothing that could be"
            " used."
        )
        raise InvalidValue(field, problem, "Name a campaign of a method that learns, such as ast.")
    return method


def learner_context(campaign: Campaign, store: "Store") -> LearnerContext:
    """Return the context for creating a campaign's learner.

    Raises:
        InvalidValue: its settings name trajectories, or a learner's state, that do not exist or
            cannot be used.
        NotFound: its settings name a campaign, analysis or episode that does not exist.
    """
    # Without a form no length is known: the scenario was not installed when the campaign was made.
    if not campaign.form.steps:
        problem = "the length of its episodes was not known when the campaign was created."
        raise InvalidValue("scenario", problem, "Launch the campaign again.")
    # The method is not loaded to see what its settings name: that was stored when the campaign was
    # created. If it is gone by now, or refuses them, the process of the learner says so.
    references = store.campaigns.read_references(campaign.id)
    trajectories = read_trajectories(references.noise, store)
    return LearnerContext(
        seed=learner_seed(campaign.spec.seed),
        episodes=campaign.spec.episodes,
        horizon=campaign.form.steps,
        trajectories=stack_noise([each.z for each in trajectories], campaign.form),
        predecessors=tuple(
            _read_predecessor(number, field, store) for field, number in references.learners.items()
        ),
        experience=read_experience(references.data, campaign.form, store),
        parallel=campaign.spec.parallel,
        # A replay is of the episode's scenario, unless each draws another scenario from its seed.
        seeds=() if list_drawn(campaign.spec) else tuple(each.seed for each in trajectories),
    )


def _read_predecessor(campaign: int, field: str, store: "Store") -> Predecessor:
    before = store.campaigns.get(campaign)
    spec = before.spec
    return Predecessor(
        campaign=before.id,
        method=spec.method,
        settings=leave_out_births(spec.method, spec.settings),
        seed=learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=before.form.steps,
        state=_read_last_state(before, field, store),
    )


def _read_last_state(before: Campaign, field: str, store: "Store") -> bytes:
    try:
        checkpoint = store.checkpoints.load(before.id)
        if checkpoint is not None:
            return read_checkpoint(checkpoint).learner
    except ProtocolError as error:
        raise InvalidValue(field, f"campaign {before.id}: {error.problem}", error.remedy) from error
    problem = f"campaign {before.id} ended before its first round and has no checkpoint."
    raise InvalidValue(field, problem, "Launch a copy of it, and use its id.")


def leave_out_births(method: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the settings without the ones that matter only when a learner is created."""
    traits = traits_of(method)
    kept = {
        name: value
        for name, value in settings.items()
        if traits.references.get(name) not in AT_BIRTH
    }
    if traits.has_members and "settings" in kept:
        kept["settings"] = leave_out_births(kept.get("method", ""), kept["settings"])
    return kept


def read_trajectories(noise: resolution.NamedNoise, store: "Store") -> Sequence[TrajectorySource]:
    """Return the noise that settings name, with its episodes' seeds; empty if they name none.

    An analysis takes precedence over a campaign: a proof names both, the analysis for its modes.

    Raises:
        InvalidValue: an analysis is not done, or lacks the mode.
        NotFound: the analysis or episode does not exist.
    """
    if noise.analysis is not None:
        return _read_analysed(store.analyses.get(noise.analysis), noise, store)
    if noise.campaign is None:
        return ()
    if not noise.indices:
        portions = store.episodes.failure_portions(noise.campaign)
        both = (pair for each in portions for pair in zip(each.noise, each.seeds, strict=True))
        return [TrajectorySource(z, seed=seed) for z, seed in both]
    return [_make_replay(store.episodes.get(noise.campaign, index)) for index in noise.indices]


def _make_replay(result: EpisodeResult) -> TrajectorySource:
    return TrajectorySource(result.noise.z, seed=result.seed)


def _read_analysed(
    analysis: Analysis, noise: resolution.NamedNoise, store: "Store"
) -> Sequence[TrajectorySource]:
    """Return the noise that represents the modes of an analysis, kind by kind.

    An eigenfailure is replayed with the seed of its mode's medoid.
    """
    modes = _choose_modes(analysis, noise)
    places = ((each.medoid_campaign or analysis.campaign, each.medoid) for each in modes)
    medoids = [_make_replay(store.episodes.get(*place)) for place in places]
    found: list[TrajectorySource] = []
    for kind in noise.what:
        if kind is ReplayKind.MEDOID:
            found += medoids
        else:
            both = zip(medoids, modes, strict=True)
            found += [msgspec.structs.replace(one, z=mode.eigenfailure) for one, mode in both]
    return found


def _choose_modes(analysis: Analysis, noise: resolution.NamedNoise) -> Sequence[FailureMode]:
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    modes = analysis.result.modes
    field, numbers = "modes", noise.modes
    if noise.mode is not None:
        field, numbers = "mode", (noise.mode,)
    for number in numbers:
        if number > len(modes):
            problem = f"analysis {analysis.id} has {len(modes)} modes, and none of number {number}."
            raise InvalidValue(f"settings.{field}", problem, "They are counted from 1.")
    return [modes[number - 1] for number in numbers] if numbers else modes


class CompletedEpisode(msgspec.Struct, frozen=True, order=True):
    """A completed episode; episodes are ordered by robustness, then as they were run."""

    robustness_m: float
    campaign: int
    index: int


def read_experience(
    named: Mapping[str, Sequence[int]], form: EpisodeForm, store: "Store"
) -> Experience | None:
    """Return noise and robustness of the completed episodes that a campaign learns from.

    None if the campaign names no campaigns to learn from.

    Episodes are in order of campaign and index. At most `MOST_EPISODES` episodes with
    `MOST_NUMBERS` numbers are returned. If there are more, one half is the least robust episodes,
    and one half is an even sample of the rest by robustness.

    Args:
        named: the earlier campaigns, by the path of the setting that names them.
        form: length and channels of the campaign's own episodes.
        store: store with the earlier campaigns.

    Raises:
        InvalidValue: the noise of one of them was pruned.
    """
    data = set[int]()
    for field, numbers in named.items():
        data |= set(numbers)
        # Noise may have been pruned between the check of a campaign and its creation.
        for number in sorted(set(numbers)):
            _refuse_pruned(number, field, store)
    if not data:
        return None
    completed = sorted(one for number in sorted(data) for one in _list_completed(number, store))
    fitting = MOST_NUMBERS // (len(form.channels) * form.steps)
    kept = choose_episodes(completed, min(MOST_EPISODES, fitting))
    # `groupby` needs the episodes of a campaign next to each other, and robustness has the order of
    # the noise.
    kept.sort(key=lambda one: (one.campaign, one.index))
    results = [
        result
        for number, ours in groupby(kept, key=lambda one: one.campaign)
        for result in store.episodes.finished(number, [one.index for one in ours])
    ]
    return Experience(
        z=stack_noise([result.noise.z for result in results], form),
        steps=np.array([result.steps for result in results], np.float32),
        robustness_m=np.array([one.robustness_m for one in kept], np.float32),
    )


def _list_completed(campaign: int, store: "Store") -> Iterator[CompletedEpisode]:
    for row in store.episodes.iterate(campaign):
        if row.outcome is not Outcome.ERRORED and row.robustness_m is not None:
            yield CompletedEpisode(row.robustness_m, campaign, row.index)


def choose_episodes(completed: Sequence[CompletedEpisode], most: int) -> list[CompletedEpisode]:
    """Return at most `most` of the ordered episodes: half the least robust, half an even sample."""
    if len(completed) <= most:
        return list(completed)
    least, others = completed[: most // 2], completed[most // 2 :]
    places = np.linspace(0, len(others) - 1, most - len(least)).round().astype(int)
    return [*least, *(others[place] for place in places)]


def stack_noise(noises: Sequence[Floats], form: EpisodeForm) -> Floats:
    """Return trajectories of any length as one array, shape (n, steps, channels).

    They are padded with zeros; without a trajectory n is 0.
    """
    stacked = np.zeros((len(noises), form.steps, len(form.channels)), np.float32)
    for row, noise in zip(stacked, noises, strict=True):
        row[: len(noise)] = noise[: form.steps]
    return stacked
