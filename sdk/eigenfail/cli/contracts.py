"""What is asked of a plug-in of each kind, question by question."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.settings import read_settings
from eigenfail.testing.expectations import expect
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.testing.scenario import SCENARIO_CHECKS


class Check(msgspec.Struct, frozen=True):
    """One question to a plug-in; `run` raises if the answer is wrong.

    Attributes:
        promise: what holds if it passes.
        vital: whether no other question makes sense if it fails.
    """

    name: str
    promise: str
    run: Callable[[], None]
    vital: bool = False


class Contract(msgspec.Struct, frozen=True):
    """What is asked of plug-ins of one kind.

    Attributes:
        group: where they are registered.
        settings: the class attribute with their settings or parameters.
        suite: the conformance suite.
        subject: from the plug-in, what each check of the suite takes.
    """

    group: str
    settings: str
    suite: tuple[Callable[[Any], None], ...]
    subject: Callable[[Any], Any]

    def checks(self, plugin: Any) -> Iterator[Check]:
        """Every question to one plug-in."""
        about = f"Its `{self.settings}` is a msgspec.Struct whose fields have defaults."
        yield Check(f"has {self.settings}", about, partial(has_defaults, self, plugin), vital=True)
        for check in self.suite:
            promise = (check.__doc__ or "").partition("\n")[0]
            run = partial(self._ask, check, plugin)
            yield Check(check.__name__.replace("_", " "), promise, run)

    def _ask(self, check: Callable[[Any], None], plugin: Any) -> None:
        check(self.subject(plugin))


def has_defaults(contract: Contract, plugin: Any) -> None:
    """The plug-in's settings are readable, and complete without a user's."""
    kind = getattr(plugin, contract.settings, None)
    is_struct = isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    expect(is_struct, f"It has no class attribute `{contract.settings}` that is a msgspec.Struct.")
    read_settings(getattr(plugin, contract.settings), {}, contract.settings)


def planner_maker(plugin: Any) -> Callable[[], Any]:
    """Makes planners with default settings."""
    return lambda: plugin(read_settings(plugin.Settings, {}, "planner_settings"))


def scenario_of(plugin: Any) -> Any:
    """The scenario itself."""
    return plugin()


PLANNER = Contract(plugins.PLANNERS, "Settings", PLANNER_CHECKS, planner_maker)
SCENARIO = Contract(plugins.SCENARIOS, "Parameters", SCENARIO_CHECKS, scenario_of)
