"""Checks whether campaigns can be counted together, and test one planner."""

from collections.abc import Sequence
from itertools import pairwise

from msgspec.structs import replace

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec

_OF_NO_EPISODE = (
    "name",
    "episodes",
    "parallel",
    "scene_every",
    "price_usd_per_hour",
    "instances",
    "stop",
)
"""Fields that change no episode, besides how many there are."""


def are_alike(one: CampaignSpec, other: CampaignSpec) -> bool:
    """Return whether campaigns differ in seed and budget alone, and in what changes no episode."""
    return _align(one, other).is_like(one)


def _align(one: CampaignSpec, other: CampaignSpec) -> CampaignSpec:
    """Return the second specification with the seed and budget of the first."""
    same = {name: getattr(one, name) for name in (*_OF_NO_EPISODE, "seed")}
    return replace(other, **same)


def refuse_unlike(campaigns: Sequence[Campaign], field: str) -> None:
    """Refuse campaigns that cannot be counted together: other ones, or the same noise twice.

    Args:
        campaigns: those that are to be counted together.
        field: name of the field that names them, for errors.

    Raises:
        InvalidValue: they differ in more than seed and budget, or two have the same seed.
    """
    for one, other in pairwise(campaigns):
        if not are_alike(one.spec, other.spec):
            differing = _list_differences(one.spec, _align(one.spec, other.spec))
            problem = f"campaigns {one.id} and {other.id} differ in {', '.join(differing)}."
            remedy = "Campaigns that are counted together may differ in seed and budget alone."
            raise InvalidValue(field, problem, remedy)
    seeds = [each.spec.seed for each in campaigns]
    if len(set(seeds)) < len(seeds):
        problem = "two campaigns have the same seed, and so the same episodes."
        raise InvalidValue(field, problem, "Name campaigns with different seeds.")


def _list_differences(one: CampaignSpec, other: CampaignSpec) -> list[str]:
    """Return the names of the fields that differ between two campaigns."""
    fields = CampaignSpec.__struct_fields__
    return [name for name in fields if getattr(one, name) != getattr(other, name)]


NAMED_IDS = 20
"""Ids of campaigns that an error lists at most."""


def pick_named(name: str, campaigns: Sequence[Campaign]) -> Campaign:
    """Return the only campaign of a name: a later one must not take its place unseen.

    Args:
        name: the name.
        campaigns: all campaigns of that name, newest first.

    Raises:
        NotFound: there is none.
        InvalidValue: there are several.
    """
    if not campaigns:
        problem = f"There is no campaign '{name}'."
        raise NotFound(problem, "List campaigns with `eigenfail campaign list`.")
    if len(campaigns) == 1:
        return campaigns[0]
    ids = ", ".join(f"{each.id} ({each.state_word})" for each in campaigns[:NAMED_IDS])
    more = f" and {len(campaigns) - NAMED_IDS} older ones" if len(campaigns) > NAMED_IDS else ""
    problem = f"'{name}' is the name of campaigns {ids}{more}."
    raise InvalidValue("campaigns", problem, "Name the campaign by its id.")


def find_planner(groups: Sequence[Sequence[Campaign]], prefix: str = "") -> str:
    """Return the planner that the campaigns of all scenarios test; empty without a campaign.

    Args:
        groups: campaigns of each scenario.
        prefix: text before the name of the field in errors.

    Raises:
        InvalidValue: one tests another planner than the first, or the same with other settings.
    """
    named = [(place, each) for place, group in enumerate(groups) for each in group]
    for place, campaign in named:
        first = named[0][1]
        one, other = ((each.spec.planner, each.spec.planner_settings) for each in (first, campaign))
        if one != other:
            problem = (
                f"campaign {campaign.id} tests '{other[0]}' with {other[1] or 'its defaults'}, "
                f"and campaign {first.id} '{one[0]}' with {one[1] or 'its defaults'}."
            )
            remedy = "A risk is that of one planner with the same settings."
            raise InvalidValue(f"{prefix}scenarios[{place}].campaigns", problem, remedy)
    return named[0][1].spec.planner if named else ""
