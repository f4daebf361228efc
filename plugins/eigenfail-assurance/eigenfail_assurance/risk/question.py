"""Questions about a risk: the file of `eigenfail risk`, and the body of its request."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.files import read_toml
from eigenfail.settings import Ordinal, convert

MOST_SCENARIOS = 100
MOST_CLASSES = 10
EPISODES = 10_000
"""Size of the next budget whose best use is found, unless another one is asked for."""

KM_PER_FIGURE = 1e6
"""Distance to which rates by distance refer. [km]"""

LIKE_RISK = (
    "Name a TOML file with [target], [exposure] and [[scenarios]], as "
    "plugins/eigenfail-assurance/examples/risk.toml."
)

Positive = Annotated[float, msgspec.Meta(ge=1e-12, le=1e12)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e12)]
Count = Annotated[int, msgspec.Meta(ge=0, le=10**12)]
RiskName = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
CampaignReference = Ordinal | RiskName
"""Id of a campaign, or its name if no other campaign has it."""


class RiskTarget(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Largest rate of failures that is accepted: exactly one of the two.

    Attributes:
        per_hour: failures per hour of driving.
        per_million_km: failures per 10^6 km of driving.
    """

    per_hour: Positive | None = None
    per_million_km: Positive | None = None

    def __post_init__(self) -> None:
        """Raise InvalidValue unless exactly one rate is given."""
        given = [each for each in (self.per_hour, self.per_million_km) if each is not None]
        if len(given) != 1:
            remedy = "Give either per_hour or per_million_km."
            raise InvalidValue("target", f"{len(given)} rates are given.", remedy)


class Driving(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The driving during which encounters were counted.

    Attributes:
        hours: duration. [h]
        kilometres: distance; None if it is not known: no rate by distance is given then. [km]
    """

    hours: Positive
    kilometres: Positive | None = None


class RiskScenario(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How often a scenario is met, and the campaigns that estimate how often it ends in a failure.

    Attributes:
        name: its name in tables; any name will do, also one that no simulator's scenario has.
        encounters: number of times that it was met in the driving of `[exposure]`, or in `hours`.
        hours: duration of another log that gave `encounters`. [h]
        per_hour: how often it is met in an hour, if no log was counted.
        per_kilometre: how often it is met in a kilometre, likewise.
        interval: 95 % interval of `per_hour` or `per_kilometre`; without it they are taken to be
            known exactly.
        campaigns: ids or names. Several are counted together; this requires Monte Carlo campaigns
            with different seeds. None at all leaves the total undecided.
        failures_from: campaign (Monte Carlo or `chains`) whose failures, a random sample of p(z |
            failure), give the severities. By default `campaigns` themselves, if all of them are of
            Monte Carlo.
    """

    name: RiskName
    encounters: Count | None = None
    hours: Positive | None = None
    per_hour: NotNegative | None = None
    per_kilometre: NotNegative | None = None
    interval: tuple[Positive, Positive] | None = None
    campaigns: Annotated[tuple[CampaignReference, ...], msgspec.Meta(max_length=100)] = ()
    failures_from: CampaignReference | None = None

    def __post_init__(self) -> None:
        """Raise InvalidValue unless exactly one exposure is given, with an interval around it."""
        rates = [each for each in (self.per_hour, self.per_kilometre) if each is not None]
        if len(rates) + (self.encounters is not None) != 1:
            problem = "needs exactly one of encounters, per_hour and per_kilometre."
            raise InvalidValue(f"scenario '{self.name}'", problem)
        if self.hours is not None and self.encounters is None:
            problem = "hours are those of encounters, which are not given."
            raise InvalidValue(f"scenario '{self.name}'", problem)
        if self.interval is None:
            return
        if not rates:
            problem = "an interval is that of per_hour or per_kilometre."
            remedy = "Remove it: that of encounters follows from their number."
            raise InvalidValue(f"scenario '{self.name}'", problem, remedy)
        low, high = self.interval
        if not low <= rates[0] <= high:
            problem = f"{rates[0]:g} is not within its interval, {low:g} to {high:g}."
            raise InvalidValue(f"scenario '{self.name}'", problem)


class RiskQuestion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A question about the risk of a planner.

    Attributes:
        name: name of the assessment.
        target: largest rate of failures that is accepted.
        exposure: the driving during which encounters were counted.
        scenarios: the scenarios that can end in a failure; the risk covers only these.
        severity: thresholds between classes of severity, rising. [m²/s²]
        episodes: size of the next budget whose best use is found.
    """

    name: RiskName
    target: RiskTarget
    exposure: Driving
    scenarios: Annotated[
        tuple[RiskScenario, ...], msgspec.Meta(min_length=1, max_length=MOST_SCENARIOS)
    ]
    severity: Annotated[tuple[Positive, ...], msgspec.Meta(max_length=MOST_CLASSES)] = ()
    episodes: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = EPISODES

    def __post_init__(self) -> None:
        """Raise InvalidValue for equal names, thresholds that do not rise, or no distance."""
        (name, times), *_ = Counter(each.name for each in self.scenarios).most_common(1)
        if times > 1:
            raise InvalidValue("scenarios", f"'{name}' is named {times} times.", "Rename one.")
        if list(self.severity) != sorted(set(self.severity)):
            raise InvalidValue("severity", "the thresholds do not rise.", "Sort them.")
        if self.exposure.kilometres is None:
            self._refuse_distances()

    def _refuse_distances(self) -> None:
        remedy = "Give exposure.kilometres."
        if self.target.per_million_km is not None:
            problem = "the distance that was driven is not known."
            raise InvalidValue("target.per_million_km", problem, remedy)
        for each in self.scenarios:
            if each.per_kilometre is not None:
                problem = "per_kilometre needs the distance that was driven."
                raise InvalidValue(f"scenario '{each.name}'", problem, remedy)

    @property
    def km_per_hour(self) -> float | None:
        """Mean speed of the driving; None if its distance is not known. [km/h]"""
        driven = self.exposure.kilometres
        return None if driven is None else driven / self.exposure.hours


def read_risk_file(file: Path | str) -> RiskQuestion:
    """Return the question in a TOML file; without a name it is named after the file.

    Raises:
        InvalidValue: the file cannot be read, a field is unknown, or a value is of the wrong type
            or outside its bounds; the error names the field.
    """
    path = Path(file)
    return convert({"name": path.stem, **read_toml(path, LIKE_RISK)}, RiskQuestion, path.name)
