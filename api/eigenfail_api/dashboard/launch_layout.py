"""The order of the fields of the launch form, with their labels and help."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail import bridges, functions, plugins
from eigenfail.suites import read_path
from eigenfail.values.campaign_spec import SPEC_FIELDS, CampaignSpec, Section
from eigenfail.wire.http import PluginInfo
from eigenfail.worlds import list_simulators
from eigenfail_api.dashboard import launch_fields
from eigenfail_api.routes.plugins import describe_plugin, parameters_of, settings_of

SPEC = msgspec.json.schema(CampaignSpec)


PROPERTIES: Mapping[str, Any] = SPEC["$defs"]["CampaignSpec"]["properties"]


FIRST_METHOD = "monte_carlo"


BRIDGE_NAME = "A name that the workers’ bridge knows; eigenfail doctor --bridge lists them."


FUNCTION_PLANNER = "A function as module:function, found from the directory that workers start in."


SHAPES: Mapping[str, str] = SPEC["$defs"]["DisturbanceModel"]["properties"]["shape"][
    "discriminator"
]["mapping"]


SHAPE = "disturbance.shape"


class LaunchPart(msgspec.Struct, frozen=True):
    """A section of the form.

    Attributes:
        id: id of its element.
        fields: fields of the spec itself; a choice among them replaces the sections below.
        summary: summary of the plug-in that is chosen, in a line.
        problem: why that plug-in cannot be used here; empty if it can.
        settings: settings of that plug-in; None if it has none.
    """

    id: str
    title: str
    fields: tuple[launch_fields.LaunchField, ...] = ()
    summary: str = ""
    problem: str = ""
    settings: launch_fields.LaunchGroup | None = None


def make_layout(texts: launch_fields.Texts) -> tuple[LaunchPart, ...]:
    """Return all parts of the form for the present choices."""
    method = choose_plugin(texts, "method", FIRST_METHOD)
    disturbance, rules = make_disturbance_group(texts), group("StopRules", "stop", "Rules")
    return (
        make_section_part("campaign", Section.CAMPAIGN),
        make_plugin_part("method", plugins.METHODS, settings_of, method),
        *make_world_parts(texts),
        LaunchPart("disturbance", "Disturbance model", settings=disturbance),
        LaunchPart("stop", "Stop rules", settings=rules),
        make_section_part("records", Section.RECORDS),
    )


def make_section_part(name: str, section: Section) -> LaunchPart:
    """Return the part for the fields of a section of the spec."""
    names = (each for each, field in SPEC_FIELDS.items() if field.section is section)
    return LaunchPart(name, section, make_own_fields(*names))


def make_world_parts(texts: launch_fields.Texts) -> tuple[LaunchPart, ...]:
    """Return the parts for scenario and planner; a function under test is both in one."""
    simulator = choose_plugin(texts, "simulator", PROPERTIES["simulator"]["default"])
    # A simulator that is not installed here stays selected, with its problem.
    known = tuple(dict.fromkeys((*list_simulators(), simulator)))
    swapping = make_choice_field("simulator", known, simulator)
    # What is driven there is no plug-in: there is no list of names and no schema.
    if make_parts := PARTS_WITHOUT_PLUGINS.get(simulator):
        return make_parts(swapping)
    scenario, planner = (choose_plugin(texts, name, PROPERTIES[name]["default"]) for name in WORLD)
    part = make_plugin_part("scenario", plugins.SCENARIOS, parameters_of, scenario)
    return (
        replace(part, fields=(swapping, *part.fields)),
        make_plugin_part("planner", plugins.PLANNERS, settings_of, planner),
    )


WORLD = ("scenario", "planner")


def make_function_parts(swapping: launch_fields.LaunchField) -> tuple[LaunchPart, ...]:
    """Return the part for a function of a noise trajectory."""
    schema = msgspec.json.schema(functions.FunctionParameters)
    parameters = launch_fields.group_of(schema, "scenario_parameters", "Parameters")
    only = make_choice_field("scenario", (functions.SCENARIO,), functions.SCENARIO)
    planner = make_name_field("planner", FUNCTION_PLANNER)
    return (
        LaunchPart("scenario", "Scenario", (swapping, only), settings=parameters),
        LaunchPart("planner", "Planner", (planner,)),
    )


def make_bridge_parts(swapping: launch_fields.LaunchField) -> tuple[LaunchPart, ...]:
    """Return the part for a bridge, whose parameters and settings are known only to itself."""
    scenario, planner = (make_name_field(name, BRIDGE_NAME) for name in WORLD)
    # Both are tables: without a schema there is nothing to make single fields of.
    parameters, settings = make_own_fields("scenario_parameters", "planner_settings")
    return (
        LaunchPart("scenario", "Scenario", (swapping, scenario, parameters)),
        LaunchPart("planner", "Planner", (planner, settings)),
    )


def make_name_field(name: str, help_text: str) -> launch_fields.LaunchField:
    """Return a required field of the spec for a name without a list or a default."""
    return replace(make_own_fields(name)[0], default="", help=help_text, required=True)


PARTS_WITHOUT_PLUGINS: Mapping[
    str, Callable[[launch_fields.LaunchField], tuple[LaunchPart, ...]]
] = {
    functions.SIMULATOR: make_function_parts,
    bridges.SIMULATOR: make_bridge_parts,
}


def make_plugin_part(
    name: str, entry_points: str, kind: Callable[[Any], Any], wanted: str
) -> LaunchPart:
    """Return the choice of a plug-in with the settings of the chosen one."""
    known = plugins.names(entry_points)
    found = describe_plugin(entry_points, wanted, kind) if wanted in known else PluginInfo(wanted)
    path, title = SETTINGS[name]
    settings = None
    if found.settings:
        # Only what a scenario is built from may be drawn anew for each episode.
        settings = launch_fields.group_of(found.settings, path, title, varied=name == "scenario")
    # An unknown name stays in the list, so that its problem can be shown.
    choice = make_choice_field(name, tuple(dict.fromkeys((*known, wanted))), wanted)
    return LaunchPart(name, name.capitalize(), (choice,), found.summary, found.problem, settings)


SETTINGS = {
    "method": ("settings", "Settings"),
    "scenario": ("scenario_parameters", "Parameters"),
    "planner": ("planner_settings", "Settings"),
}
"""Path and title of the settings of each kind of plug-in."""


def choose_plugin(texts: launch_fields.Texts, name: str, default: str) -> str:
    """Return the chosen plug-in; a file may hold anything in its place."""
    given = texts.base.get(name, "")
    return texts.typed.get(name, "") or (given if isinstance(given, str) else "") or default


def make_choice_field(
    name: str, options: tuple[str, ...], wanted: str
) -> launch_fields.LaunchField:
    """Return a field of the spec with a list of options."""
    return replace(make_own_fields(name)[0], kind="choice", options=options, default=wanted)


def make_own_fields(*names: str) -> tuple[launch_fields.LaunchField, ...]:
    """Return the fields of the spec itself."""
    required = SPEC["$defs"]["CampaignSpec"]["required"]
    return tuple(
        launch_fields.make_field(
            name,
            {"description": SPEC_FIELDS[name].help, **PROPERTIES[name]},
            SPEC,
            required=name in required,
        )
        for name in names
    )


def group(kind: str, name: str, title: str) -> launch_fields.LaunchGroup:
    """Return the form fields of a struct inside the spec."""
    return launch_fields.group_of({"$ref": f"#/$defs/{kind}", "$defs": SPEC["$defs"]}, name, title)


def make_disturbance_group(texts: launch_fields.Texts) -> launch_fields.LaunchGroup:
    """Return the disturbance model with the settings of the chosen shape."""
    # The shape is a union: its own fields depend on the kind that is chosen.
    kind = f"{SHAPE}.kind"
    base = read_path(dict(texts.base), ("disturbance", "shape", "kind"))
    given = base if isinstance(base, str) else ""
    wanted = texts.typed.get(kind, "") or given or next(iter(SHAPES))
    whole = group("DisturbanceModel", "disturbance", "Settings")
    shape = group(SHAPES.get(wanted, SHAPES["white"]).rpartition("/")[2], SHAPE, "")
    names = tuple(dict.fromkeys((*SHAPES, wanted)))
    help_text = next((each.help for each in whole.fields if each.name == SHAPE), "")
    select = launch_fields.LaunchField(
        name=kind, label="shape", kind="choice", options=names, help=help_text
    )
    plain = tuple(each for each in whole.fields if each.name != SHAPE)
    rest = tuple(each for each in shape.fields if each.name != kind)
    about = f"{whole.about}\n\n{shape.about}"
    return replace(whole, about=about, fields=(*plain, select, *rest))
