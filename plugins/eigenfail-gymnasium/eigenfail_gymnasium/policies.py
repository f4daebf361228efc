"""The planner `policy`: a function of a user's module, or a policy of stable-baselines3.

A file of stable-baselines3 holds weights and pickled parts. Only the weights are read, with
torch's `weights_only`, into a policy that is made here: no code of the file is run.
"""

import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar

import msgspec
from msgspec import Meta

from eigenfail.errors import InvalidValue, PlannerError, UnknownName, describe_error
from eigenfail.values.scene import Control, Mission, Perception
from eigenfail_gymnasium.declared import load_declared, refuse_unlisted
from eigenfail_gymnasium.rules import keep_gap
from eigenfail_gymnasium.stages import ObservedPerception, PolicyTask

ALGORITHMS = ("A2C", "DDPG", "DQN", "PPO", "SAC", "TD3")

Policy = Callable[[Any], Any]
"""Returns the action for an observation."""

PolicyMaker = Callable[[PolicyTask], Policy]
"""Makes the policy of one episode: what it remembers is gone at the next one."""

NO_CONTROL = Control(0.0, 0.0)
"""A policy answers an action instead."""


class PolicySettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which policy drives.

    Attributes:
        function: `module:function` of a declared policy; empty: the rule of the plug-in, unless
            there is a model.
        model: file of stable-baselines3, by its path relative to the working folder of workers.
        algorithm: class of stable-baselines3 that wrote the file.
        layers: units of the hidden layers; None: as the file says, or the algorithm's default.
    """

    function: Annotated[str, Meta(max_length=200)] = ""
    model: Annotated[str, Meta(max_length=200)] = ""
    algorithm: str = ""
    layers: tuple[Annotated[int, Meta(ge=1, le=4096)], ...] | None = None

    def __post_init__(self) -> None:
        """Refuse a policy that may not be loaded here; nothing is imported or read.

        Raises:
            UnknownName: the algorithm is unknown.
            InvalidValue: the module is not listed, the file is elsewhere, or both are named.
        """
        if self.function and self.model:
            problem = "a function and a model are two policies."
            raise InvalidValue("planner_settings.function", problem, "Name one of them.")
        if self.function:
            refuse_unlisted(self.function, "planner_settings.function")
        if self.model and self.algorithm not in ALGORITHMS:
            raise UnknownName("planner_settings.algorithm", self.algorithm, ALGORITHMS)
        path = PurePosixPath(self.model)
        if path.is_absolute() or ".." in path.parts:
            problem = f"'{self.model}' is not below the folder in which workers run."
            remedy = "Start the service in the folder of the file, and name the file alone."
            raise InvalidValue("planner_settings.model", problem, remedy)


class PolicyPlanner:
    """Drives by a policy of Gymnasium. Implements `Planner`, under the simulator `gymnasium`.

    Args:
        settings: which policy.
    """

    Settings: ClassVar = PolicySettings

    def __init__(self, settings: PolicySettings) -> None:
        self._settings = settings
        self._make: PolicyMaker | None = None
        self._policy: Policy | None = None

    def reset(self, mission: Mission) -> None:  # noqa: ARG002 - the environment tells the policy
        """Forget the policy of the episode before."""
        self._policy = None

    def act(self, perception: Perception) -> Control:
        """Leave the action of the policy in the perception.

        Returns:
            A control of zeros: an action is none.

        Raises:
            PlannerError: the simulator shows no observation of Gymnasium.
            InvalidValue: the policy cannot be loaded.
        """
        if not isinstance(perception, ObservedPerception):
            problem = "A policy drives in environments of Gymnasium alone."
            raise PlannerError(problem, 'Write simulator = "gymnasium".')
        if self._policy is None:
            if self._make is None:
                self._make = _find_maker(self._settings, perception.task)
            self._policy = self._make(perception.task)
        perception.decision.action = self._policy(perception.observation)
        return NO_CONTROL


def _find_maker(settings: PolicySettings, task: PolicyTask) -> PolicyMaker:
    if settings.function:
        return load_declared(settings.function, "policy", "planner_settings.function")
    if not settings.model:
        return keep_gap.function
    model = read_model(settings, task)
    return lambda _task: model


def read_model(settings: PolicySettings, task: PolicyTask) -> Policy:
    """Return the policy of a file of stable-baselines3; it is asked for its likeliest action.

    Raises:
        InvalidValue: the file does not exist, or its weights do not fit the environment.
    """
    # They take seconds to import, which campaigns without a model do not spend.
    import stable_baselines3
    from stable_baselines3.common.save_util import load_from_zip_file

    field, path = "planner_settings.model", Path.cwd() / settings.model
    if not path.is_file():
        problem = f"there is no file '{settings.model}' in {Path.cwd()}."
        raise InvalidValue(field, problem, "Start the service in the folder of the file.")
    layers = settings.layers if settings.layers is not None else _read_layers(path)
    arguments = {} if layers is None else {"net_arch": list(layers)}
    kind = getattr(stable_baselines3, settings.algorithm).policy_aliases["MlpPolicy"]
    try:
        made = kind(task.observation_space, task.action_space, _no_schedule, **arguments)
        # `load_data` would unpickle; without it weights alone are read.
        _, weights, _ = load_from_zip_file(path, load_data=False, device="cpu")
        made.load_state_dict(weights["policy"])
    except Exception as error:
        problem = f"'{settings.model}' is no {settings.algorithm} for this environment: "
        remedy = "Name its algorithm and, if they are not the default, its `layers`."
        raise InvalidValue(field, f"{problem}{describe_error(error)}.", remedy) from error
    made.set_training_mode(False)

    def act(observation: Any) -> Any:
        return made.predict(observation, deterministic=True)[0]

    return act


def _no_schedule(_progress: float) -> float:
    """Return the learning rate of a policy that learns nothing."""
    return 0.0


def _read_layers(path: Path) -> Any:
    """Return the hidden layers as the file says in plain JSON; None if it does not."""
    try:
        with zipfile.ZipFile(path) as archive:
            data = json.loads(archive.read("data"))
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    given = data.get("policy_kwargs") if isinstance(data, Mapping) else None
    layers = given.get("net_arch") if isinstance(given, Mapping) else None
    is_plain = isinstance(layers, list) and all(type(each) is int for each in layers)
    return layers if is_plain else None
