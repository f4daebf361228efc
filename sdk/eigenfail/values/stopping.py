"""Rules by which a campaign stops before its budget is spent."""

from typing import Annotated

import msgspec
from msgspec import Meta

MAX_USD = 1e9
MAX_WALL_S = 1e8


class StopRules(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The first rule that holds ends the campaign; None is no rule.

    Those on results are judged at whole rounds in index order, so that a campaign stops at the
    same episode whoever runs it. Those on time and cost are judged as it runs; they cannot be
    repeated to the episode.

    Attributes:
        failures: so many collisions were found. The rate of a campaign that stops at its first
            failures is too high on average, the more so the smaller its rounds are.
        half_width: half the width of the failure rate's 95 % Wilson interval fell to this, where
            episodes are drawn from one distribution.
        cv: the coefficient of variation of the failure probability, or of its lower bound, fell to
            this, of methods that tell one.
        wall_s: it was running for so long; pauses do not count.
        cost_usd: its instances cost so much.
    """

    failures: Annotated[int, Meta(ge=1, le=10_000_000)] | None = None
    half_width: Annotated[float, Meta(gt=0.0, lt=0.5)] | None = None
    cv: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    wall_s: Annotated[float, Meta(gt=0.0, le=MAX_WALL_S)] | None = None
    cost_usd: Annotated[float, Meta(gt=0.0, le=MAX_USD)] | None = None

    def given(self) -> dict[str, float]:
        """The rules that there are, by name."""
        rules = msgspec.structs.asdict(self)
        return {name: limit for name, limit in rules.items() if limit is not None}
