"""What was asked for: everything that is needed to run the campaigns again."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import msgspec

from eigenfail import bridges, functions, plugins
from eigenfail.errors import InputError
from eigenfail.settings import defaults_of
from eigenfail.values import Campaign, CampaignSpec
from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material
from eigenfail_services.reports.parts import Part, by_name, table

SETUP, DEFAULTS = "setup", "defaults"
SETUP_COLUMNS = (("campaign", "Campaign"), ("setting", "Setting"), ("value", "Value"))
DEFAULT_COLUMNS = (
    ("kind", "Kind"),
    ("plugin", "Plug-in"),
    ("setting", "Setting"),
    ("default", "Default"),
)
MEANING = (
    "A campaign searches with one method for disturbances under which one planner collides. A "
    "disturbance is added to the position at which the planner sees the nearest vehicle, at every "
    "step: a_t = σ_t · u_t, with |dx| and |dy| the true distances along and across the road. "
    "Settings that are not listed here had their defaults, which stand below."
)
KINDS = {
    "scenario": (plugins.SCENARIOS, "Parameters"),
    "planner": (plugins.PLANNERS, "Settings"),
    "method": (plugins.METHODS, "Settings"),
}


class Setting(NamedTuple):
    """One thing that was asked for."""

    name: str
    value: str


def part(material: Material) -> Part:
    """The settings side by side, and below them the defaults of what was used."""
    found = {subject.id: dict(settings(subject.campaign)) for subject in material.subjects}
    rows = [(id_, name, value) for id_, of in found.items() for name, value in of.items()]
    unset = [*defaults([subject.campaign.spec for subject in material.subjects])]
    section = ReportSection(
        name="setup",
        title="Set-up",
        words=(MEANING,),
        tables=(
            table(SETUP, "What was asked for", SETUP_COLUMNS, rows),
            table(DEFAULTS, "Defaults of this release", DEFAULT_COLUMNS, unset),
        ),
    )
    told = {id_: {name: (value,) for name, value in of.items()} for id_, of in found.items()}
    return Part(section, {SETUP: by_name(material.subjects, told)}, folded=frozenset({DEFAULTS}))


def settings(campaign: Campaign) -> Iterator[Setting]:
    """All that was asked for, and what ended it."""
    spec = campaign.spec
    yield Setting("Scenario", spec.scenario)
    yield from given("Scenario", spec.scenario_parameters)
    yield Setting("Planner", spec.planner)
    yield from given("Planner", spec.planner_settings)
    yield Setting("Simulator", spec.simulator)
    for name, value in functions.disturbance_in_words(spec).items():
        yield Setting(f"Disturbance: {name}", value)
    yield Setting("Method", spec.method)
    yield from given("Method", spec.settings)
    yield Setting("Seed", str(spec.seed))
    yield Setting("Budget [episodes]", str(spec.episodes))
    for name, limit in spec.stop.given().items():
        yield Setting(f"Stops at {name}", str(limit))
    yield Setting("Price [USD per instance-hour]", str(spec.price_usd_per_hour))
    yield Setting("Instances", str(spec.instances))
    yield Setting("Ended because", campaign.stopped_because or f"it is {campaign.state}")


def given(group: str, values: Mapping[str, Any]) -> Iterator[Setting]:
    """The settings of a plug-in that a user gave."""
    for name, value in leaves(values):
        yield Setting(f"{group}: {name}", value)


def defaults(specs: list[CampaignSpec]) -> Iterator[tuple[Cell, ...]]:
    """The defaults of every plug-in that was used, each plug-in once."""
    used = dict.fromkeys(
        (kind, str(getattr(spec, kind)))
        for kind in KINDS
        for spec in specs
        if kind == "method" or spec.simulator != bridges.SIMULATOR
    )
    for kind, plugin in used:
        for name, value in leaves(plugin_defaults(kind, plugin)):
            yield (kind, plugin, name, value)


def plugin_defaults(kind: str, plugin: str) -> dict[str, Any]:
    """What the settings of a plug-in are unless they are given; nothing if it is not here."""
    group, attribute = KINDS[kind]
    try:
        return defaults_of(getattr(plugins.load(group, plugin), attribute))
    except InputError:
        return {}


def leaves(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Every plain value inside nested settings as it would be written; a dot goes deeper."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", written(value)


def written(value: Any) -> str:
    """A setting as it would be written in a file."""
    if value is None:
        return formats.NONE
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()
