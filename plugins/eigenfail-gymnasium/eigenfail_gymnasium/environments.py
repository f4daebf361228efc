"""Environments of Gymnasium, made from the parameters of a campaign."""

import re
import warnings
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any

import gymnasium
import highway_env
import msgspec
from highway_env.envs.common.abstract import AbstractEnv
from msgspec import Meta

from eigenfail.errors import EigenfailError, InvalidValue, UnknownName, describe_error
from eigenfail.settings import list_values
from eigenfail_gymnasium.declared import refuse_unlisted, refuse_unlisted_module

FIELD = "scenario_parameters"

Environment = gymnasium.Env[Any, Any]

DOTTED = re.compile(r"([A-Za-z_]\w*)(\.[A-Za-z_]\w*)+")
"""A text that highway-env may take for the path of a class, which it imports."""

OWN = ("gymnasium", "highway_env")
"""Packages that the plug-in imports itself."""

MOST_STEPS = 10_000


class GymnasiumParameters(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An environment, and what of it counts as a failure.

    Attributes:
        env: its id, as `gymnasium.make` takes it.
        package: module whose import registers the id; only one that the operator lists.
        arguments: keyword arguments of the environment.
        config: configuration of an environment of highway-env.
        steps: horizon; None: `duration` of highway-env, or the `max_episode_steps` of the id.
        dt_s: duration of a step in environments other than highway-env's; None: the environment's
            own value, or 1 s.
        failure_key: an episode fails if it is terminated and this entry of `info` is true; empty:
            whenever it is terminated.
        margin: `module:function` of a declared margin, in place of `failure_key`.
    """

    env: Annotated[str, Meta(min_length=1, max_length=100)] = "merge-v0"
    package: Annotated[str, Meta(max_length=200)] = ""
    arguments: dict[str, Any] = {}
    config: dict[str, Any] = {}
    steps: Annotated[int, Meta(ge=1, le=MOST_STEPS)] | None = None
    dt_s: Annotated[float, Meta(gt=0.0, le=3600.0)] | None = None
    failure_key: Annotated[str, Meta(max_length=100)] = ""
    margin: Annotated[str, Meta(max_length=200)] = ""

    def __post_init__(self) -> None:
        """Refuse what would run code that the operator has not listed; nothing is imported.

        Raises:
            InvalidValue: a module is not listed, or two ways to fail are named.
        """
        if self.package and self.package not in OWN:
            refuse_unlisted_module(self.package, f"{FIELD}.package")
        if self.margin:
            refuse_unlisted(self.margin, f"{FIELD}.margin")
        if self.margin and self.failure_key:
            problem = "a margin and a failure_key are two answers to the same question."
            raise InvalidValue(f"{FIELD}.failure_key", problem, "Name one of them.")
        _refuse_paths("arguments", self.arguments)
        _refuse_paths("config", self.config)
        if "render_mode" in self.arguments:
            problem = "workers have no screen."
            raise InvalidValue(f"{FIELD}.arguments.render_mode", problem, "Leave it out.")


def _refuse_paths(name: str, given: Mapping[str, Any]) -> None:
    """Refuse texts that look like the path of a class outside of highway-env, unless listed."""
    for path, value in list_values(given):
        match = DOTTED.fullmatch(value) if isinstance(value, str) else None
        if match and match[1] not in OWN:
            refuse_unlisted_module(value.rpartition(".")[0], f"{FIELD}.{name}.{path}")


def make_environment(parameters: GymnasiumParameters) -> Environment:
    """Return a newly made environment.

    Raises:
        UnknownName: the id or a key of `config` does not exist.
        InvalidValue: the package cannot be imported, or the environment refuses its arguments.
    """
    _register(parameters.package)
    if parameters.env not in gymnasium.registry:
        raise UnknownName(f"{FIELD}.env", parameters.env, gymnasium.registry)
    arguments = parameters.arguments | ({"config": parameters.config} if parameters.config else {})
    try:
        with warnings.catch_warnings():
            # Gymnasium warns of each id that has a successor; a campaign names the one it means.
            warnings.simplefilter("ignore")
            env: Environment = gymnasium.make(parameters.env, disable_env_checker=True, **arguments)
    except (Exception, SystemExit) as error:
        problem = f"'{parameters.env}' cannot be made: {describe_error(error)}."
        remedy = "Correct `arguments` and `config`, or install what the environment needs."
        raise InvalidValue(FIELD, problem, remedy) from error
    _check_road(env, parameters)
    return env


def _register(package: str) -> None:
    gymnasium.register_envs(highway_env)
    if not package or package in OWN:
        return
    try:
        import_module(package)
    except EigenfailError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"'{package}' cannot be imported: {describe_error(error)}."
        raise InvalidValue(f"{FIELD}.package", problem, "Install it with the workers.") from error


def _check_road(env: Environment, parameters: GymnasiumParameters) -> None:
    """Check what means something in environments of highway-env alone, or only elsewhere.

    Raises:
        UnknownName: a key of `config` that the environment does not have.
        InvalidValue: a field is meaningless here, or the environment has several egos.
    """
    if not is_road(env):
        if parameters.config:
            problem = f"'{parameters.env}' is not of highway-env."
            raise InvalidValue(f"{FIELD}.config", problem, "Write `arguments` instead.")
        return
    road: Any = env.unwrapped
    known = road.default_config()
    for name in parameters.config:
        if name not in known:
            raise UnknownName(f"{FIELD}.config", name, known)
    for name in ("margin", "failure_key", "dt_s"):
        if getattr(parameters, name):
            problem = "environments of highway-env fail by collisions, and know their time step."
            raise InvalidValue(f"{FIELD}.{name}", problem, "Leave it out.")
    if len(road.controlled_vehicles) != 1:
        problem = f"there are {len(road.controlled_vehicles)} controlled vehicles."
        raise InvalidValue(f"{FIELD}.config", problem, "Take an environment with a single ego.")


def is_road(env: Environment) -> bool:
    """Return whether an environment is one of highway-env."""
    return isinstance(env.unwrapped, AbstractEnv)


def find_time_step(env: Environment, parameters: GymnasiumParameters) -> float:
    """Return the duration of a step of an environment. [s]"""
    unwrapped: Any = env.unwrapped
    if is_road(env):
        return 1.0 / float(unwrapped.config["policy_frequency"])
    if parameters.dt_s is not None:
        return parameters.dt_s
    told = getattr(unwrapped, "dt", None) or getattr(unwrapped, "tau", None)
    return float(told) if isinstance(told, int | float) else 1.0


def find_horizon(env: Environment, parameters: GymnasiumParameters) -> int:
    """Return the number of steps of an episode.

    Raises:
        InvalidValue: neither the campaign nor the environment says it.
    """
    unwrapped: Any = env.unwrapped
    if parameters.steps is not None:
        return parameters.steps
    if is_road(env) and "duration" in unwrapped.config:
        decisions = float(unwrapped.config["duration"]) * float(
            unwrapped.config["policy_frequency"]
        )
        return max(round(decisions), 1)
    told = env.spec.max_episode_steps if env.spec else None
    if told is None:
        problem = f"'{parameters.env}' has no horizon of its own."
        raise InvalidValue(f"{FIELD}.steps", problem, "Write steps = 20, or as many as it needs.")
    return min(int(told), MOST_STEPS)
