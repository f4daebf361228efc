"""How late a stop rule may come, told before a campaign is launched."""

from collections.abc import Iterator
from math import ceil
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.contracts import Paced
from eigenfail.settings import read_settings
from eigenfail.values import CampaignSpec, RoundSizes
from eigenfail_services.campaigns.earlier import search

ROUND_SIZE = "round_size"

ON_RESULTS = ("failures", "half_width", "cv")


class Pace(msgspec.Struct, frozen=True):
    """How large the steps are in which a method goes on.

    Attributes:
        first: episodes of its first round.
        later: episodes of the largest round after that.
        ahead: rounds that are open besides the oldest one.
        setting: what makes rounds smaller.
    """

    first: int
    later: int
    ahead: int
    setting: str


def stop_notes(spec: CampaignSpec) -> Iterator[str]:
    """What should be known of a campaign's stop rules, of one that was checked."""
    rules = {name: limit for name, limit in spec.stop.given().items() if name in ON_RESULTS}
    if not rules:
        return
    several = len(rules) > 1
    told = ", ".join(f"{name} = {limit:g}" for name, limit in rules.items())
    subject = f"The rules {told} are" if several else f"The rule {told} is"
    judged = f"{subject} judged after whole rounds"
    holds, pace = "one holds" if several else "it holds", pace_of(spec)
    if pace is None:
        yield f"{judged}, as large as the method makes them: once {holds}, open ones are finished."
    elif spec.episodes <= pace.first + pace.ahead * pace.later:
        yield f"{judged}, and {whole(pace)}: nothing ends early. {smaller(pace)}"
    else:
        yield f"{judged}, of {size(pace)} episodes here: once {holds}, {rest(pace, spec.episodes)}"


def whole(pace: Pace) -> str:
    """That the budget is spent before any rule is judged."""
    if pace.ahead:
        return "two rounds, which are open together, hold all of the budget"
    return "one round holds all of the budget"


def smaller(pace: Pace) -> str:
    """What to do about that."""
    return f"Give it more episodes, or a smaller {pace.setting}."


def size(pace: Pace) -> str:
    """How large rounds are."""
    return f"{pace.later}" if pace.first == pace.later else f"up to {max(pace.first, pace.later)}"


def rest(pace: Pace, episodes: int) -> str:
    """What is run all the same."""
    open_then = (1 + pace.ahead) * max(pace.first, pace.later) - 1
    why = ", as the next round is open by then" if pace.ahead else ""
    return f"up to {min(open_then, episodes - 1)} more are run{why}."


def pace_of(spec: CampaignSpec) -> Pace | None:
    """The steps of a campaign's method, or of the members of its ensemble; None if unknown."""
    searching = search(spec)
    method = plugins.load(plugins.METHODS, searching.method)
    settings = read_settings(method.Settings, dict(searching.settings), searching.field)
    sizes = sizes_of(method, settings, ceil(spec.episodes / members(spec)))
    if sizes is None:
        return None
    # With rules on results no campaign has more rounds open than that: see `Rounds`.
    ahead = min(1, getattr(method, "lookahead", 1))
    return Pace(sizes.first, sizes.later, ahead, f"{searching.field}.{sizes.setting}")


def members(spec: CampaignSpec) -> int:
    """How many learners share the episodes."""
    kind = plugins.load(plugins.METHODS, spec.method).Settings
    return getattr(read_settings(kind, spec.settings, "settings"), "members", 1)


def sizes_of(method: Any, settings: Any, episodes: int) -> RoundSizes | None:
    """How large the rounds of a method are; None if neither it nor a setting says."""
    if isinstance(method, Paced):
        return method.round_sizes(settings, episodes)
    size = getattr(settings, ROUND_SIZE, None)
    return None if size is None else RoundSizes(size, size, ROUND_SIZE)
