"""The page that builds a suite: a base, the settings that vary, and a preview of its campaigns."""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import quote

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Request
from fastapi.responses import HTMLResponse
from msgspec.structs import replace

from eigenfail.errors import EigenfailError, InputError, InvalidValue, NotFound, UnknownName
from eigenfail.presentation.figures import count_noun, format_count, format_duration, format_usd
from eigenfail.settings import convert, read_settings
from eigenfail.suites import (
    BASE,
    SuiteFile,
    SuiteRequest,
    describes_suite,
    expand_suite,
    list_leaves,
    read_path,
    set_path,
    shorten_paths,
)
from eigenfail.values import Campaign, CampaignSpec
from eigenfail.values.suite import SEPARATOR
from eigenfail.wire.http import read_fields
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard.copying import (
    Service,
    format_curl,
    has_none,
    read_service,
    to_suite_toml,
)
from eigenfail_api.dashboard.launch_fields import LaunchField, Texts, make_body
from eigenfail_api.dashboard.launch_layout import LaunchPart, make_layout
from eigenfail_api.dashboard.launch_page import (
    COMPARED,
    FROM,
    IMPORT,
    KNOWN,
    TOML,
    WISH,
    FormView,
    LaunchPage,
    LaunchTrouble,
    describe_error,
    find_nearest_field,
    find_origin,
    find_precedent,
    list_fields,
    make_base,
    make_key,
    make_origin,
    make_shown_fields,
    read_form,
    refuse_strangers,
)
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.suite_axes import (
    MOST_AXES,
    Axis,
    Preview,
    PreviewMember,
    find_axis_values,
    make_axes,
    make_preview,
    read_axes,
)
from eigenfail_api.dashboard.suites_page import make_suite_address
from eigenfail_api.parameters import Stored
from eigenfail_services.campaigns.drafts import find_path, find_problems
from eigenfail_services.campaigns.suites import (
    read_suite,
    refuse_large_suite,
    rename_suite_error,
)
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.store import Store

NAME, WAY, AXIS = "suite", "way", "axis"
FILL, CHECK, LAUNCH = "fill", "check", "launch"
CHECKING = frozenset({CHECK, LAUNCH, IMPORT})
"""Wishes for which everything that is wrong is shown."""

GRID, SWEEP = "grid", "sweep"
UNNAMED = "unnamed"
"""Name of a suite that has none yet, for the check of its members."""

KNOWN_HERE = frozenset({*KNOWN, NAME, WAY, AXIS}) - {"name"}
MOST_NAMED = 1
"""Members that a problem names."""

OWN_FIELDS = (
    LaunchField(
        name=NAME,
        label="name",
        kind="text",
        required=True,
        help="name of the suite: its campaigns are called “name: member”",
    ),
    LaunchField(
        name=WAY,
        label="members",
        kind="choice",
        options=(GRID, SWEEP),
        help="grid: every combination of the values. sweep: the base, and each value alone",
    ),
    LaunchField(
        name=FROM,
        label="campaign",
        kind="number",
        step="1",
        least="1",
        help="id of a campaign, whose fields become the base",
    ),
)
"""Fields of the form that are none of a campaign."""


class SuiteDraft(msgspec.Struct, frozen=True, kw_only=True):
    """A suite as it stands in the form.

    Attributes:
        way: grid or sweep.
        texts: texts of the base.
        base: fields of the base that a file gives; None where the form gives them.
        origin: the campaign that the base began with; None without one.
        refused: why a file or a campaign cannot be the beginning.
    """

    name: str = ""
    way: str = GRID
    axes: tuple[Axis, ...] = ()
    texts: Texts = Texts({}, {})
    base: Mapping[str, Any] | None = None
    origin: Campaign | None = None
    refused: tuple[InputError, ...] = ()


class AxisView(msgspec.Struct, frozen=True, kw_only=True):
    """A setting that varies, in the form.

    Attributes:
        groups: names of the settings to choose from, by the section that they belong to.
        setting: the chosen one; `spacing` are start, stop and number of its values.
    """

    place: int
    groups: tuple[tuple[str, tuple[str, ...]], ...]
    setting: LaunchPage
    values: LaunchPage
    spacing: tuple[LaunchPage, ...]


class SuiteFormView(FormView, frozen=True, kw_only=True):
    """The page.

    Attributes:
        own: fields of the suite itself, by name.
        preview: the members as a grid; None where there is none yet.
        file: address of the suite as a file to download; empty while there is nothing to launch.
        address: page of the suite.
    """

    own: Mapping[str, LaunchPage]
    axes: tuple[AxisView, ...]
    preview: Preview | None
    file: str
    address: str


class Members(msgspec.Struct, frozen=True, kw_only=True):
    """The members of a suite, by name.

    Attributes:
        fields: fields of each member's campaign; none while no axis has values.
        refused: why there are no members.
        troubles: what is wrong with them; `wrong` are the names of those with problems.
    """

    fields: Mapping[str, dict[str, Any]] = {}
    refused: InputError | None = None
    troubles: tuple[LaunchTrouble, ...] = ()
    wrong: frozenset[str] = frozenset()


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/suites/new")
def show_new_suite(request: Request, store: Stored) -> HTMLResponse:
    """Serve the form: empty, or as its address says; `from` begins with an earlier campaign."""
    view = make_suite_form(store, dict(request.query_params), read_service(request))
    return page("suite_form.html", view)


FORMS = Depends(ConcurrencyLimit("forms of suites"), scope="function")


@router.post("/suites/new/form", dependencies=[FORMS])
async def show_suite_form(request: Request, store: Stored) -> HTMLResponse:
    """Serve the form, checked on request; nothing is launched."""
    typed = await read_form(request)
    view = await run_sync(make_suite_form, store, typed, read_service(request))
    return page("suite_form.html", view)


def make_suite_form(store: Store, typed: Mapping[str, str], service: Service) -> SuiteFormView:
    """Return the form for typed texts.

    Raises:
        UnknownName: something was typed that the form does not have.
    """
    refuse_strangers(typed, KNOWN_HERE)
    draft = read_suite_draft(store, typed)
    parts = tuple(map(drop_name, make_layout(draft.texts)))
    fields = list_fields(parts)
    by_name = {field.name: field for field in fields}
    own = {field.name: field for field in (*OWN_FIELDS, *list_axis_fields(draft.axes, by_name))}
    base = draft.base if draft.base is not None else make_body(fields, draft.texts)
    table, axis_troubles = read_axis_table(draft.axes, by_name, own)
    body = {"name": draft.name, "base": base, draft.way: table}
    checks = typed.get(WISH, "") in CHECKING
    members = expand_members(body) if table else Members()
    if checks:
        members = check_members(store, body, members, draft.axes, {**by_name, **own})
    troubles = (
        *(LaunchTrouble(describe_error(each), own.get(each.field)) for each in draft.refused),
        *(axis_troubles if checks else ()),
        *(list_own_troubles(draft, table, own) if checks else ()),
        *members.troubles,
    )
    if checks and not troubles:
        troubles = tuple(list_suite_troubles(body, own))
    in_order = checks and not troubles
    own_texts = Texts({**list_own_texts(draft), FROM: typed.get(FROM, "")}, {})
    shown = make_shown_fields(tuple(own.values()), own_texts, troubles, None)
    return SuiteFormView(
        parts=parts,
        shown=make_shown_fields(fields, draft.texts, troubles, draft.origin),
        troubles=troubles,
        origin=make_origin(draft.origin, body) if draft.origin else None,
        body=body,
        checked=describe_suite(members) if in_order else "",
        estimate="" if axis_troubles else estimate_suite(store, members),
        key=make_key("", body) if in_order else "",
        curl=format_curl(service, "/suites", body) if in_order else "",
        own=shown,
        axes=tuple(make_axis_view(axis, parts, shown) for axis in draft.axes),
        preview=None if axis_troubles else preview_members(draft, members),
        file=f"data:application/toml;charset=utf-8,{quote(to_suite_toml(body))}"
        if in_order and not has_none(body)
        else "",
        address=make_suite_address(draft.name),
    )


def read_suite_draft(store: Store, typed: Mapping[str, str]) -> SuiteDraft:
    """Return the suite that the texts of the form describe."""
    wish = typed.get(WISH, "")
    if wish == IMPORT:
        return import_suite(typed.get(TOML, ""))
    origin, refused = None, tuple[InputError, ...]()
    try:
        origin = find_origin(store, typed)
    except (InvalidValue, NotFound) as error:
        refused = (InvalidValue(FROM, error.problem.removeprefix(f"{FROM}: "), error.remedy),)
    kept = {} if wish == FILL else {**typed}
    way = typed.get(WAY, "")
    return SuiteDraft(
        name=typed.get(NAME, "").strip(),
        way=way if way in {GRID, SWEEP} else GRID,
        axes=read_axes(typed),
        texts=Texts(kept, make_base(origin, kept)),
        origin=origin,
        refused=refused,
    )


def import_suite(text: str) -> SuiteDraft:
    """Return the suite in a file, or the base in the file of a campaign."""
    try:
        table = tomllib.loads(text)
        if not describes_suite(table):
            base = {name: value for name, value in table.items() if name != "name"}
            table = {"name": table["name"], "base": base} if "name" in table else {"base": base}
        written = read_settings(SuiteFile, table, "")
    except InputError as error:
        return SuiteDraft(axes=read_axes({}), refused=(error,))
    # A number of too many digits is a plain ValueError.
    except (ValueError, RecursionError) as error:
        refused = InvalidValue(TOML, f"The file is not TOML: {error}.")
        return SuiteDraft(axes=read_axes({}), refused=(refused,))
    return SuiteDraft(
        name=written.name or "",
        way=SWEEP if written.sweep else GRID,
        axes=make_axes(written.sweep or written.grid),
        texts=Texts({}, written.base),
        base=written.base,
        refused=tuple(list_import_problems(written)),
    )


def list_import_problems(written: SuiteFile) -> Iterator[InputError]:
    """Yield why the form cannot hold a suite."""
    if written.campaigns:
        remedy = "Run it with `eigenfail suite run FILE`."
        yield InvalidValue(TOML, "The form has no list of campaigns.", remedy)
    if written.sweep and written.grid:
        yield InvalidValue(TOML, "The file has sweep and grid.", "Keep one of them.")
    axes = dict(list_leaves(written.sweep or written.grid))
    for path, values in axes.items():
        if not isinstance(values, list):
            remedy = "Write the values to try as [1, 2, 3]."
            yield InvalidValue(TOML, f"{'.'.join(path)} is not a list.", remedy)
    if len(axes) > MOST_AXES:
        remedy = "Run it with `eigenfail suite run FILE`."
        yield InvalidValue(TOML, f"The file varies more than {MOST_AXES} settings.", remedy)


def drop_name(part: LaunchPart) -> LaunchPart:
    """Return a part of the form without the name of the campaign, which the suite gives."""
    return replace(part, fields=tuple(field for field in part.fields if field.name != "name"))


def list_axis_fields(
    axes: Sequence[Axis], by_name: Mapping[str, LaunchField]
) -> Iterator[LaunchField]:
    """Yield the fields of the form for each axis."""
    for axis in axes:
        varied = by_name.get(axis.field)
        hint = f"separated by commas. {varied.hint}" if varied else "separated by commas"
        title = f"Setting {axis.place}"
        yield LaunchField(name=axis.name_part("field"), label="setting", kind="choice", title=title)
        yield LaunchField(
            name=axis.name_part("values"),
            label="values",
            kind="text",
            help=hint,
            title=axis.field or title,
        )
        for part, label in (("start", "or start"), ("stop", "stop"), ("number", "number")):
            yield LaunchField(
                name=axis.name_part(part),
                label=label,
                kind="number",
                step="1" if part == "number" else "any",
                title=f"{axis.field or title}: {part}",
            )


def list_own_texts(draft: SuiteDraft) -> dict[str, str]:
    """Return the texts of the fields that are none of a campaign, by name."""
    parts = ("field", "values", "start", "stop", "number")
    axes = {axis.name_part(part): getattr(axis, part) for axis in draft.axes for part in parts}
    return {NAME: draft.name, WAY: draft.way, **axes}


def make_axis_view(
    axis: Axis, parts: Sequence[LaunchPart], shown: Mapping[str, LaunchPage]
) -> AxisView:
    """Return an axis with the settings to choose from."""
    groups = [(part.title, tuple(field.name for field in list_fields((part,)))) for part in parts]
    if axis.field and axis.field not in {name for _, names in groups for name in names}:
        groups.append(("Other", (axis.field,)))
    return AxisView(
        place=axis.place,
        groups=tuple(groups),
        setting=shown[axis.name_part("field")],
        values=shown[axis.name_part("values")],
        spacing=tuple(shown[axis.name_part(part)] for part in ("start", "stop", "number")),
    )


def read_axis_table(
    axes: Sequence[Axis], by_name: Mapping[str, LaunchField], own: Mapping[str, LaunchField]
) -> tuple[dict[str, Any], tuple[LaunchTrouble, ...]]:
    """Return the lists of values by the paths of their settings, and the problems of others."""
    table, troubles, seen = dict[str, Any](), list[LaunchTrouble](), list[Axis]()
    for axis in axes:
        if axis.is_empty:
            continue
        values, problems = find_axis_values(axis, by_name.get(axis.field))
        troubles += (LaunchTrouble(each.words, own[each.element]) for each in problems)
        if words := describe_clash(axis, seen):
            troubles.append(LaunchTrouble(words, own[axis.name_part("field")]))
        elif not problems:
            table = set_path(table, axis.path, list(values))
        seen.append(axis)
    return table, tuple(troubles)


def describe_clash(axis: Axis, seen: Sequence[Axis]) -> str:
    """Return why a setting cannot vary together with those before it; empty where it can."""
    for other in seen if axis.field else ():
        if other.path == axis.path:
            return f"{axis.field} varies already. Give all of its values in one place."
        inner, outer = sorted((axis, other), key=lambda each: len(each.path), reverse=True)
        if other.field and inner.path[: len(outer.path)] == outer.path:
            return f"{inner.field} is a part of {outer.field}, which varies too. Vary one of them."
    return ""


def list_own_troubles(
    draft: SuiteDraft, table: Mapping[str, Any], own: Mapping[str, LaunchField]
) -> Iterator[LaunchTrouble]:
    """Yield the problems of the suite itself, such as a missing name."""
    if not draft.name:
        yield LaunchTrouble("Is required.", own[NAME])
    if not table and all(axis.is_empty for axis in draft.axes):
        first = own[draft.axes[0].name_part("field")]
        yield LaunchTrouble("Choose at least one setting that varies.", first)


def expand_members(body: Mapping[str, Any]) -> Members:
    """Return the members of a suite, unchecked."""
    tables = {name: table for name, table in body.items() if name != "name"}
    try:
        suite = SuiteFile(**tables)
        refuse_large_suite(suite)
        return Members(fields=dict(expand_suite(suite, NAME)))
    except InputError as error:
        return Members(refused=rename_suite_error(error, NAME))


def check_members(
    store: Store,
    body: Mapping[str, Any],
    members: Members,
    axes: Sequence[Axis],
    fields: Mapping[str, LaunchField],
) -> Members:
    """Return the members with all their problems; without members the base is checked."""
    if members.refused:
        where = f"{members.refused.field}: " if members.refused.field else ""
        words = f"{where}{describe_error(members.refused)}"
        return replace(members, troubles=(LaunchTrouble(words),))
    suite = body["name"] or UNNAMED
    checked = members.fields or {BASE: body["base"]}
    found: dict[tuple[str, str], list[str]] = {}
    for name, given in checked.items():
        for error in find_problems({**given, "name": f"{suite}{SEPARATOR}{name}"}, store):
            field = locate_problem(error, axes, fields)
            key = (field.name if field else "", describe_error(error))
            found.setdefault(key, []).append(name)
    return replace(
        members,
        troubles=tuple(
            LaunchTrouble(f"{name_members(names, len(checked))}{words}", fields.get(element))
            for (element, words), names in found.items()
        ),
        wrong=frozenset(name for names in found.values() for name in names),
    )


def locate_problem(
    error: InputError, axes: Sequence[Axis], fields: Mapping[str, LaunchField]
) -> LaunchField | None:
    """Return the field of a member's problem: of the values that vary, or else of the base."""
    path = find_path(error)
    if path[:1] == ("name",):
        return fields[NAME]
    whole = (*path, error.name) if isinstance(error, UnknownName) else path
    for axis in axes:
        if axis.field and axis.path == whole[: len(axis.path)]:
            return fields[axis.name_part("values")]
    return find_nearest_field(fields, path)


def name_members(names: Sequence[str], members: int) -> str:
    """Return the members that have a problem, before its words; empty where all of them have it."""
    if len(names) == members:
        return ""
    more = len(names) - MOST_NAMED
    others = f" and {count_noun(more, 'other')}" if more > 0 else ""
    return f"{'; '.join(names[:MOST_NAMED])}{others}: "


def list_suite_troubles(
    body: Mapping[str, Any], own: Mapping[str, LaunchField]
) -> Iterator[LaunchTrouble]:
    """Yield why members that are in order make no suite: two of them are the same, for example."""
    try:
        read_suite(convert(dict(body), SuiteRequest))
    except InputError as error:
        yield LaunchTrouble(describe_error(error), own[NAME] if error.field == "name" else None)


def preview_members(draft: SuiteDraft, members: Members) -> Preview | None:
    """Return the grid of the members; None without any."""
    if not members.fields:
        return None
    paths = [axis.path for axis in draft.axes if axis.field] if draft.way == GRID else []
    names = shorten_paths(paths)
    return make_preview(
        tuple(names[path] for path in paths),
        [
            PreviewMember(
                name=name,
                values=tuple(read_path(fields, path) for path in paths),
                episodes=read_episodes(fields),
                is_wrong=name in members.wrong,
            )
            for name, fields in members.fields.items()
        ],
    )


def read_episodes(fields: Mapping[str, Any]) -> int:
    """Return the budget of a member; 0 where it is no number."""
    episodes = fields.get("episodes")
    if isinstance(episodes, int) and not isinstance(episodes, bool):
        return max(0, episodes)
    return 0


def describe_suite(members: Members) -> str:
    """Return that the suite can be launched, and how large it is."""
    episodes = sum(map(read_episodes, members.fields.values()))
    campaigns = count_noun(len(members.fields), "campaign")
    return f"Valid: {campaigns} with {count_noun(episodes, 'episode')} can be launched."


def estimate_suite(store: Store, members: Members) -> str:
    """Return duration and cost of all members after those of earlier campaigns, as a sentence."""
    precedents: dict[tuple[str, ...], Campaign | None] = {}
    seconds, usd, known = 0.0, 0.0, 0
    for fields in members.fields.values():
        try:
            spec = read_fields({**fields, "name": UNNAMED}, CampaignSpec)
        except EigenfailError:
            continue
        kind = (spec.method, *(getattr(spec, name) for name in COMPARED))
        if kind not in precedents:
            precedents[kind] = find_precedent(store, spec)
        if earlier := precedents[kind]:
            share = spec.episodes / earlier.counts.completed
            seconds += earlier.active_s * share
            usd += find_cost(earlier).total_usd * share
            known += 1
    if not members.fields:
        return ""
    if not known:
        return "No estimate: no campaign of these methods, planners and scenarios has ended yet."
    count = len(members.fields)
    which = "" if known == count else f" for {format_count(known)} of {format_count(count)}"
    return (
        f"About {format_duration(seconds)}, one campaign after the other, and {format_usd(usd)} "
        f"USD{which}, if each episode takes and costs what those of the newest campaign of its "
        "method, planner and scenario did."
    )
