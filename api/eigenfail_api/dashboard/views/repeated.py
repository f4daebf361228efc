"""Whether the replay of an episode gave the stored result again."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import msgspec

from eigenfail.values import Campaign, CampaignSpec, EpisodeResult
from eigenfail.variations import drawn_for
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.campaign_costs import REPLAY
from eigenfail_api.dashboard.views.states import OUTCOME_BADGES

SAME = "Same result, bit for bit."
OTHER = "Another result."
REPEATABLE = (
    "The digest is that of the stored episode: what happened follows from the noise, and can be "
    "shown again."
)
NOT_REPEATABLE = (
    "Nothing was changed, so that it should be the same: planner, simulator or machine is not "
    "deterministic, or their versions differ. Use those that the campaign ran on."
)
WORLD = ("planner", "planner_settings", "scenario", "simulator", "disturbance")


class Run(NamedTuple):
    """An episode and its campaign."""

    campaign: Campaign
    result: EpisodeResult


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """Whether it is the same.

    Attributes:
        meaning: what follows from that.
        tone: of a good thing, of a doubtful one, or of neither: empty.
    """

    words: str
    meaning: str
    tone: str
    sign: str


def source_of(spec: CampaignSpec, index: int) -> tuple[int, int] | None:
    """Campaign and index of the episode whose noise one repeats; None if of no episode."""
    campaign, episodes = (spec.settings.get(name) for name in ("campaign", "episodes"))
    if spec.method != REPLAY or not campaign or not episodes:
        return None
    return campaign, episodes[index % len(episodes)]


def verdict(stored: Run, again: Run, differing: Sequence[str] = ()) -> Verdict:
    """The two results by their digests; `differing` are the versions that were not the same."""
    if stored.result.digest() == again.result.digest():
        return Verdict(words=SAME, meaning=REPEATABLE, tone="is-distinct", sign="✓")
    told = f"Stored: {course(stored.result)}; replayed: {course(again.result)}."
    changes = [*changed(stored, again), *(f"other versions ({each})" for each in differing)]
    if not changes:
        meaning = f"{told} {NOT_REPEATABLE}"
        return Verdict(words=OTHER, meaning=meaning, tone="is-doubtful", sign="!")
    why = f"It need not be the same, with {' and '.join(changes)}."
    return Verdict(words=OTHER, meaning=f"{told} {why}", tone="", sign="≠")


def course(result: EpisodeResult) -> str:
    """What came of it, and when."""
    after = formats.counted(result.steps, "step")
    return f"{OUTCOME_BADGES[result.outcome].word} after {after}"


def changed(stored: Run, again: Run) -> Iterator[str]:
    """In what the replay differs from a plain one."""
    scale = again.campaign.spec.settings.get("scale", 1.0)
    if scale != 1.0:
        yield f"noise × {scale:g}"
    before, now = stored.campaign.spec, again.campaign.spec
    for name in WORLD:
        if getattr(before, name) != getattr(now, name):
            yield f"another {name.replace('_', ' ').replace('settings', 'setting')}"
    if parameters(stored) != parameters(again):
        yield "other scenario parameters"


def parameters(run: Run) -> dict[str, Any]:
    """The scenario parameters, as the episode drew them."""
    spec = run.campaign.spec
    return {**spec.scenario_parameters, **drawn_for(spec, run.result.seed)}
