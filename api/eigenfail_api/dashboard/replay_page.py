"""The page of a replay, and whether it gave the result that is stored."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.errors import NoisePruned, NotFound
from eigenfail.presentation.figures import count_noun
from eigenfail.replays import describe_change
from eigenfail.values.campaign import FINAL_STATES, Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult
from eigenfail.versions import differences
from eigenfail.worlds import drawn_for, placed_for
from eigenfail_api.dashboard.cost_charts import REPLAY
from eigenfail_api.dashboard.rendering import OUTCOME_BADGES, page
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_services.campaigns.summary import find_worker
from eigenfail_services.store.store import Store

SAME = "Same result, bit for bit."
OTHER = "Different result."
REPEATABLE = (
    "The digest is that of the stored episode: what happened follows from the noise, and can be "
    "shown again."
)
NOT_REPEATABLE = (
    "Nothing was changed, so the result should be the same: planner, simulator or machine is not "
    "deterministic, or their versions differ. Use those that the campaign ran on."
)
UNSTEADY = (
    "Noise, versions and code are the same, so the stack is not deterministic. Fix its random "
    "seeds, and keep time and threads out of its decisions."
)
WORLD = ("planner", "planner_settings", "scenario", "simulator", "disturbance", "requirements")


class Run(NamedTuple):
    """An episode and its campaign."""

    campaign: Campaign
    result: EpisodeResult


class ReplayVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict on whether a replay gave the stored result.

    Attributes:
        meaning: consequence of the verdict, in words.
        tone: tone for a good or a doubtful verdict; empty for neither.
    """

    words: str
    meaning: str
    tone: str
    sign: str


def find_source(spec: CampaignSpec, index: int) -> tuple[int, int] | None:
    """Return campaign and index of the episode whose noise is repeated; None without an episode."""
    campaign, episodes = (spec.settings.get(name) for name in ("campaign", "episodes"))
    if spec.method != REPLAY or not campaign or not episodes:
        return None
    return campaign, episodes[index % len(episodes)]


def make_replay_verdict(
    stored: Run, again: Run, differing: Sequence[str] | None = None
) -> ReplayVerdict:
    """Compare two results by their digests.

    Args:
        stored: the stored episode.
        again: its replay.
        differing: the versions that differ; None if they are not known.
    """
    # Bit for bit, or every difference would need a tolerance that somebody must defend.
    if stored.result.digest() == again.result.digest():
        return ReplayVerdict(words=SAME, meaning=REPEATABLE, tone="is-distinct", sign="✓")
    courses = (
        f"Stored: {describe_course(stored.result)}; replayed: {describe_course(again.result)}."
    )
    changes = [
        *list_changes(stored, again),
        *(f"other versions ({each})" for each in differing or ()),
    ]
    # With nothing changed the stack itself must differ.
    if not changes:
        apart = f"They differ: {describe_change(stored.result, again.result)}."
        why = NOT_REPEATABLE if differing is None else UNSTEADY
        meaning = f"{courses} {apart} {why}"
        return ReplayVerdict(words=OTHER, meaning=meaning, tone="is-doubtful", sign="!")
    why = f"The result may differ, with {' and '.join(changes)}."
    return ReplayVerdict(words=OTHER, meaning=f"{courses} {why}", tone="", sign="≠")


def describe_course(result: EpisodeResult) -> str:
    """Return the outcome and the number of steps, as text."""
    after = count_noun(result.steps, "step")
    return f"{OUTCOME_BADGES[result.outcome].word} after {after}"


def list_changes(stored: Run, again: Run) -> Iterator[str]:
    """Yield the changes of the replay against a plain one."""
    scale = again.campaign.spec.settings.get("scale", 1.0)
    if scale != 1.0:
        yield f"noise × {scale:g}"
    before, now = stored.campaign.spec, again.campaign.spec
    for name in WORLD:
        if getattr(before, name) != getattr(now, name):
            yield f"another {name.replace('_', ' ').replace('settings', 'setting')}"
    if draw_parameters(stored) != draw_parameters(again):
        yield "other scenario parameters"


def draw_parameters(run: Run) -> dict[str, Any]:
    """Return the scenario parameters that the episode drew."""
    spec = run.campaign.spec
    drawn, placed = drawn_for(spec, run.result.seed), placed_for(spec, run.result.noise)
    return {**spec.scenario_parameters, **drawn, **placed}


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/replays/{campaign}")
def show_replay(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Serve the page on which users wait for the only episode of a replay."""
    seen, result = store.campaigns.get(campaign), find_first_result(store, campaign)
    judged = judge_replay(store, Run(seen, result)) if result else None
    return page(
        "replay.html",
        seen,
        has_arrived=result is not None,
        is_open=result is None and seen.state not in FINAL_STATES,
        judged=judged,
    )


def find_first_result(store: Store, campaign: int) -> EpisodeResult | None:
    """Return the first episode of a campaign; None before it has ended."""
    try:
        # A replay is a campaign of one episode.
        return store.episodes.get(campaign, 0)
    except NotFound:
        return None


def judge_replay(store: Store, again: Run) -> ReplayVerdict | None:
    """Return whether a replay gave the stored result; None if there is nothing to compare."""
    source = find_source(again.campaign.spec, again.result.index)
    if source is None:
        return None
    campaign, index = source
    try:
        stored = store.episodes.finished(campaign, [index])
    # What was pruned cannot be compared.
    except NoisePruned:
        return None
    if not stored:
        return None
    differing = list_differing_versions(store, source, (again.campaign.id, again.result.index))
    return make_replay_verdict(Run(store.campaigns.get(campaign), stored[0]), again, differing)


def list_differing_versions(
    store: Store, first: tuple[int, int], second: tuple[int, int]
) -> tuple[str, ...] | None:
    """Return the versions that differ between two episodes; None if they are not known."""
    try:
        then, now = (find_worker(store, *each).versions for each in (first, second))
    except NotFound:
        return None
    return differences(then, now)
