"""Whose noise is still needed: settings name campaigns, and analyses read them."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import msgspec
from sqlalchemy import ColumnElement, Connection, or_, select

from eigenfail.values import FINAL_STATES, AnalysisState, CampaignSpec, CampaignState
from eigenfail_services.store.schema import analyses, campaigns
from eigenfail_services.store.schema.column_types import MAX_NUMBER

NAMING = frozenset({"campaign", "data_from"})
"""Settings of methods that name campaigns whose noise is injected or learnt from."""

OPEN = frozenset(CampaignState) - FINAL_STATES
UNFINISHED = frozenset({AnalysisState.QUEUED, AnalysisState.RUNNING})


class Named(msgspec.Struct, frozen=True):
    """Of a spec, what may name campaigns."""

    settings: Mapping[str, Any] = {}


_named = msgspec.json.Decoder(Named)


def episodes_of(settings: Mapping[str, Any]) -> tuple[int | None, set[int]]:
    """The campaign, and those of its episodes, that settings name one by one.

    Settings of a plug-in's method may be called the same and mean, and be, anything.
    """
    campaign = next(_ids([settings.get("campaign")]), None)
    return campaign, {*_ids(settings.get("episode")), *_ids(settings.get("episodes"))}


def numbers(settings: Mapping[str, Any]) -> Iterator[int]:
    """The campaigns that settings name, those of an ensemble's members included."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from numbers(value)
        if name in NAMING:
            yield from _ids(value)


def _ids(value: Any) -> Iterator[int]:
    """What can be one, of a value or a list of them."""
    found = value if isinstance(value, list | tuple) else [value]
    return (each for each in found if type(each) is int and 0 <= each <= MAX_NUMBER)


def in_use(connection: Connection, campaign: int | None = None) -> frozenset[int]:
    """Campaigns whose noise one that has not ended injects or learns from, or an analysis reads.

    Args:
        connection: in which nobody who holds the campaign begins to need it.
        campaign: of analyses, those of this one alone are looked for.
    """
    mine = () if campaign is None else (analyses.c.campaign == campaign,)
    read = select(analyses.c.campaign).where(*mine, analyses.c.state.in_(UNFINISHED))
    specs = select(campaigns.c.spec).where(campaigns.c.state.in_(OPEN), names_some())
    named = (_named.decode(text).settings for text in connection.execute(specs).scalars())
    return frozenset(connection.execute(read).scalars()).union(*map(numbers, named))


def names_some() -> ColumnElement[bool]:
    """Whether a spec may name a campaign: most need not be read."""
    return or_(*(campaigns.c.spec.contains(f'"{name}"') for name in sorted(NAMING)))


def hold(connection: Connection, specs: Iterable[CampaignSpec]) -> None:
    """Have campaigns that new ones name lose no noise until these are there for all to see."""
    if wanted := {number for spec in specs for number in numbers(spec.settings)}:
        hold_noise(connection, wanted)


def hold_noise(connection: Connection, wanted: Collection[int]) -> None:
    """Have these campaigns lose no noise until this transaction ends, nor begin while they do."""
    held = select(campaigns.c.id).where(campaigns.c.id.in_(wanted)).order_by(campaigns.c.id)
    connection.execute(held.with_for_update(read=True)).all()
