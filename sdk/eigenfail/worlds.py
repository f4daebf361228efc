"""The worlds of campaigns: roads made of plug-ins, functions, and bridges.

A campaign names its world by `simulator`. All differences between worlds are handled here, so that
no other module compares names of simulators.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple

import msgspec
from msgspec.structs import replace

from eigenfail import bridges, functions, plugins
from eigenfail.contracts import ReactiveSituation, Scenario, Situation
from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.settings import defaults_of, read_settings
from eigenfail.values import requirements, signals
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import (
    ALL_CHANNELS,
    CHANNELS_FIELD,
    EVERY,
    SCENARIO,
    VEHICLE,
    split_name,
)
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import EpisodeSetup
from eigenfail.values.variation import Variation, read_variation

Described = CampaignSpec | EpisodeSetup
"""What names a simulator, a scenario and a disturbance model."""


class PluginField(NamedTuple):
    """A field of a campaign that names a plug-in, and the place of its settings.

    Attributes:
        group: group of entry points.
        settings: field of the campaign with the plug-in's settings.
        type_name: attribute of the plug-in with the type of its settings.
    """

    group: str
    settings: str
    type_name: str


class CampaignWorld(ABC):
    """The behaviour of campaigns that differs between worlds.

    Attributes:
        plugin_fields: fields of a campaign that name plug-ins with settings, by name.
        has_road: whether vehicles drive, so that there are steps with a duration, and conflicts.
        robustness_unit: unit of the robustness; empty if it has none.
        needs_bridge: whether only workers with a bridge can run its episodes.
        unexplained: reason why no planner can explain an episode; empty if one can.
        channels_remedy: remedy if the disturbance model names channels that the world lacks.
        tells_lane: whether the signals that need the lane of the ego are available.
    """

    plugin_fields: ClassVar[Mapping[str, PluginField]] = {}
    has_road: ClassVar[bool] = True
    robustness_unit: ClassVar[str] = "m"
    needs_bridge: ClassVar[bool] = False
    unexplained: ClassVar[str] = ""
    channels_remedy: ClassVar[str] = ""
    tells_lane: ClassVar[bool] = False

    @abstractmethod
    def check(self, spec: CampaignSpec) -> None:
        """Refuse a campaign that cannot be launched here, for reasons other than its horizon.

        Raises:
            UnknownName: a plug-in, setting or parameter that does not exist.
            InvalidValue: a value outside its bounds, or a function that may not be run here.
        """

    @abstractmethod
    def variation(self, spec: CampaignSpec) -> Variation:
        """Return the scenario parameters of a campaign, each fixed or drawn for each episode.

        Raises:
            UnknownName: unknown scenario, parameter or distribution.
            InvalidValue: a parameter, or an end of its distribution, is outside its bounds.
        """

    @abstractmethod
    def find_form(self, spec: CampaignSpec) -> EpisodeForm:
        """Return length and channels of a full episode, the longest one if parameters vary.

        Raises:
            UnknownName: unknown scenario, parameter or distribution.
            InvalidValue: a parameter, or an end of its distribution, is outside its bounds.
        """

    def resolve(self, spec: CampaignSpec) -> tuple[CampaignSpec, EpisodeForm]:
        """Return a campaign with its channels and requirements written out, and its form.

        Raises:
            UnknownName: a channel, signal, measure, scenario or parameter does not exist.
            InvalidValue: one of their values is invalid, or cannot be judged here.
        """
        spec = replace(spec, disturbance=self.resolve_disturbance(spec))
        form = self.find_form(spec)
        return replace(spec, requirements=self.resolve_requirements(spec, form)), form

    def channels(self, spec: CampaignSpec) -> tuple[str, ...]:
        """Return the names of the channels of the noise, in the order of the columns of z.

        Raises:
            UnknownName: no such parameter.
            InvalidValue: a parameter outside its bounds.
        """
        return tuple(channel.name for channel in spec.disturbance.list_channels())

    def resolve_disturbance(self, described: Described) -> DisturbanceModel:
        """Return the disturbance model with its channels written out, one by one.

        Raises:
            UnknownName: the world does not have a channel.
            InvalidValue: the model is invalid, or names channels in a world without a choice.
        """
        model = described.disturbance
        if model.channels is not msgspec.UNSET:
            problem = f"the simulator '{described.simulator}' has no channels to choose from."
            raise InvalidValue(CHANNELS_FIELD, problem, self.channels_remedy)
        return self._resolve_options(described, offered=False)

    def _resolve_options(self, described: Described, *, offered: bool) -> DisturbanceModel:
        """Return the disturbance model, without an occlusion that is off.

        Raises:
            UnknownName: a correlation names a channel that is not one of a scenario parameter.
            InvalidValue: occlusion is on, but the simulator does not offer it, or the correlations
                are impossible.
        """
        model = described.disturbance
        if not model.is_occluding:
            model = replace(model, occlusion=msgspec.UNSET)
        elif not offered:
            problem = f"the simulator '{described.simulator}' does not know what vehicles hide."
            remedy = "Leave it out, or take the simulator highway or point_mass."
            raise InvalidValue("disturbance.occlusion", problem, remedy)
        model.check_correlations()
        return model

    def resolve_requirements(
        self, spec: CampaignSpec, form: EpisodeForm
    ) -> requirements.Requirements | msgspec.UnsetType:
        """Return the requirements of a campaign; UNSET if "no collision" is the only one.

        If the campaign sets an importance, they are always written out.

        Args:
            spec: the campaign, with its channels written out.
            form: length and channels of its episodes.

        Raises:
            UnknownName: a signal or measure does not exist.
            InvalidValue: a requirement is not complete, or cannot be judged here.
        """
        named = spec.all_requirements
        if spec.requirements is msgspec.UNSET and spec.importance is msgspec.UNSET:
            return msgspec.UNSET
        if form.step_s is None or form.horizon_s is None:
            problem = f"the simulator '{spec.simulator}' has no drive to judge."
            raise InvalidValue(
                requirements.FIELD, problem, "Have the function return what is to stay above 0."
            )
        told = signals.list_signals(form.channels, tells_lane=self.tells_lane)
        told = *told, *self.list_own_signals(spec)
        expected = signals.ExpectedCourse(told, form.step_s, form.horizon_s)
        requirements.check_requirements(named, expected)
        if not isinstance(spec.importance, msgspec.UnsetType):
            spec.importance.check(expected, "importance")
            return named
        return msgspec.UNSET if named == requirements.COLLISION_ALONE else named

    def list_own_signals(self, _spec: CampaignSpec) -> tuple[str, ...]:
        """Return the names of the simulator's or planner's own signals that a campaign may name."""
        return ()

    def list_left_out(self, _spec: CampaignSpec) -> tuple[str, ...]:
        """Return what the scenario leaves out of its recording, in sentences."""
        return ()

    def check_offer(  # noqa: B027 - only bridges offer anything
        self, spec: CampaignSpec, offer: bridges.BridgeOffer
    ) -> None:
        """Refuse a campaign that needs what a bridge does not offer.

        Args:
            spec: the campaign, with its channels written out.
            offer: what the bridge offers.

        Raises:
            UnknownName: the bridge does not offer a name; the offered names are listed.
            InvalidValue: the scenario has fewer steps, or steps of another duration.
        """

    def parameters_type(self, _spec: CampaignSpec) -> type[msgspec.Struct] | None:
        """Return the type of the parameters of the campaign's scenario, if it is a plug-in.

        Raises:
            UnknownName: no such scenario.
        """
        return None

    def default_parameters(self, spec: CampaignSpec) -> dict[str, Any]:
        """Return the default parameters of the campaign's scenario plug-in."""
        kind = self.parameters_type(spec)
        return {} if kind is None else defaults_of(kind)

    def fill_planner(self, spec: CampaignSpec) -> CampaignSpec:
        """Return the campaign with the defaults of its planner written out."""
        return spec

    def fill_scenario(self, spec: CampaignSpec) -> CampaignSpec:
        """Return the campaign with the defaults of its scenario written out."""
        return spec

    def refuse_unlisted(self, _planner: str, _remedy: str = "") -> None:  # noqa: B027 - most have no list
        """Refuse code that this process may not import; see `functions.refuse_unlisted`.

        Raises:
            InvalidValue: the code is not on the list of permitted imports.
        """

    def require_code(self, _spec: CampaignSpec) -> None:  # noqa: B027 - only functions are looked for
        """Refuse a campaign whose code cannot be found on this machine.

        Raises:
            InvalidValue: the module does not exist, or does not define the function.
        """

    def packages(self, _spec: CampaignSpec) -> Iterator[str]:
        """Return the top packages of the code that an episode runs.

        Raises:
            UnknownName: a plug-in is not installed here.
            InvalidValue: the module does not exist.
        """
        return iter(())

    @abstractmethod
    def runs_foreign_code(self, setup: EpisodeSetup) -> bool:
        """Return whether a worker's process runs code from outside eigenfail."""


class PluginWorld(CampaignWorld):
    """A road: simulator, scenario and planner are plug-ins."""

    tells_lane = True
    plugin_fields: ClassVar[Mapping[str, PluginField]] = {
        "scenario": PluginField(plugins.SCENARIOS, "scenario_parameters", "Parameters"),
        "planner": PluginField(plugins.PLANNERS, "planner_settings", "Settings"),
    }

    def check(self, spec: CampaignSpec) -> None:
        """Check the simulator's name, and read the settings of the planner."""
        if spec.simulator not in plugins.names(plugins.SIMULATORS):
            raise UnknownName("simulator", spec.simulator, list_simulators())
        self._read_planner(spec)

    def resolve_disturbance(self, described: Described) -> DisturbanceModel:
        """Write out the channels that simulator and scenario have."""
        simulator = plugins.load(plugins.SIMULATORS, described.simulator)
        offers_occlusion = getattr(simulator, "occludes", False)
        model = self._resolve_options(described, offered=offers_occlusion)
        if model.channels is msgspec.UNSET:
            return model
        plugin = plugins.load(plugins.SCENARIOS, described.scenario)
        variation = read_variation(plugin.Parameters, described.scenario_parameters)
        scenario: Scenario = plugin()
        counts = {_count_vehicles(scenario(each, 0)) for each in variation.corners()}
        if len(counts) > 1:
            problem = "the number of vehicles varies with the parameters of the scenario."
            raise InvalidValue(CHANNELS_FIELD, problem, "Fix the parameter that it depends on.")
        offered: frozenset[str] | None = getattr(simulator, "channels", None)
        if offered is None:
            problem = f"the simulator '{described.simulator}' does not say which it offers."
            raise InvalidValue(CHANNELS_FIELD, problem, "Leave them out, or give it `channels`.")
        return model.resolve(counts.pop(), offered, tuple(variation.varied))

    def list_own_signals(self, spec: CampaignSpec) -> tuple[str, ...]:
        """Return the names of the signals that the planner reports."""
        planner = plugins.load(plugins.PLANNERS, spec.planner)
        return tuple(f"{signals.PLANNER}.{name}" for name in signals.read_signal_names(planner))

    def list_left_out(self, spec: CampaignSpec) -> tuple[str, ...]:
        """Return sentences on vehicles that the scenario leaves out, then on other unused data.

        Empty if the scenario is not installed here.
        """
        try:
            scenario: object = self._scenario(spec)
        except InputError:
            return ()
        return (*getattr(scenario, "left_out", ()), *getattr(scenario, "notes", ()))

    def variation(self, spec: CampaignSpec) -> Variation:
        """Return the parameters, bounded by the scenario's annotations."""
        return read_variation(
            self.parameters_type(spec),
            spec.scenario_parameters,
            searched=spec.disturbance.searched_parameters,
            correlations=spec.disturbance.parameter_correlations,
        )

    def find_form(self, spec: CampaignSpec) -> EpisodeForm:
        """Return the most steps at any corner of the parameters, and the duration of a step.

        Raises:
            InvalidValue: steps differ in duration.
        """
        scenario, corners = self._scenario(spec), self.variation(spec).corners()
        situations = [scenario(corner, spec.seed) for corner in corners]
        step_s = _find_step(each.mission.dt_s for each in situations)
        return EpisodeForm(max(each.steps for each in situations), step_s, self.channels(spec))

    def parameters_type(self, spec: CampaignSpec) -> type[msgspec.Struct]:
        """Return the scenario's `Parameters`."""
        kind: type[msgspec.Struct] = plugins.load(plugins.SCENARIOS, spec.scenario).Parameters
        return kind

    def fill_planner(self, spec: CampaignSpec) -> CampaignSpec:
        """Write out all settings of the planner."""
        return replace(spec, planner_settings=msgspec.to_builtins(self._read_planner(spec)))

    def fill_scenario(self, spec: CampaignSpec) -> CampaignSpec:
        """Write out all parameters; an integer becomes a float if the default is a float."""
        defaults = self.default_parameters(spec)
        given = spec.scenario_parameters.items()
        typed = {name: _match_type(value, defaults.get(name)) for name, value in given}
        return replace(spec, scenario_parameters={**defaults, **typed})

    def packages(self, spec: CampaignSpec) -> Iterator[str]:
        """Return the packages of planner, scenario and simulator."""
        for group, name in self._list_parts(spec):
            if name not in plugins.list_entry_points(group):
                raise UnknownName(group.removeprefix("eigenfail."), name, plugins.names(group))
            yield plugins.list_entry_points(group)[name].module.partition(".")[0]

    def runs_foreign_code(self, setup: EpisodeSetup) -> bool:
        """Return whether any of the three plug-ins is not built in."""
        return not all(plugins.is_built_in(*part) for part in self._list_parts(setup))

    def _list_parts(self, described: Described) -> tuple[tuple[str, str], ...]:
        """Return group and name of each plug-in that an episode uses."""
        return (
            (plugins.PLANNERS, described.planner),
            (plugins.SCENARIOS, described.scenario),
            (plugins.SIMULATORS, described.simulator),
        )

    def _scenario(self, spec: CampaignSpec) -> Scenario:
        scenario: Scenario = plugins.load(plugins.SCENARIOS, spec.scenario)()
        return scenario

    def _read_planner(self, spec: CampaignSpec) -> msgspec.Struct:
        kind: type[msgspec.Struct] = plugins.load(plugins.PLANNERS, spec.planner).Settings
        return read_settings(kind, spec.planner_settings, "planner_settings")


class FunctionWorld(CampaignWorld):
    """A Python function of the noise; see `eigenfail.functions`."""

    has_road = False
    robustness_unit = ""
    unexplained = "a function has no planner and no controls to explain."
    channels_remedy = "Name those of a function as `channels` in scenario_parameters."

    def check(self, spec: CampaignSpec) -> None:
        """Read the parameters, and check the function against the list and its module's source."""
        functions.check(spec)
        functions.refuse_unlisted(spec.planner)
        functions.refuse_undefined(spec.planner)

    def variation(self, spec: CampaignSpec) -> Variation:
        """Return the parameters, all of them fixed."""
        return read_variation(functions.FunctionParameters, spec.scenario_parameters)

    def find_form(self, spec: CampaignSpec) -> EpisodeForm:
        """Return the steps and channels that the campaign sets; steps are without a duration."""
        parameters = functions.check(spec)
        return EpisodeForm(parameters.steps, None, parameters.channels)

    def channels(self, spec: CampaignSpec) -> tuple[str, ...]:
        """Return the channels that the campaign names."""
        return functions.check(spec).channels

    def fill_scenario(self, spec: CampaignSpec) -> CampaignSpec:
        """Write out all parameters."""
        parameters = msgspec.to_builtins(functions.check(spec))
        parameters["channels"] = list(parameters["channels"])
        return replace(spec, scenario_parameters=parameters)

    def refuse_unlisted(self, planner: str, remedy: str = "") -> None:
        """Refuse a function of a module that is not listed."""
        functions.refuse_unlisted(planner, remedy)

    def require_code(self, spec: CampaignSpec) -> None:
        """Refuse a function whose module is not here, or does not define it."""
        functions.require_module(spec.planner)

    def packages(self, spec: CampaignSpec) -> Iterator[str]:
        """Return the package of the function."""
        functions.require_module(spec.planner)
        yield spec.planner.partition(":")[0].partition(".")[0]

    def runs_foreign_code(self, _setup: EpisodeSetup) -> bool:
        """Return True: the function is a user's."""
        return True


class BridgeWorld(CampaignWorld):
    """A process behind a bridge, simulator and planner in one; see `eigenfail.bridges`."""

    needs_bridge = True

    def check(self, spec: CampaignSpec) -> None:
        """Read the parameters; the bridge accepts or refuses them later."""
        bridges.check(spec)

    def resolve_disturbance(self, described: Described) -> DisturbanceModel:
        """Read the channels; the bridge accepts or refuses them later."""
        model = self._resolve_options(described, offered=False)
        if isinstance(model.channels, msgspec.UnsetType):
            return model
        numbers = [2]  # How many there are is not known: `swapped`, which needs two, may be named.
        for place, channel in enumerate(model.channels):
            name = split_name(channel.name)
            if name.target == EVERY:
                problem = "the number of vehicles behind a bridge is not known in advance."
                remedy = f"Name them one by one, such as {VEHICLE}1.{name.quantity}."
                raise InvalidValue(f"{CHANNELS_FIELD}[{place}].name", problem, remedy)
            numbers.append(name.vehicle or 1)
        varied = bridges.variation(described.scenario_parameters).varied
        return model.resolve(max(numbers), ALL_CHANNELS, tuple(varied))

    def list_own_signals(self, spec: CampaignSpec) -> tuple[str, ...]:
        """Return the signals that the campaign names; the bridge accepts or refuses them later."""
        named = bridges.find_named_signals(spec)
        return tuple(sorted(set().union(*named.values())))

    def check_offer(self, spec: CampaignSpec, offer: bridges.BridgeOffer) -> None:
        """Check scenario, planner, parameters, settings, channels and signals."""
        bridges.check_offer(offer, spec)

    def variation(self, spec: CampaignSpec) -> Variation:
        """Return the parameters that a bridge can receive."""
        return bridges.check(spec)

    def find_form(self, spec: CampaignSpec) -> EpisodeForm:
        """Return the most steps that the campaign sets, and the duration of a step.

        Raises:
            InvalidValue: steps differ in duration.
        """
        corners = list(bridges.check(spec).corners())
        steps = max(int(each.steps) for each in corners)
        step_s = _find_step(float(each.dt_s) for each in corners)
        return EpisodeForm(steps, step_s, self.channels(spec))

    def runs_foreign_code(self, _setup: EpisodeSetup) -> bool:
        """Return False: the bridge runs in a separate process."""
        return False


PLUGIN_WORLD = PluginWorld()
WORLDS: Mapping[str, CampaignWorld] = {
    functions.SIMULATOR: FunctionWorld(),
    bridges.SIMULATOR: BridgeWorld(),
}
"""Worlds whose simulator is no plug-in, by its name."""


def world_of(simulator: str) -> CampaignWorld:
    """Return the world of a simulator; plug-ins, installed here or not, share one."""
    return WORLDS.get(simulator, PLUGIN_WORLD)


def list_channels(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the names of the channels of a campaign's noise, in the order of the columns of z.

    Raises:
        UnknownName: no such parameter.
        InvalidValue: a parameter outside its bounds.
    """
    return world_of(spec.simulator).channels(spec)


def resolve_disturbance(described: Described) -> DisturbanceModel:
    """Return the disturbance model of a campaign with its channels written out, one by one.

    Raises:
        UnknownName: a channel, or a plug-in that it depends on, does not exist.
        InvalidValue: the model is invalid, or names channels in a world without a choice.
    """
    return world_of(described.simulator).resolve_disturbance(described)


def find_robustness_unit(spec: CampaignSpec) -> str:
    """Return the unit of the robustness of a campaign's episodes; empty if it has none.

    With named requirements it is empty, since their robustness is divided by their scales.
    """
    return "" if spec.named_requirements else world_of(spec.simulator).robustness_unit


def list_simulators() -> list[str]:
    """Return the valid simulators of a campaign: plug-ins, functions, and the bridge."""
    return sorted([*plugins.names(plugins.SIMULATORS), *WORLDS])


def drawn_for(spec: CampaignSpec, seed: int) -> dict[str, Any]:
    """Return the scenario parameters that an episode drew from its seed, by name.

    Empty if the scenario is unknown. Parameters that a channel makes a part of the search are left
    out, since they follow from the noise (`placed_for`).
    """
    try:
        return world_of(spec.simulator).variation(spec).drawn(seed)
    except InputError:
        return {}


def placed_for(spec: CampaignSpec, noise: NoiseTrajectory) -> dict[str, Any]:
    """Return the scenario parameters that the noise of an episode chose, by name.

    Empty if the scenario is unknown, or the episode ended before its first step.
    """
    names = spec.disturbance.searched_parameters
    if not names or not len(noise.z):
        return {}
    first = dict(zip(list_channels(spec), noise.z[0].tolist(), strict=True))
    try:
        variation = world_of(spec.simulator).variation(spec)
        return variation.place({name: first[f"{SCENARIO}.{name}"] for name in names})
    except InputError:
        return {}


def describe_disturbance(spec: CampaignSpec) -> dict[str, str]:
    """Return the disturbance model in words, by name; a function's sigma is its scale."""
    words = spec.disturbance.in_words()
    if world_of(spec.simulator).has_road:
        return words
    return {"sigma": f"{spec.disturbance.scale:g} at every step", "shape": words["shape"]}


def describe_requirements(spec: CampaignSpec) -> dict[str, str]:
    """Return the requirements that a campaign names, and its importance, in words."""
    words = {
        f"requirement {each.label}": f"{each.in_words()}; scale {each.scale:g} {each.unit}".rstrip()
        for each in spec.named_requirements
    }
    return words | ({"importance": spec.importance.in_words()} if spec.importance else {})


def _find_step(durations: Iterable[float]) -> float:
    """Return the duration of a step, which all episodes of a campaign share. [s]

    Raises:
        InvalidValue: steps differ in duration.
    """
    if len(known := {*durations}) > 1:
        problem = "the duration of a step varies, and a campaign has one for all episodes."
        raise InvalidValue("scenario_parameters", problem, "Give it one value.")
    return known.pop()


def _count_vehicles(situation: Situation | ReactiveSituation) -> int:
    """Return the number of vehicles besides the ego, including vehicles that come later."""
    if isinstance(situation, ReactiveSituation):
        return len(situation.challenges)
    return len(situation.actors)


def _match_type(value: Any, default: Any) -> Any:
    return float(value) if type(value) is int and isinstance(default, float) else value
