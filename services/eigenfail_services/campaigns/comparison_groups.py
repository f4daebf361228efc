"""Many campaigns side by side: those that differ in their seeds alone are one group."""

from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values import Campaign, CampaignSpec, Comparison
from eigenfail_services.campaigns.comparison import compare
from eigenfail_services.campaigns.distinctions import leaves
from eigenfail_services.campaigns.drafts import completed

FEWEST, MOST = 2, 12

ABSENT = "–"

Group = tuple[Campaign, ...]


class Setting(msgspec.Struct, frozen=True):
    """A setting of each campaign, as text.

    Attributes:
        path: in a CampaignSpec.
        values: in the order of the campaigns.
    """

    path: str
    values: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether not all of them have the same."""
        return len(set(self.values)) > 1


def picked(ids: Sequence[int], store: Store) -> tuple[Campaign, ...]:
    """The campaigns to be compared, each once, in order.

    Raises:
        InvalidValue: they are too many.
        NotFound: no such campaign.
    """
    different = tuple(dict.fromkeys(ids))
    if len(different) > MOST:
        problem = f"{len(different)} campaigns are named; {FEWEST} to {MOST} can be compared."
        raise InvalidValue("campaign", problem, "Leave some of them out.")
    return tuple(map(store.campaigns.get, different))


def groups(campaigns: Sequence[Campaign]) -> tuple[Group, ...]:
    """Campaigns that differ in name and seed alone, together; each alone if all of them do."""
    found: dict[bytes, list[Campaign]] = {}
    for campaign in campaigns:
        alike = replace(campaign.spec, name="alike", seed=0)
        found.setdefault(msgspec.msgpack.encode(alike, order="sorted"), []).append(campaign)
    if len(found) == 1:
        return tuple((campaign,) for campaign in campaigns)
    return tuple(map(tuple, found.values()))


def against_first(store: Store, found: Sequence[Group]) -> tuple[Comparison, ...]:
    """Every group but the first, as B, against the first, as A."""
    first, *others = ([campaign.id for campaign in group] for group in found)
    return tuple(compare(store, first, other) for other in others)


def settings(campaigns: Sequence[Campaign]) -> tuple[Setting, ...]:
    """Every setting of any of them, with the defaults of plug-ins that are installed here."""
    flat = [dict(leaves(msgspec.to_builtins(whole(each.spec)))) for each in campaigns]
    paths = sorted(dict.fromkeys(path for each in flat for path in each), key=place)
    return tuple(Setting(path, tuple(each.get(path, ABSENT) for each in flat)) for path in paths)


def place(path: str) -> int:
    """Where the field of a spec stands that a setting belongs to."""
    return CampaignSpec.__struct_fields__.index(path.partition(".")[0])


def whole(spec: CampaignSpec) -> CampaignSpec:
    """The spec with its defaults, or as it is where a plug-in of it is not installed here."""
    try:
        return completed(spec)
    except EigenfailError:
        return spec
