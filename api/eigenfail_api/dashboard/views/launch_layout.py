"""The parts of the launch form: which fields there are under the plug-ins that are chosen."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail import bridges, functions, plugins
from eigenfail.values import CampaignSpec
from eigenfail.wire.http import PluginInfo
from eigenfail_api.dashboard.views.launch_entries import Texts
from eigenfail_api.dashboard.views.launch_fields import Field, Group, field_of, group_of
from eigenfail_api.routes.plugins import described, parameters_of, settings_of

SPEC = msgspec.json.schema(CampaignSpec)
PROPERTIES: Mapping[str, Any] = SPEC["$defs"]["CampaignSpec"]["properties"]
FIRST_METHOD = "monte_carlo"

HELP = {
    "name": "What it is called in lists.",
    "seed": "Equal campaigns with equal seeds have equal episodes.",
    "episodes": "The budget: every simulated episode counts.",
    "method": "How disturbances are chosen.",
    "scenario": "The road, the actors and the goal.",
    "planner": "The system under test.",
    "simulator": "What moves the vehicles.",
    "price_usd_per_hour": "Of one instance.",
    "instances": "How many instances it occupies while it runs.",
    "scene_every": "Besides all collisions, the scene of every n-th episode is kept.",
    "priority": "Its share of the workers beside other campaigns, and its place in the queue.",
    "scenario_parameters": 'As JSON: {"steps": 100}, "dt_s" if it is not 0.1, and its own.',
    "planner_settings": "As JSON: those of the planner, as eigenfail doctor --bridge lists them.",
}
BRIDGE_NAME = "A name that the bridge of the workers knows: eigenfail doctor --bridge lists them."
FUNCTION_PLANNER = "A function as module:function; workers look for it where they are started."
SHAPES: Mapping[str, str] = SPEC["$defs"]["DisturbanceModel"]["properties"]["shape"][
    "discriminator"
]["mapping"]
SHAPE = "disturbance.shape"


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A section of the form.

    Attributes:
        id: of its element.
        fields: of the spec itself; a choice among them swaps what is below.
        summary: of the plug-in that is chosen, in a line.
        problem: why that plug-in cannot be used here; empty if it can.
        settings: of that plug-in; None where it has none.
    """

    id: str
    title: str
    fields: tuple[Field, ...]
    summary: str = ""
    problem: str = ""
    settings: Group | None = None


def layout(texts: Texts) -> tuple[Part, ...]:
    """All parts, for what is chosen so far."""
    return (
        Part(id="campaign", title="Campaign", fields=own("name", "episodes", "seed")),
        plugin_part("method", plugins.METHODS, settings_of, chosen(texts, "method", FIRST_METHOD)),
        *world(texts),
        Part(id="disturbance", title="Disturbance model", fields=(), settings=disturbance(texts)),
        Part(
            id="stop", title="Stop rules", fields=(), settings=group("StopRules", "stop", "Rules")
        ),
        Part(
            id="records",
            title="Priority, price and records",
            fields=own("priority", "price_usd_per_hour", "instances", "scene_every"),
        ),
    )


def world(texts: Texts) -> tuple[Part, ...]:
    """Scenario and planner; a function under test is both in one."""
    simulator = chosen(texts, "simulator", PROPERTIES["simulator"]["default"])
    known = tuple(dict.fromkeys((*functions.simulators(), simulator)))
    swapping = choice("simulator", known, simulator)
    if simulator == functions.SIMULATOR:
        return function_parts(swapping)
    if simulator == bridges.SIMULATOR:
        return bridge_parts(swapping)
    scenario, planner = (chosen(texts, name, PROPERTIES[name]["default"]) for name in WORLD)
    part = plugin_part("scenario", plugins.SCENARIOS, parameters_of, scenario)
    return (
        replace(part, fields=(swapping, *part.fields)),
        plugin_part("planner", plugins.PLANNERS, settings_of, planner),
    )


WORLD = ("scenario", "planner")


def function_parts(swapping: Field) -> tuple[Part, ...]:
    """What a function of a noise trajectory is asked with."""
    schema = msgspec.json.schema(functions.FunctionParameters)
    parameters = group_of(schema, "scenario_parameters", "Parameters")
    only = choice("scenario", (functions.SCENARIO,), functions.SCENARIO)
    planner = replace(own("planner")[0], default="", help=FUNCTION_PLANNER, required=True)
    return (
        Part(id="scenario", title="Scenario", fields=(swapping, only), settings=parameters),
        Part(id="planner", title="Planner", fields=(planner,)),
    )


def bridge_parts(swapping: Field) -> tuple[Part, ...]:
    """What a bridge is asked with; what parameters and settings it has, it alone knows."""
    scenario, planner = (
        replace(own(name)[0], default="", help=BRIDGE_NAME, required=True) for name in WORLD
    )
    return (
        Part(
            id="scenario",
            title="Scenario",
            fields=(swapping, scenario, *own("scenario_parameters")),
        ),
        Part(id="planner", title="Planner", fields=(planner, *own("planner_settings"))),
    )


def plugin_part(name: str, entry_points: str, kind: Callable[[Any], Any], wanted: str) -> Part:
    """The choice of a plug-in, and the settings of the one that is chosen."""
    known = plugins.names(entry_points)
    found = described(entry_points, wanted, kind) if wanted in known else PluginInfo(wanted)
    field = "scenario_parameters" if name == "scenario" else SETTINGS[name]
    title = "Parameters" if name == "scenario" else "Settings"
    return Part(
        id=name,
        title=name.capitalize(),
        # A name that is not known stays in the list, for its problem to be told.
        fields=(choice(name, tuple(dict.fromkeys((*known, wanted))), wanted),),
        summary=found.summary,
        problem=found.problem,
        settings=group_of(found.settings, field, title, varied=name == "scenario")
        if found.settings
        else None,
    )


SETTINGS = {"method": "settings", "planner": "planner_settings"}


def chosen(texts: Texts, name: str, default: str) -> str:
    """The plug-in that is chosen."""
    return texts.typed.get(name, "") or texts.base.get(name, "") or default


def choice(name: str, options: tuple[str, ...], wanted: str) -> Field:
    """A field of the spec with a list to choose from."""
    return replace(own(name)[0], kind="choice", options=options, default=wanted)


def own(*names: str) -> tuple[Field, ...]:
    """Fields of the spec itself."""
    required = SPEC["$defs"]["CampaignSpec"]["required"]
    return tuple(
        field_of(
            name,
            {"description": HELP[name], **PROPERTIES[name]},
            SPEC,
            required=name in required,
        )
        for name in names
    )


def group(kind: str, name: str, title: str) -> Group:
    """The fields of a struct inside the spec."""
    return group_of({"$ref": f"#/$defs/{kind}", "$defs": SPEC["$defs"]}, name, title)


def disturbance(texts: Texts) -> Group:
    """The disturbance model, with the settings of the shape that is chosen."""
    kind = f"{SHAPE}.kind"
    base = texts.base.get("disturbance", {}).get("shape", {})
    wanted = texts.typed.get(kind, "") or base.get("kind", "") or next(iter(SHAPES))
    whole = group("DisturbanceModel", "disturbance", "Settings")
    shape = group(SHAPES.get(wanted, SHAPES["white"]).rpartition("/")[2], SHAPE, "")
    names = tuple(dict.fromkeys((*SHAPES, wanted)))
    help_text = next((each.help for each in whole.fields if each.name == SHAPE), "")
    select = Field(name=kind, label="shape", kind="choice", options=names, help=help_text)
    plain = tuple(each for each in whole.fields if each.name != SHAPE)
    rest = tuple(each for each in shape.fields if each.name != kind)
    about = f"{whole.about}\n\n{shape.about}"
    return replace(whole, about=about, fields=(*plain, select, *rest))
