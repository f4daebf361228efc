"""Campaigns from TOML files, changes from the command line, and what a check found."""

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from eigenfail import bridges, plugins, processes
from eigenfail.errors import InvalidValue, ServiceError
from eigenfail.files import read_toml
from eigenfail.settings import convert, read_settings
from eigenfail.suites import (
    describes_suite,
    format_value,
    include_disturbance,
    include_samples,
    list_leaves,
    set_path,
)
from eigenfail.values.campaign_spec import CampaignSpec, StopRules
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.variation import read_variation
from eigenfail.wire.http import CampaignCheck
from eigenfail.worlds import world_of

BRIDGE_MODULE = "eigenfail_workers.bridge"
BRIDGE_TIMEOUT_S = 900.0
OFFER_TIMEOUT_S = 60.0

LIKE = "Specify a TOML file with the fields of a campaign; see examples/."

PLUGIN_FIELDS = {
    "method": (plugins.METHODS, "settings", "Settings"),
    "scenario": (plugins.SCENARIOS, "scenario_parameters", "Parameters"),
    "planner": (plugins.PLANNERS, "planner_settings", "Settings"),
    "simulator": (plugins.SIMULATORS, None, None),
}
READERS: dict[str, Callable[..., Any]] = {"Settings": read_settings, "Parameters": read_variation}
TABLES: dict[str, type[msgspec.Struct]] = {"disturbance": DisturbanceModel, "stop": StopRules}
Value = TypeVar("Value")
NONE_GIVEN: Mapping[str, float | None] = {}


def read_spec(
    file: Path,
    stop: Mapping[str, float | None] = NONE_GIVEN,
    changes: Sequence[str] | None = None,
    **instead: int | str | None,
) -> CampaignSpec:
    """The campaign that a file describes; its name is the file's unless it has one.

    Args:
        file: TOML with the fields of a CampaignSpec.
        changes: fields that take the place of the file's, as `parse_changes` takes them.
        stop: stop rules that take the place of the file's of the same name, where not None.
        instead: values that take the place of the file's, where not None.

    Raises:
        UnknownName: a field that campaigns do not have.
        InvalidValue: not a readable TOML file, a suite, or a value outside its bounds.
    """
    table = read_toml(file, LIKE)
    if describes_suite(table):
        remedy = f"Run it with `eigenfail suite run {file}`."
        raise InvalidValue(file.name, "this is a suite, not a campaign.", remedy)
    # Files that a campaign file names lie beside it, wherever the command is called.
    written = include_samples(include_disturbance(table, file), file)
    changed = parse_changes(changes or (), {"name": file.stem, **written})
    fields = {**changed, **_drop_missing(instead)}
    if _drop_missing(stop):
        rules = fields.get("stop", {})
        if not isinstance(rules, dict):
            raise InvalidValue(f"{file.name}: stop", "is not a table.", "Write it as [stop].")
        fields["stop"] = {**rules, **_drop_missing(stop)}
    # The message names the table of the file; that of the whole specification would not.
    for name, kind in TABLES.items():
        if isinstance(fields.get(name), dict):
            convert(fields[name], kind, f"{file.name}: {name}")
    return read_settings(CampaignSpec, fields, file.name)


def _drop_missing(values: Mapping[str, Value | None]) -> dict[str, Value]:
    """Those of the values that there are."""
    return {name: value for name, value in values.items() if value is not None}


def check_plugins(spec: CampaignSpec) -> None:
    """Check a campaign against the plug-ins of this machine, for a service started here.

    Raises:
        UnknownName: a plug-in, setting or parameter that is not there.
        InvalidValue: a setting outside its bounds, or a function that may not be run here.
    """
    fields, world = PLUGIN_FIELDS, world_of(spec.simulator)
    if not world.plugin_fields:
        world.check(spec)
        world.require_code(spec)
        fields = {"method": PLUGIN_FIELDS["method"]}
    for field, (group, settings_field, kind) in fields.items():
        plugin = plugins.load(group, getattr(spec, field))
        if settings_field and kind:
            READERS[kind](getattr(plugin, kind), getattr(spec, settings_field), settings_field)


def check_local_bridge(specs: Collection[CampaignSpec]) -> None:
    """Check campaigns against the bridge of this environment, for a service started here.

    A bridge that does not answer now may start later; its workers check the campaigns then.

    Raises:
        UnknownName: a name that the bridge does not know; the known ones are listed.
        InvalidValue: the address is not valid, or the scenario of the bridge has fewer steps, or
            steps of another duration.
    """
    address = os.environ.get(bridges.ADDRESS_VARIABLE)
    on_bridge = [spec for spec in specs if world_of(spec.simulator).needs_bridge]
    if not (address and on_bridge):
        return
    offer: bridges.BridgeOffer | None = None
    question = bridges.OfferQuestion(bridges.check_address(address))
    with suppress(ServiceError):
        answer = ask_about_bridges(question, OFFER_TIMEOUT_S)
        offer = msgspec.json.decode(answer, type=bridges.BridgeOffer | None)
    # Its workers ask it when a campaign starts, and check the campaign then.
    if offer is None:
        return
    for spec in on_bridge:
        world = world_of(spec.simulator)
        world.check_offer(replace(spec, disturbance=world.resolve_disturbance(spec)), offer)


def ask_about_bridges(
    question: bridges.BridgeQuestion, timeout_s: float = BRIDGE_TIMEOUT_S
) -> bytes:
    """Return the answer of a separate process with the libraries for bridges, as JSON.

    Raises:
        EigenfailError: that which it raised.
        ServiceError: it took longer than its time, or ended without an answer.
    """
    return processes.ask(BRIDGE_MODULE, msgspec.json.encode(question), timeout_s)


def parse_changes(
    given: Sequence[str], before: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """Return the fields of a campaign with those in texts like settings.alpha=100 put over them.

    Args:
        given: fields and values; a value that is no JSON is text.
        before: the fields before.

    Raises:
        InvalidValue: one is not of that form.
    """
    fields = dict(before)
    for each in given:
        path, equals, text = each.partition("=")
        if not (equals and all(path.split("."))):
            problem = f"'{each}' is not of the form FIELD=VALUE."
            raise InvalidValue("--set", problem, "Write it as settings.alpha=100.")
        value: Any = text
        with suppress(msgspec.DecodeError):  # text, unless it is a number, list or table
            value = msgspec.json.decode(text)
        fields = set_path(fields, tuple(path.split(".")), value)
    return fields


def describe_check(found: CampaignCheck) -> str:
    """The findings of a check, in words."""
    if found.spec is None:
        return "\n".join(f"{each.detail} {each.remedy}".strip() for each in found.problems)
    fields = msgspec.to_builtins(found.spec)
    if not world_of(found.spec.simulator).has_road:
        # A model without slopes and bases: they have their defaults and mean nothing there.
        model = fields["disturbance"]
        fields["disturbance"] = {name: model[name] for name in ("scale", "shape")}
    plain = list_leaves(fields)
    lines = (f"  {'.'.join(path)} = {format_value(value)}" for path, value in plain)
    return "\n".join(("It can be launched, as:", *lines, *found.notes))
