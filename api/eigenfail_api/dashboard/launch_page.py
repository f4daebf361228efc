"""The page that launches a campaign, and the form that it checks."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import urlencode
from uuid import NAMESPACE_URL, uuid4, uuid5

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.presentation.figures import count_noun, format_count, format_duration, format_usd
from eigenfail.suites import describes_suite
from eigenfail.values import Campaign, CampaignSpec, CampaignState
from eigenfail.values.campaign import CampaignFilter
from eigenfail_api.dashboard import launch_fields
from eigenfail_api.dashboard.copying import Service, format_curl, read_service
from eigenfail_api.dashboard.launch_layout import LaunchPart, make_layout
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import LARGEST, Stored, read_form
from eigenfail_services.campaigns import drafts
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.store import Store

SWAPS = frozenset({"method", "scenario", "planner", "simulator", "disturbance.shape.kind"})


class LaunchTrouble(msgspec.Struct, frozen=True):
    """A problem in words, and the field that it is of; None where it is of no field."""

    words: str
    field: launch_fields.LaunchField | None = None


class LaunchPage(msgspec.Struct, frozen=True, kw_only=True):
    """The launch form with its fields and errors.

    Attributes:
        entry: what stands in it.
        before: what stood there in the earlier campaign, if that was something else.
        swaps: whether other fields depend on it.
    """

    field: launch_fields.LaunchField
    entry: launch_fields.LaunchEntry
    problem: str
    before: str | None
    swaps: bool


class LaunchLink(msgspec.Struct, frozen=True):
    """A way to build on the earlier campaign."""

    words: str
    address: str


class LaunchOrigin(msgspec.Struct, frozen=True, kw_only=True):
    """The campaign that the form began with.

    Attributes:
        extends: whether it is asked for more episodes than that one had.
        repeats: what more episodes begin with.
    """

    id: int
    name: str
    extends: bool
    repeats: str
    links: tuple[LaunchLink, ...]
    is_open: bool


class LaunchView(msgspec.Struct, frozen=True, kw_only=True):
    """The page that launches a campaign.

    Attributes:
        shown: texts shown, by the name of the field.
        origin: the campaign that the form began with; None without one.
        body: body of the request that launches what is typed.
        checked: in words, once it was checked and is in order; empty otherwise.
        estimate: duration and cost after those of earlier campaigns of the same kind, or that there
            are none, as a sentence.
        key: idempotency key of this launch; empty while there is nothing to launch.
        curl: the command that launches the same; empty while there is nothing to launch.
        completed: fields of the campaign and their values, by path; empty before the check.
        token: token of this page.
    """

    parts: tuple[LaunchPart, ...]
    shown: Mapping[str, LaunchPage]
    troubles: tuple[LaunchTrouble, ...]
    origin: LaunchOrigin | None
    body: Mapping[str, Any]
    checked: str
    estimate: str
    key: str
    curl: str
    completed: tuple[tuple[str, str], ...]
    token: str

    def opens(self, group: launch_fields.LaunchGroup) -> bool:
        """Whether something in a group is given, or wrong, or differs."""
        return self.count_given(group) > 0

    def count_given(self, group: launch_fields.LaunchGroup) -> int:
        """How many fields of a group hold more than their default."""
        return sum(is_told(self.shown[field.name]) for field in group.all_fields())

    def describe_group(self, group: launch_fields.LaunchGroup) -> str:
        """How many fields a group has, and how many of them hold more than their default."""
        given = self.count_given(group)
        told = f"{format_count(given)} changed" if given else "all at their defaults"
        return f"{format_count(sum(1 for _ in group.all_fields()))}, {told}"


def list_fields(parts: Sequence[LaunchPart]) -> tuple[launch_fields.LaunchField, ...]:
    """Return all fields of the form, in its order."""
    return tuple(
        field
        for part in parts
        for field in (*part.fields, *(part.settings.all_fields() if part.settings else ()))
    )


def list_troubles(
    problems: Sequence[InputError], fields: Sequence[launch_fields.LaunchField]
) -> tuple[LaunchTrouble, ...]:
    """Return each problem with its field: the field of its path, or the nearest above it."""
    by_name = {field.name: field for field in fields}
    return tuple(
        LaunchTrouble(describe_error(each), find_nearest_field(by_name, drafts.find_path(each)))
        for each in problems
    )


def find_nearest_field(
    by_name: Mapping[str, launch_fields.LaunchField], path: tuple[str, ...]
) -> launch_fields.LaunchField | None:
    """Return the field at a path, or at the longest part of the path that has one."""
    for length in range(len(path), 0, -1):
        if found := by_name.get(".".join(path[:length])):
            return found
    return None


def describe_error(error: InputError) -> str:
    """Return a problem without its path, which the field shows, and the remedy."""
    problem = error.problem.removeprefix(f"{error.field}: ")
    return f"{problem[:1].upper()}{problem[1:]} {error.remedy}".strip()


def make_shown_fields(
    fields: Sequence[launch_fields.LaunchField],
    texts: launch_fields.Texts,
    troubles: Sequence[LaunchTrouble],
    origin: Campaign | None,
) -> dict[str, LaunchPage]:
    """Return every field with its text and its error."""
    began = launch_fields.Texts({}, msgspec.to_builtins(origin.spec)) if origin else None
    words: dict[str, str] = {}
    for trouble in troubles:
        if trouble.field:
            before = words.get(trouble.field.name)
            words[trouble.field.name] = f"{before} {trouble.words}" if before else trouble.words
    return {
        field.name: LaunchPage(
            field=field,
            entry=texts.entry(field),
            problem=words.get(field.name, ""),
            before=find_changed_text(field, texts, began),
            swaps=field.name in SWAPS,
        )
        for field in fields
    }


def find_changed_text(
    field: launch_fields.LaunchField, texts: launch_fields.Texts, began: launch_fields.Texts | None
) -> str | None:
    """Return the earlier campaign's text in a field; None if it is the same."""
    if began is None:
        return None
    now, before = (
        launch_fields.format_entry(texts.entry(field)),
        launch_fields.format_entry(began.entry(field)),
    )
    return None if now == before else before or f"its default{describe_default(field)}"


def describe_default(field: launch_fields.LaunchField) -> str:
    """Return the default in brackets, if there is one."""
    return f" ({field.default})" if field.default else ""


def make_origin(campaign: Campaign, body: Mapping[str, Any]) -> LaunchOrigin:
    """Return the campaign that the form began with, and what can be built on it."""
    episodes = body.get("episodes")
    extends = isinstance(episodes, int) and episodes > campaign.spec.episodes
    budget = {"episodes": episodes} if extends else {}
    links = (
        LaunchLink(each.words, make_address(campaign.id, {**budget, **each.changes}))
        for each in drafts.list_continuations(campaign)
    )
    return LaunchOrigin(
        id=campaign.id,
        name=campaign.spec.name,
        extends=extends,
        repeats=drafts.describe_repetition(campaign.spec),
        links=tuple(links),
        is_open=campaign.ended_ms is None,
    )


def make_address(campaign: int, changes: Mapping[str, Any]) -> str:
    """Return the address of the form that begins with a campaign and some changes."""
    return f"/launch?{urlencode({'from': campaign, **changes})}"


def describe_checked(body: Mapping[str, Any]) -> str:
    """Return that the spec can be launched, and how large the campaign is."""
    return f"Valid: {count_noun(int(body['episodes']), 'episode')} can be launched."


def is_told(one: LaunchPage) -> bool:
    """Whether a field holds more than its default."""
    return bool(launch_fields.format_entry(one.entry) or one.problem or one.before)


MOST_PRECEDENTS = 100


def find_precedent(store: Store, spec: CampaignSpec) -> Campaign | None:
    """Return the newest campaign of the same kind that has ended; None without one.

    Of the same kind are campaigns of the same method against the same planner in the same scenario.
    """
    done = CampaignFilter(method=spec.method, state=CampaignState.DONE)
    alike = (
        each
        for each in store.campaigns.page(MOST_PRECEDENTS, where=done).items
        if all(getattr(each.spec, name) == getattr(spec, name) for name in COMPARED)
        and each.counts.completed
        and each.active_s
    )
    return next(alike, None)


def describe_estimate(store: Store, spec: CampaignSpec) -> str:
    """Return duration and cost of a campaign after those of its precedent, as a sentence."""
    if (earlier := find_precedent(store, spec)) is None:
        return "No estimate: no campaign of this method, planner and scenario has ended yet."
    share = spec.episodes / earlier.counts.completed
    duration = format_duration(earlier.active_s * share)
    cost = format_usd(find_cost(earlier).total_usd * share)
    return (
        f"About {duration} and {cost} USD, if each episode takes and costs what those of campaign "
        f"{earlier.id} did, the newest of this method, planner and scenario."
    )


COMPARED = ("planner", "scenario", "simulator")


def iterate_leaves(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield every value of a spec by its path, as text."""
    for name, part in value.items():
        if isinstance(part, dict) and part and not {"uniform", "choice"} & part.keys():
            yield from iterate_leaves(part, f"{above}{name}.")
        else:
            yield f"{above}{name}", part if isinstance(part, str) else as_text(part)


def as_text(value: Any) -> str:
    """A value as JSON."""
    return msgspec.json.encode(value).decode()


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FROM, WISH, TOKEN, TOML = "from", "wish", "token", "toml"
IMPORT = "import"
MOST_FIELDS = 2_000
KNOWN = frozenset({FROM, WISH, TOKEN, TOML, *CampaignSpec.__struct_fields__})


@router.get("/launch")
def show_launch(request: Request, store: Stored) -> HTMLResponse:
    """The form: empty, or as its address says; `from` begins with an earlier campaign."""
    return page(
        "launch.html", launch_view(store, dict(request.query_params), read_service(request))
    )


@router.post("/launch/form")
async def show_form(request: Request, store: Stored) -> HTMLResponse:
    """Serve the form, checked on request; nothing is launched."""
    typed = await read_form(request, MOST_FIELDS)
    view = await run_sync(launch_view, store, typed, read_service(request))
    return page("launch.html", view)


def launch_view(store: Store, typed: Mapping[str, str], service: Service) -> LaunchView:
    """Return the form for typed texts, with the address of the service.

    Raises:
        UnknownName: something was typed that no campaign has.
        InvalidValue: the earlier campaign is no number.
        NotFound: there is no such campaign.
    """
    refuse_strangers(typed)
    wish = typed.get(WISH, "")
    table, refused = read_imported(typed.get(TOML, "")) if wish == IMPORT else ({}, ())
    origin = None if wish == IMPORT else find_origin(store, typed)
    texts = (
        launch_fields.Texts({}, table)
        if wish == IMPORT
        else launch_fields.Texts(typed, make_base(origin, typed))
    )
    parts = make_layout(texts)
    fields = list_fields(parts)
    body = launch_fields.make_body(fields, texts)
    # A file may hold fields that the form does not have.
    problems = refused or (drafts.find_problems(table or body, store) if wish else ())
    troubles = list_troubles(problems, fields)
    in_order = wish != "" and not problems
    token = typed.get(TOKEN, "") or str(uuid4())
    return LaunchView(
        parts=parts,
        shown=make_shown_fields(fields, texts, troubles, origin),
        troubles=troubles,
        origin=make_origin(origin, body) if origin else None,
        body=body,
        checked=describe_checked(body) if in_order else "",
        estimate=describe_estimate(store, drafts.read_draft(body, store).spec) if in_order else "",
        completed=list_full_spec(body, store) if in_order else (),
        key=make_key(token, body) if in_order else "",
        token=token,
        curl=format_curl(service, "/campaigns", body) if in_order else "",
    )


def read_imported(text: str) -> tuple[dict[str, Any], tuple[InputError, ...]]:
    """Return the fields of a campaign's file, and why it cannot be imported, if so."""
    try:
        table = tomllib.loads(text)
    # A number of too many digits is a plain ValueError.
    except (ValueError, RecursionError) as error:
        return {}, (InvalidValue(TOML, f"The file is not TOML: {error}."),)
    if describes_suite(table):
        remedy = "Launch it on the page of a new suite."
        return {}, (InvalidValue(TOML, "The file is a suite of campaigns.", remedy),)
    return table, ()


def refuse_strangers(typed: Mapping[str, str]) -> None:
    """Raises UnknownName for what belongs to no field of the form."""
    for name in typed:
        if name.partition(".")[0] not in KNOWN:
            raise UnknownName("query", name[:100], KNOWN)


def find_origin(store: Store, typed: Mapping[str, str]) -> Campaign | None:
    """Return the campaign that the form begins with.

    Raises:
        InvalidValue: the text is not an id.
        NotFound: there is no such campaign.
    """
    named = typed.get(FROM, "")
    if not named:
        return None
    if not (named.isascii() and named.isdecimal() and 1 <= int(named[:30]) <= LARGEST):
        raise InvalidValue(FROM, f"'{named[:100]}' is not a campaign id.", "Enter a number.")
    return store.campaigns.get(int(named))


def make_base(origin: Campaign | None, typed: Mapping[str, str]) -> dict[str, Any]:
    """Return the fields that the form begins with; settings of a replaced plug-in are dropped."""
    if origin is None:
        return {}
    chosen = {name: typed[name] for name in drafts.COMPANIONS if typed.get(name)}
    return drafts.change_fields(msgspec.to_builtins(origin.spec), chosen)


def list_full_spec(body: Mapping[str, Any], store: Store) -> tuple[tuple[str, str], ...]:
    """Return the full specification of a campaign, including defaults, by path."""
    return tuple(
        iterate_leaves(
            msgspec.to_builtins(drafts.fill_defaults(drafts.read_draft(body, store).spec))
        )
    )


def make_key(token: str, body: Mapping[str, Any]) -> str:
    """Return the idempotency key of a form: the same for equal fields of one page."""
    plain = msgspec.json.encode(body, order="sorted").decode()
    return str(uuid5(NAMESPACE_URL, f"{token} {plain}"))
