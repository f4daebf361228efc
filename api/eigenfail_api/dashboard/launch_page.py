"""The page that launches a campaign, and the form that it checks."""

import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import urlencode
from uuid import NAMESPACE_URL, uuid4, uuid5

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.presentation.figures import format_duration, format_usd
from eigenfail.suites import describes_suite
from eigenfail.values.campaign import Campaign, CampaignFilter, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail_api.dashboard import launch_fields
from eigenfail_api.dashboard.copying import Service, format_curl, read_service
from eigenfail_api.dashboard.launch_layout import LaunchPart, make_layout
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import LARGEST, Stored, read_form
from eigenfail_services.campaigns import drafts, validation
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.store.store import Store

SWAPS = frozenset({"method", "scenario", "planner", "simulator", "disturbance.shape.kind"})


class LaunchTrouble(msgspec.Struct, frozen=True):
    """A problem in words, with its field; None if it belongs to no field."""

    words: str
    field: launch_fields.LaunchField | None = None


class LaunchPage(msgspec.Struct, frozen=True, kw_only=True):
    """A field of the launch form, with its content and error.

    Attributes:
        entry: content of the field.
        before: content of the field in the earlier campaign, as text; None if it is the same.
        swaps: whether other fields depend on the field.
    """

    field: launch_fields.LaunchField
    entry: launch_fields.LaunchEntry
    problem: str
    before: str | None
    swaps: bool


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
    # A problem deep in a table is shown at the field that holds the table.
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
    words = defaultdict[str, list[str]](list)
    for trouble in troubles:
        if trouble.field:
            words[trouble.field.name].append(trouble.words)
    return {
        field.name: LaunchPage(
            field=field,
            entry=texts.entry(field),
            # Several problems of one field stand in one paragraph below it.
            problem=" ".join(words[field.name]),
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
    now, before = (launch_fields.format_entry(each.entry(field)) for each in (texts, began))
    default = f"its default ({field.default})" if field.default else "its default"
    return None if now == before else before or default


def make_origin(campaign: Campaign, body: Mapping[str, Any]) -> dict[str, object]:
    """Return the campaign that the form began with, and what can be built on it."""
    episodes = body.get("episodes")
    extends = isinstance(episodes, int) and episodes > campaign.spec.episodes
    # A link keeps the budget that was typed, if it is larger than that of the earlier campaign.
    budget = {"episodes": episodes} if extends else {}
    return {
        "campaign": campaign,
        "extends": extends,
        "repeats": drafts.describe_repetition(campaign.spec),
        "links": [
            (
                each.words,
                f"/launch?{urlencode({'from': campaign.id, **budget, **each.changes})}",
            )
            for each in drafts.list_continuations(campaign)
        ],
    }


def count_given(group: launch_fields.LaunchGroup, shown: Mapping[str, LaunchPage]) -> int:
    """Return how many fields of a group hold more than their default."""
    fields = (shown[field.name] for field in group.all_fields())
    return sum(
        bool(launch_fields.format_entry(each.entry) or each.problem or each.before)
        for each in fields
    )


MOST_PRECEDENTS = 100


def find_precedent(store: Store, spec: CampaignSpec) -> Campaign | None:
    """Return the newest completed campaign of the same kind; None without one.

    Campaigns of the same kind have the same method, planner, scenario and simulator.
    """
    # A campaign that was cut off says less about the time of a whole one.
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
    """Return the duration and cost of a campaign, estimated from its precedent, as a sentence."""
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
            yield (
                f"{above}{name}",
                part if isinstance(part, str) else msgspec.json.encode(part).decode(),
            )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

FROM, WISH, TOKEN, TOML = "from", "wish", "token", "toml"
IMPORT = "import"
MOST_FIELDS = 2_000
KNOWN = frozenset({FROM, WISH, TOKEN, TOML, *CampaignSpec.__struct_fields__})


@router.get("/launch")
def show_launch(request: Request, store: Stored) -> HTMLResponse:
    """Show the launch form: empty, filled by its address, or `from` an earlier campaign."""
    return page(
        "launch.html", launch_view(store, dict(request.query_params), read_service(request))
    )


@router.post("/launch/form")
async def show_form(request: Request, store: Stored) -> HTMLResponse:
    """Serve the form, checked on request; nothing is launched."""
    typed = await read_form(request, MOST_FIELDS)
    view = await run_sync(launch_view, store, typed, read_service(request))
    return page("launch.html", view)


def launch_view(store: Store, typed: Mapping[str, str], service: Service) -> dict[str, object]:
    """Return the form for typed texts, with the address of the service.

    Raises:
        UnknownName: something was typed that no campaign has.
        InvalidValue: the earlier campaign is not a number.
        NotFound: the earlier campaign does not exist.
    """
    # A misspelt field would be ignored, and another campaign launched than the one meant.
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
    token = typed.get(TOKEN, "") or str(uuid4())
    view: dict[str, object] = {
        "parts": parts,
        "shown": make_shown_fields(fields, texts, troubles, origin),
        "count_given": count_given,
        "troubles": troubles,
        "origin": make_origin(origin, body) if origin else None,
        "body": body,
        "key": "",
        "token": token,
    }
    if not wish or problems:
        return view
    spec = drafts.read_draft(body, store).spec
    return view | {
        "estimate": describe_estimate(store, spec),
        "completed": tuple(iterate_leaves(msgspec.to_builtins(validation.fill_defaults(spec)))),
        "key": make_key(token, body),
        "curl": format_curl(service, "/campaigns", body),
    }


def read_imported(text: str) -> tuple[dict[str, Any], tuple[InputError, ...]]:
    """Return the fields of a campaign's file, and the problems if it cannot be imported."""
    try:
        table = read_toml(text, TOML)
    except InvalidValue as error:
        return {}, (error,)
    if describes_suite(table):
        remedy = "Launch it on the page of a new suite."
        return {}, (InvalidValue(TOML, "The file is a suite of campaigns.", remedy),)
    return table, ()


def read_toml(text: str, field: str) -> dict[str, Any]:
    """Return the table of a TOML file.

    Raises:
        InvalidValue: the text is not TOML, or nested too deeply.
    """
    try:
        return tomllib.loads(text)
    # A number of too many digits is a plain ValueError.
    except (ValueError, RecursionError) as error:
        raise InvalidValue(field, f"The file is not TOML: {error}.") from None


def refuse_strangers(typed: Mapping[str, str]) -> None:
    """Raise UnknownName for a value that belongs to no field of the form."""
    for name in typed:
        if name.partition(".")[0] not in KNOWN:
            raise UnknownName("query", name[:100], KNOWN)


def find_origin(store: Store, typed: Mapping[str, str]) -> Campaign | None:
    """Return the campaign that the form begins with; None without one.

    Raises:
        InvalidValue: the text is not an id.
        NotFound: the campaign does not exist.
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
    # Settings of another plug-in have other names: they must not stay behind.
    chosen = {name: typed[name] for name in drafts.COMPANIONS if typed.get(name)}
    return drafts.change_fields(msgspec.to_builtins(origin.spec), chosen)


def make_key(token: str, body: Mapping[str, Any]) -> str:
    """Return the idempotency key of a form: the same for equal fields of one page."""
    # Sorted: a draft that is typed in another order is the same campaign.
    plain = msgspec.json.encode(body, order="sorted").decode()
    return str(uuid5(NAMESPACE_URL, f"{token} {plain}"))
