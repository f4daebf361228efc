"""The form that launches a campaign."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import urlencode

import msgspec

from eigenfail.errors import InputError
from eigenfail.values import Campaign
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.copying import Copies
from eigenfail_api.dashboard.views.launch_entries import Entry, Texts, in_words
from eigenfail_api.dashboard.views.launch_fields import Field, Group
from eigenfail_api.dashboard.views.launch_layout import Part
from eigenfail_api.dashboard.views.launch_texts import humane
from eigenfail_services.campaigns.clones import continuations, repeats
from eigenfail_services.campaigns.drafts import path_of

SWAPS = frozenset({"method", "scenario", "planner", "simulator", "disturbance.shape.kind"})


class Trouble(msgspec.Struct, frozen=True):
    """A problem in words, and the field that it is of; None where it is of no field."""

    words: str
    field: Field | None = None


class Shown(msgspec.Struct, frozen=True, kw_only=True):
    """A field as it is drawn.

    Attributes:
        entry: what stands in it.
        before: what stood there in the earlier campaign, if that was something else.
        swaps: whether other fields depend on it.
    """

    field: Field
    entry: Entry
    problem: str
    before: str | None
    swaps: bool


class Link(msgspec.Struct, frozen=True):
    """A way to build on the earlier campaign."""

    words: str
    address: str


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """The campaign that the form began with.

    Attributes:
        extends: whether it is asked for more episodes than that one had.
        repeats: what more episodes begin with.
    """

    id: int
    name: str
    extends: bool
    repeats: str
    links: tuple[Link, ...]
    is_open: bool


class LaunchView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        shown: by the name of the field.
        body: what is launched.
        checked: in words, once it was checked and is in order; empty otherwise.
        completed: all that it would be, by path; nothing before that.
        key: tells this launch from others; empty while there is nothing to be launched.
        token: of this page.
        copies: of the launch, for programs; None while there is nothing to be launched.
    """

    parts: tuple[Part, ...]
    shown: Mapping[str, Shown]
    troubles: tuple[Trouble, ...]
    origin: Origin | None
    body: Mapping[str, Any]
    checked: str
    completed: tuple[tuple[str, str], ...]
    key: str
    token: str
    copies: Copies | None

    @property
    def wrong(self) -> str:
        """How many problems there are."""
        return formats.counted(len(self.troubles), "problem")

    def opens(self, group: Group) -> bool:
        """Whether something in a group is given, or wrong, or differs."""
        return any(is_told(self.shown[field.name]) for field in group.all_fields())


def fields_of(parts: Sequence[Part]) -> tuple[Field, ...]:
    """All fields of the form, in its order."""
    return tuple(
        field
        for part in parts
        for field in (*part.fields, *(part.settings.all_fields() if part.settings else ()))
    )


def troubles_of(problems: Sequence[InputError], fields: Sequence[Field]) -> tuple[Trouble, ...]:
    """Each problem with its field: the one of that path, or the nearest above it."""
    by_name = {field.name: field for field in fields}
    return tuple(Trouble(words_of(each), nearest(by_name, path_of(each))) for each in problems)


def nearest(by_name: Mapping[str, Field], path: tuple[str, ...]) -> Field | None:
    """The field at a path, or at the longest part of it that has one."""
    for length in range(len(path), 0, -1):
        if found := by_name.get(".".join(path[:length])):
            return found
    return None


def words_of(error: InputError) -> str:
    """A problem without its path, which the field says, and what to do."""
    problem = error.problem.removeprefix(f"{error.field}: ")
    return f"{humane(problem)} {error.remedy}".strip()


def shown_fields(
    fields: Sequence[Field], texts: Texts, troubles: Sequence[Trouble], origin: Campaign | None
) -> dict[str, Shown]:
    """Every field with what stands in it and what is wrong with that."""
    began = Texts({}, msgspec.to_builtins(origin.spec)) if origin else None
    words: dict[str, str] = {}
    for trouble in troubles:
        if trouble.field:
            before = words.get(trouble.field.name)
            words[trouble.field.name] = f"{before} {trouble.words}" if before else trouble.words
    return {
        field.name: Shown(
            field=field,
            entry=texts.entry(field),
            problem=words.get(field.name, ""),
            before=before_of(field, texts, began),
            swaps=field.name in SWAPS,
        )
        for field in fields
    }


def before_of(field: Field, texts: Texts, began: Texts | None) -> str | None:
    """What stood in a field in the earlier campaign; None if nothing else did."""
    if began is None:
        return None
    now, before = in_words(texts.entry(field)), in_words(began.entry(field))
    return None if now == before else before or f"its default{default_words(field)}"


def default_words(field: Field) -> str:
    """The default in brackets, where there is one."""
    return f" ({field.default})" if field.default else ""


def origin_of(campaign: Campaign, body: Mapping[str, Any]) -> Origin:
    """The campaign that the form began with, and what can be built on it."""
    episodes = body.get("episodes")
    extends = isinstance(episodes, int) and episodes > campaign.spec.episodes
    budget = {"episodes": episodes} if extends else {}
    links = (
        Link(each.words, address(campaign.id, {**budget, **each.changes}))
        for each in continuations(campaign)
    )
    return Origin(
        id=campaign.id,
        name=campaign.spec.name,
        extends=extends,
        repeats=repeats(campaign.spec),
        links=tuple(links),
        is_open=campaign.ended_ms is None,
    )


def address(campaign: int, changes: Mapping[str, Any]) -> str:
    """Of the form that begins with a campaign and some changes."""
    return f"/launch?{urlencode({'from': campaign, **changes})}"


def checked_words(body: Mapping[str, Any]) -> str:
    """That it can be launched, and how large it is."""
    return f"In order: {formats.counted(int(body['episodes']), 'episode')} can be launched."


def is_told(one: Shown) -> bool:
    """Whether a field holds more than its default."""
    return bool(in_words(one.entry) or one.problem or one.before)


def leaves(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Every value of a spec by its path, as text."""
    for name, part in value.items():
        if isinstance(part, dict) and part and not {"uniform", "choice"} & part.keys():
            yield from leaves(part, f"{above}{name}.")
        else:
            yield f"{above}{name}", part if isinstance(part, str) else as_text(part)


def as_text(value: Any) -> str:
    """A value as JSON."""
    return msgspec.json.encode(value).decode()
