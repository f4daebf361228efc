"""The minimal failure that a campaign has found, from its learner's last state."""

from collections.abc import Sequence

import msgspec
import numpy as np

from eigenfail.errors import Conflict
from eigenfail.presentation.analyses import choose_channel_words
from eigenfail.values.analysis import MinimalFailure
from eigenfail.values.arrays import Floats
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import LONGEST_NAME, CampaignSpec, StopRules
from eigenfail.values.episode import Outcome
from eigenfail.worlds import drawn_for, list_channels
from eigenfail_services.analysis.words import Clock, describe_needed
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.methods.minimal import MinimalFacts, read_state
from eigenfail_services.methods.minimal_search import SearchPhase, compute_energy
from eigenfail_services.store.store import Store

METHOD = "minimal"


def make_minimal_spec(store: Store, campaign: int, index: int, episodes: int) -> CampaignSpec:
    """Return the spec of a campaign that shrinks a failure, in the scenario that its episode drew.

    Raises:
        NotFound: the campaign, or the result of the episode, does not exist.
    """
    spec, failure = store.campaigns.get(campaign).spec, store.episodes.get(campaign, index)
    return msgspec.structs.replace(
        spec,
        name=f"{spec.name}: minimal failure of {campaign}/{index}"[-LONGEST_NAME:],
        method=METHOD,
        settings={"campaign": campaign, "episode": index},
        episodes=episodes,
        stop=StopRules(),
        scenario_parameters={**spec.scenario_parameters, **drawn_for(spec, failure.seed)},
    )


def find_minimal_failure(store: Store, campaign: Campaign) -> MinimalFailure:
    """Return the smallest failure that a campaign of `minimal` has found so far.

    Raises:
        Conflict: the campaign uses another method, or no replay has failed yet.
        ProtocolError: its checkpoint cannot be read.
    """
    facts, z = read_knowledge(store, campaign)
    if facts.best is None:
        raise _make_conflict(campaign)
    found = store.episodes.get(campaign.id, facts.best)
    # The failure at full strength is the first replay that failed: weaker ones come after it.
    replays = store.episodes.finished(campaign.id, range(facts.best + 1))
    full = next(result for result in replays if result.is_failure)
    end = "the impact" if found.outcome is Outcome.COLLISION else "the end"
    # The steps of a function have no duration.
    clock = Clock(found.steps, found.scene.dt_s if found.scene else None, end)
    channels = list_channels(campaign.spec)
    return MinimalFailure(
        campaign=campaign.id,
        index=found.index,
        done=facts.phase is SearchPhase.OVER,
        because=_describe_progress(facts, z, campaign, channels),
        words=describe_needed(found.noise.z, clock, channels, found.noise.shape),
        needed=int(np.count_nonzero(found.noise.z)),
        injected=int(np.count_nonzero(full.noise.z)),
        energy=compute_energy(found.noise.z),
        full_energy=compute_energy(full.noise.z),
        log_probability=found.noise.log_probability,
        full_log_probability=full.noise.log_probability,
        log_probability_per_step=found.noise.log_probability / found.steps,
        full_log_probability_per_step=full.noise.log_probability / full.steps,
    )


def read_knowledge(store: Store, campaign: Campaign) -> tuple[MinimalFacts, Floats]:
    """Return the facts and the noise of the campaign's learner after its last whole round.

    Raises:
        Conflict: the campaign uses another method, or has not finished a round.
        ProtocolError: its checkpoint cannot be read.
    """
    if campaign.spec.method != METHOD:
        raise Conflict(
            f"Campaign {campaign.id} is one of {campaign.spec.method}, which shrinks no failure.",
            f"Launch one of {METHOD}, with settings that name a failure.",
        )
    checkpoint = store.checkpoints.load(campaign.id)
    if checkpoint is None:
        raise _make_conflict(campaign)
    return read_state(read_checkpoint(checkpoint).learner)


def _make_conflict(campaign: Campaign) -> Conflict:
    return Conflict(
        f"Campaign {campaign.id} is {campaign.state}, and no replay of it has failed. "
        f"{campaign.stopped_because}".strip(),
        "Wait for its first round."
        if campaign.state not in FINAL_STATES
        else "Shrink a failure in the scenario, and with the planner, of its own campaign.",
    )


def _describe_progress(
    facts: MinimalFacts, z: Floats, campaign: Campaign, channels: Sequence[str]
) -> str:
    if facts.phase is not SearchPhase.OVER:
        goes_on = "The search goes on" if campaign.state not in FINAL_STATES else "It was cut short"
        return f"{goes_on} at blocks of {facts.width} steps: less noise may do."
    if not z.any():
        return "It fails without any noise."
    sentences = [f"No step of one {choose_channel_words(channels).one} can be left out."]
    if facts.low:
        share = f"{100.0 * facts.low / facts.high:.0f} %"
        sentences.append(f"At {share} of its strength it is no failure.")
    if facts.not_run:
        sentences.append(f"{facts.not_run} of the replays that show it could not be run.")
    return " ".join(sentences)
