"""Settings of an ensemble, and what they make of its budget."""

from typing import Annotated, Any

import msgspec

from eigenfail import plugins
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import read_settings
from eigenfail_services.methods.fitness import Budgeted


class EnsembleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `ensemble`: each member has the same method and settings, and its own seed."""

    method: Annotated[str, msgspec.Meta(description="of every member")] = "ast"
    members: Annotated[
        int, msgspec.Meta(ge=2, le=16, description="learners that share the episodes evenly")
    ] = 4
    settings: Annotated[dict[str, Any], msgspec.Meta(description="of the members' method")] = {}

    def __post_init__(self) -> None:
        """Refuse what the members' method would refuse.

        Raises:
            UnknownName: no such method, or it has no such setting.
            InvalidValue: a setting outside its bounds.
        """
        if self.method not in plugins.names(plugins.METHODS):
            raise UnknownName("settings.method", self.method, plugins.names(plugins.METHODS))
        if self.method == "ensemble":
            problem = "an ensemble has no ensembles as members."
            raise InvalidValue("settings.method", problem, "Give it more members.")
        self.of_members()

    def check_budget(self, episodes: int) -> None:
        """Raises InvalidValue if a member's share is nothing, or too small for its method."""
        smallest = shares(episodes, self.members)[-1]
        members = self.of_members()
        if isinstance(members, Budgeted):
            members.check_budget(smallest)

    def of_members(self) -> Any:
        """The members' settings, read."""
        kind = plugins.load(plugins.METHODS, self.method).Settings
        return read_settings(kind, self.settings, "settings.settings")


def shares(episodes: int, members: int) -> list[int]:
    """Episodes shared evenly; the first members get those that are over.

    Raises:
        InvalidValue: there are fewer than members.
    """
    if episodes < members:
        raise InvalidValue(
            "settings.members",
            f"{members} members cannot share {episodes} episodes.",
            "Ask for fewer members, or for more episodes.",
        )
    return [episodes // members + (number < episodes % members) for number in range(members)]
