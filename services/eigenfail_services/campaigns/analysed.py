"""Which campaigns an analysis takes its failures from, and whether they go together."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

from msgspec.structs import replace

from eigenfail import bridges, functions, plugins
from eigenfail.contracts import Scenario, Store
from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values import FINAL_STATES, AnalysedCampaign, AnalysisSettings, Campaign
from eigenfail.values.campaign import CampaignSpec
from eigenfail.values.records import Failures
from eigenfail.values.variation import read_variation
from eigenfail_services.analysis.refusals import check_clusterer
from eigenfail_services.campaigns.checks import horizon

WORLD = ("scenario", "scenario_parameters", "planner", "planner_settings", "simulator")
"""What may differ between campaigns that are analysed together, and is told then."""


class Ground(NamedTuple):
    """What an analysis stands on.

    Attributes:
        campaigns: each once, the first one first; with their states from before their failures
            are read, so that whatever has ended is read whole.
        horizon: steps of their full episodes.
        step_s: duration of a step; None where it has none. [s]
    """

    campaigns: tuple[Campaign, ...]
    horizon: int
    step_s: float | None

    @property
    def ended(self) -> dict[int, int]:
        """How many episodes of each have ended, by id."""
        return {each.id: each.counts.completed + each.counts.failed for each in self.campaigns}

    def recounted(self, store: Store) -> Self:
        """The same with the counts of now: once failures are read, of no fewer episodes."""
        now = ((each, store.campaigns.get(each.id).counts) for each in self.campaigns)
        return self._replace(campaigns=tuple(replace(each, counts=c) for each, c in now))

    def sources(self, rows: Sequence[int]) -> tuple[AnalysedCampaign, ...]:
        """The campaigns as they stand, with as many failures as rows name them."""
        return tuple(
            AnalysedCampaign(
                campaign=each.id,
                episodes=self.ended[each.id],
                failures=rows.count(each.id),
                running=each.state not in FINAL_STATES,
            )
            for each in self.campaigns
        )


def ground(store: Store, campaign: int, settings: AnalysisSettings) -> Ground:
    """What an analysis of a campaign, and of those that its settings name, stands on.

    Raises:
        NotFound: there is no such campaign.
        InvalidValue: there is no such further campaign, or it does not go together with the first;
            or a setting that the clusterer would not heed.
    """
    check_clusterer(settings)
    first = store.campaigns.get(campaign)
    others = [further(store, each) for each in dict.fromkeys(settings.campaigns)]
    campaigns = (first, *(other for other in others if other.id != campaign))
    steps, duration = horizon(first.spec), step_s(first.spec)
    for other in campaigns[1:]:
        refuse_unlike(first.spec, other.spec, f"campaign {other.id}")
    return Ground(campaigns, steps, duration)


def further(store: Store, campaign: int) -> Campaign:
    """A campaign that settings name.

    Raises:
        InvalidValue: there is none.
    """
    try:
        return store.campaigns.get(campaign)
    except NotFound as error:
        raise InvalidValue("campaigns", error.problem, error.remedy) from error


def refuse_unlike(first: CampaignSpec, other: CampaignSpec, name: str) -> None:
    """Raises InvalidValue where the noise of two campaigns cannot stand side by side."""
    told = {
        "episodes of another number of steps": (horizon(first), horizon(other)),
        "steps of another duration": (step_s(first), step_s(other)),
        "another disturbance model: one z is not the same noise in both": (
            first.disturbance,
            other.disturbance,
        ),
    }
    for words, (one, another) in told.items():
        if one != another:
            raise InvalidValue("campaigns", f"{name} has {words}.", "Analyse it by itself.")


def step_s(spec: CampaignSpec) -> float | None:
    """The duration of a step; None of a function, whose steps have none. [s]

    Raises:
        UnknownName: no such scenario or parameter.
        InvalidValue: a parameter outside its bounds.
    """
    if not functions.drives(spec):
        return None
    if spec.simulator == bridges.SIMULATOR:
        return bridges.step_s(spec)
    plugin = plugins.load(plugins.SCENARIOS, spec.scenario)
    scenario: Scenario = plugin()
    variation = read_variation(plugin.Parameters, spec.scenario_parameters)
    return max(scenario(each, spec.seed).mission.dt_s for each in variation.corners())


def portions(store: Store, campaigns: Sequence[Campaign]) -> Iterator[tuple[int, Failures]]:
    """The failures of campaigns, some at a time, each with the id of its campaign."""
    for campaign in campaigns:
        for failures in store.episodes.failure_portions(campaign.id):
            yield campaign.id, failures


def notes(found: Ground) -> tuple[str, ...]:
    """What is to be known of campaigns that were put together, or that still run."""
    specs = [campaign.spec for campaign in found.campaigns]
    differing = [name for name in WORLD if any(_differ(name, specs[0], spec) for spec in specs)]
    running = sorted(each.id for each in found.campaigns if each.state not in FINAL_STATES)
    still = ", ".join(map(str, running))
    words = {
        f"The campaigns differ in {', '.join(differing)}: a mode may be of one of them.": differing,
        f"A snapshot: more episodes were to come in campaign {still}.": running,
    }
    return tuple(sentence for sentence, reason in words.items() if reason)


def _differ(name: str, one: CampaignSpec, other: CampaignSpec) -> bool:
    return bool(getattr(one, name) != getattr(other, name))
