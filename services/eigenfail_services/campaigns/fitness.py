"""Whether a method's settings suit the campaign that they are for."""

from typing import Any

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.settings import read_settings
from eigenfail_services.campaigns.earlier import Search
from eigenfail_services.methods.fitness import Budgeted, Particular


def check_budget(settings: Any, episodes: int) -> None:
    """Raises InvalidValue for a budget that a method cannot begin with."""
    if isinstance(settings, Budgeted):
        settings.check_budget(episodes)


def check_estimates(searching: Search, field: str, ability: str = "estimate") -> None:
    """Make sure that a method tells a probability under its settings.

    Args:
        searching: the method and its settings.
        field: what asks for the probability.
        ability: the method of its learner that is needed for that.

    Raises:
        InvalidValue: it tells none.
    """
    method = plugins.load(plugins.METHODS, searching.method)
    if not hasattr(method, ability):
        problem = f"{searching.method} estimates no probability."
        raise InvalidValue(field, problem, "Leave this rule out, or take a method that does.")
    settings = read_settings(method.Settings, dict(searching.settings), searching.field)
    if isinstance(settings, Particular) and (why := settings.no_estimate()):
        problem = f"{searching.method} estimates no probability here: {why}"
        raise InvalidValue(field, problem, "Or leave this rule out.")
