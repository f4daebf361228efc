"""Requirements: conditions that a drive must satisfy, and their robustness.

A requirement is a frozen struct that TOML and JSON name by its `kind`. It gives the course of an
episode a robustness: above 0 if the episode satisfies it, 0 or below if the episode violates it. A
campaign has a list of requirements, the most important first. The default is `no_collision`.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from math import isclose, isnan
from typing import Annotated, ClassVar, Final, NamedTuple

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue, SimulatorError, UnknownName
from eigenfail.values import temporal_logic
from eigenfail.values.measures import MEASURES
from eigenfail.values.signals import NEVER_S, DrivenCourse, ExpectedCourse

MOST_REQUIREMENTS: Final = 20

LARGEST: Final = 1e6
"""Bound of every robustness, so that it stays finite in sums, messages and databases."""

FIELD: Final = "requirements"

Name = Annotated[str, msgspec.Meta(max_length=60, pattern="^[a-z0-9_]*$")]
Scale = Annotated[float, msgspec.Meta(gt=0.0, le=LARGEST)]


class Requirement(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="kind"
):
    """Base of all requirements.

    Attributes:
        name: name in tables and filters; its kind if none is given.
        scale: robustness that counts as much as a metre of distance to other vehicles, in the unit
            of this requirement. Searches use the smallest robustness ÷ scale.
    """

    name: Name = ""
    scale: Scale = 1.0

    @property
    def kind(self) -> str:
        """Name of the kind in TOML and JSON."""
        return str(self.__struct_config__.tag)

    @property
    def label(self) -> str:
        """The name, or the kind if the name is empty."""
        return self.name or self.kind

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of the robustness; empty for none."""

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals that the requirement uses."""
        return frozenset()

    def check(self, expected: ExpectedCourse, field: str) -> None:
        """Refuse a requirement that cannot be judged.

        Args:
            expected: signals that the episodes of the campaign will have.
            field: path of the requirement, for the error.

        Raises:
            UnknownName: a signal or measure does not exist; the error lists the known ones.
            InvalidValue: its fields do not fit each other, or the simulator does not report its
                signals.
        """
        if lacking := sorted(self.signals.difference(expected.signals)):
            problem = f"needs the signal {lacking[0]}, which this simulator does not tell."
            raise InvalidValue(field, problem, f"It tells {', '.join(sorted(expected.signals))}.")

    @abstractmethod
    def find_robustness(self, course: DrivenCourse) -> float | None:
        """Return the robustness of a course, in the unit of the requirement.

        None if the course ended before the requirement could be judged.

        Raises:
            SimulatorError: the simulator does not report the necessary signals or measures.
        """

    @abstractmethod
    def in_words(self) -> str:
        """Return the requirement in words."""


class NoCollision(Requirement, frozen=True, tag="no_collision"):
    """The ego does not touch another vehicle. Robustness: smallest distance of footprints. [m]"""

    unit: ClassVar[str] = "m"

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the smallest distance; 0 on a collision."""
        return course.measures.robustness_m

    def in_words(self) -> str:
        """Return the requirement in words."""
        return "no collision"


class PreventableCollision(Requirement, frozen=True, tag="r157_cut_in"):
    """No collision that is preventable by UN Regulation No. 157 (paragraph 5.2.5.2 c).

    The time to collision counts when a vehicle that cuts in is 0.3 m inside the lane. If it then
    exceeds v_rel / (2 · 6 m/s²) + 0.35 s, the system shall avoid a collision. A vehicle that cuts
    in later does not count while it stays in the lane; all other vehicles count. Two conditions of
    5.2.5.2 a and b are assumed: the lateral movement was visible for 0.72 s, and the vehicle keeps
    its speed. Robustness: the smallest distance to the vehicles that count. [m]
    """

    unit: ClassVar[str] = "m"
    signals: ClassVar[frozenset[str]] = frozenset({"preventable_distance_m"})

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the smallest distance."""
        return float(course.signals["preventable_distance_m"].min())

    def in_words(self) -> str:
        """Return the requirement in words."""
        return "no collision that was preventable by UN R157 (5.2.5.2)"


class SafeDistance(Requirement, frozen=True, tag="rss_distance"):
    """The ego keeps the safe longitudinal distance of responsibility-sensitive safety (RSS).

    d = v_r ρ + a ρ² / 2 + (v_r + ρ a)² / (2 b) - v_f² / (2 B), at least 0. v_r is the speed of the
    ego, and v_f the speed of the vehicle ahead. Source: Shalev-Shwartz, Shammah and Shashua, On a
    Formal Model of Safe and Scalable Self-driving Cars, 2017, definition 1. A vehicle that cuts in
    too closely counts as a violation, too: the requirement does not assign blame. Robustness: the
    smallest gap minus d. [m]

    Attributes:
        response_s: ρ, the time until the ego responds.
        accelerate_mps2: a, the largest acceleration of the ego during the response time.
        brake_mps2: b, the smallest braking of the ego after the response time.
        brake_ahead_mps2: B, the largest braking of the vehicle ahead.
    """

    response_s: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.5
    accelerate_mps2: Annotated[float, msgspec.Meta(ge=0.0, le=20.0)] = 1.0
    brake_mps2: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 4.0
    brake_ahead_mps2: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 8.0

    unit: ClassVar[str] = "m"
    signals: ClassVar[frozenset[str]] = frozenset({"gap_m", "speed_mps", "leader_speed_mps"})

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the smallest gap minus the safe distance."""
        own = course.signals["speed_mps"]
        # Squared below, a vehicle that moves backwards would need room to stop in.
        ahead = np.maximum(course.signals["leader_speed_mps"], 0.0)
        rho_s, a = self.response_s, self.accelerate_mps2
        stopping_m = (own + rho_s * a) ** 2 / (2.0 * self.brake_mps2)
        stopping_m = own * rho_s + 0.5 * a * rho_s**2 + stopping_m
        safe_m = np.maximum(stopping_m - ahead**2 / (2.0 * self.brake_ahead_mps2), 0.0)
        return float((course.signals["gap_m"] - safe_m).min())

    def in_words(self) -> str:
        """Return the requirement in words."""
        return (
            f"gap above the RSS distance (response {self.response_s:g} s, acceleration "
            f"{self.accelerate_mps2:g} m/s², braking {self.brake_mps2:g} m/s², ahead "
            f"{self.brake_ahead_mps2:g} m/s²)"
        )


class TimeHeadway(Requirement, frozen=True, tag="time_headway"):
    """The ego keeps a time headway to the vehicle ahead in its path.

    Robustness: the smallest headway, which is gap ÷ speed of the ego, minus the limit. [s]

    Attributes:
        at_least_s: the limit. The default is half of the 1.6 s that UN R157 (5.2.3.3) demands at 60
            km/h, because vehicles that cut in reduce the headway.
    """

    scale: Scale = 0.1
    at_least_s: Annotated[float, msgspec.Meta(gt=0.0, lt=NEVER_S)] = 0.8

    unit: ClassVar[str] = "s"
    signals: ClassVar[frozenset[str]] = frozenset({"headway_s"})

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the smallest headway minus the limit."""
        return float(course.signals["headway_s"].min()) - self.at_least_s

    def in_words(self) -> str:
        """Return the requirement in words."""
        return f"time headway above {self.at_least_s:g} s"


class UncausedBraking(Requirement, frozen=True, tag="uncaused_braking"):
    """The ego does not brake hard without cause, such as for a vehicle that does not exist.

    A cause is a true vehicle ahead with a time to collision below `cause_ttc_s` or a headway below
    `cause_headway_s`, in the step or within `memory_s` before it. Robustness: the smallest
    acceleration over the steps without a cause, at most 0, plus `hard_mps2`. [m/s²]

    Attributes:
        hard_mps2: braking by this or more is hard; the measure `hard_brakings` counts braking above
            3 m/s².
        cause_ttc_s: time to collision below which a vehicle is a cause; own choice, far above the
            1.5 s of a near miss.
        cause_headway_s: headway below which a vehicle is a cause; own choice.
        memory_s: time for which a planner may go on braking once the cause is gone; own choice.
    """

    scale: Scale = 0.3
    hard_mps2: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 3.0
    cause_ttc_s: Annotated[float, msgspec.Meta(gt=0.0, lt=NEVER_S)] = 6.0
    cause_headway_s: Annotated[float, msgspec.Meta(ge=0.0, lt=NEVER_S)] = 1.5
    memory_s: Annotated[float, msgspec.Meta(ge=0.0, le=NEVER_S)] = 1.0

    unit: ClassVar[str] = "m/s²"
    signals: ClassVar[frozenset[str]] = frozenset({"acceleration_mps2", "ttc_ahead_s", "headway_s"})

    def check(self, expected: ExpectedCourse, field: str) -> None:
        """Refuse, in addition, a memory that is not a whole number of steps."""
        super().check(expected, field)
        steps = self.memory_s / expected.dt_s
        if not isclose(steps, round(steps), abs_tol=1e-6):
            problem = f"{self.memory_s:g} s is no whole number of steps of {expected.dt_s:g} s."
            remedy = f"Write {round(steps) * expected.dt_s:g}."
            raise InvalidValue(f"{field}.memory_s", problem, remedy)

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the margin between the hardest braking without a cause and hard braking."""
        signals = course.signals
        caused = signals["ttc_ahead_s"] < self.cause_ttc_s
        caused |= signals["headway_s"] < self.cause_headway_s
        # The control of step k was chosen on what was so after step k - 1.
        before = 1 + round(self.memory_s / course.dt_s)
        steps = len(caused)
        excused = np.array([caused[max(0, k - before) : k + 1].any() for k in range(steps)])
        # Steps with a cause count as no braking, and so does speeding up.
        braking = np.where(excused, 0.0, np.minimum(signals["acceleration_mps2"], 0.0))
        return float(braking.min()) + self.hard_mps2

    def in_words(self) -> str:
        """Return the requirement in words."""
        return (
            f"no braking by {self.hard_mps2:g} m/s² or more without a vehicle ahead: time to "
            f"collision below {self.cause_ttc_s:g} s or headway below {self.cause_headway_s:g} s, "
            f"within the last {self.memory_s:g} s"
        )


class KeptLane(Requirement, frozen=True, tag="lane_keeping"):
    """The footprint of the ego stays within the lane that it is nearest to.

    Use it for scenarios without a necessary lane change. Robustness: the smallest distance from the
    footprint to the border of the lane, plus `beyond_m`. [m]

    Attributes:
        beyond_m: maximum distance of the footprint beyond the border.
    """

    scale: Scale = 0.1
    beyond_m: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 0.0

    unit: ClassVar[str] = "m"
    signals: ClassVar[frozenset[str]] = frozenset({"lane_margin_m"})

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the smallest distance to the border, plus the allowed excess."""
        return float(course.signals["lane_margin_m"].min()) + self.beyond_m

    def in_words(self) -> str:
        """Return the requirement in words."""
        return f"no more than {self.beyond_m:g} m out of the lane"


NO_VALUE: Mapping[str, float] = {
    "severity": 0.0,
    "min_ttc_s": NEVER_S,
    "max_drac_mps2": 0.0,
    "final_drac_mps2": 0.0,
}
"""Substitutes for missing values, for the measures that an episode may lack."""

REPORTED = frozenset({"robustness_m", "max_jerk_mps3", "hard_brakings", "clipped_steps"})
"""Measures that every episode has, if the simulator reports the control that was applied."""


class MeasureLimit(Requirement, frozen=True, tag="measure"):
    """A measure of the episode stays within limits. Robustness: distance from the nearer limit.

    A value at a limit violates the requirement. A count may reach the limit, and has a robustness
    of 0.5 there.

    Attributes:
        measure: name of the measure.
        at_least: lower limit.
        at_most: upper limit.
    """

    measure: str
    at_least: float | None = None
    at_most: float | None = None

    @property
    def unit(self) -> str:
        """Unit of the measure."""
        return MEASURES[self.measure].unit

    def check(self, expected: ExpectedCourse, field: str) -> None:
        """Refuse, in addition, an unknown measure, and missing or contradictory limits."""
        super().check(expected, field)
        allowed = sorted(NO_VALUE.keys() | REPORTED)
        if self.measure not in allowed:
            raise UnknownName(f"{field}.measure", self.measure, allowed)
        is_count = MEASURES[self.measure].is_count
        limits = [limit for limit in (self.at_least, self.at_most) if limit is not None]
        # `hard_brakings` at most 1.5 would read as if half a braking could be allowed.
        if is_count and any(limit < 0.0 or limit != round(limit) for limit in limits):
            problem = f"{self.measure} is a count."
            raise InvalidValue(field, problem, "Give whole numbers of 0 or more as its limits.")
        if not limits:
            raise InvalidValue(field, "has no limit.", "Give at_least or at_most, or both.")
        if not is_count and self.at_most is not None and self.at_most <= 0.0:
            problem = f"at_most is {self.at_most:g}, and {self.measure} is never below 0."
            raise InvalidValue(field, problem, "Give at_most a value above 0.")
        if limits[0] > limits[-1]:
            problem = f"at_least is {limits[0]:g}, and at_most {limits[-1]:g}."
            raise InvalidValue(field, problem, "Give at_most the larger value.")

    def find_robustness(self, course: DrivenCourse) -> float:
        """Return the distance of the measure from the nearer limit, negative beyond it."""
        value = getattr(course.measures, self.measure)
        if value is None and self.measure in REPORTED:
            problem = f"The simulator does not report what {self.measure} is made of."
            raise SimulatorError(problem, "Take another requirement.")
        value = NO_VALUE[self.measure] if value is None else float(value)
        above = LARGEST if self.at_least is None else value - self.at_least
        below = LARGEST if self.at_most is None else self.at_most - value
        return min(above, below) + (0.5 if MEASURES[self.measure].is_count else 0.0)

    def in_words(self) -> str:
        """Return the requirement in words."""
        counts = MEASURES[self.measure].is_count
        sides = ("at least", "at most") if counts else ("above", "below")
        limits = zip(sides, (self.at_least, self.at_most), strict=True)
        words = [f"{side} {limit:g}" for side, limit in limits if limit is not None]
        unit = f" {self.unit}" if self.unit else ""
        return f"{MEASURES[self.measure].label} {' and '.join(words)}{unit}"


class Formula(Requirement, frozen=True, tag="formula"):
    """A formula of signal temporal logic over signals; see `values.temporal_logic`.

    Attributes:
        formula: text of the formula, such as `always (headway_s > 0.5)`.
    """

    formula: Annotated[str, msgspec.Meta(min_length=1)]

    unit: ClassVar[str] = ""  # A formula may compare signals of several units.

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals in the formula."""
        return temporal_logic.list_names(temporal_logic.parse_formula(self.formula))

    def check(self, expected: ExpectedCourse, field: str) -> None:
        """Refuse a formula that cannot be judged."""
        temporal_logic.check_formula(self.formula, *expected, f"{field}.formula")

    def find_robustness(self, course: DrivenCourse) -> float | None:
        """Return the robustness of the formula at the start; None if it is not judged."""
        # Sorted, so that the error names the same signal on every machine.
        for name in sorted(self.signals):
            if not np.isfinite(course.signals[name]).all():
                problem = f"signal {name} is not finite, so that {self.label} cannot be judged."
                raise SimulatorError(problem, "Report a number at each step.")
        return temporal_logic.evaluate_formula(self.formula, course.dt_s, course.signals)

    def in_words(self) -> str:
        """Return the requirement in words."""
        return self.formula


AnyRequirement = (
    NoCollision
    | PreventableCollision
    | SafeDistance
    | TimeHeadway
    | UncausedBraking
    | KeptLane
    | MeasureLimit
    | Formula
)

Requirements = Annotated[
    tuple[AnyRequirement, ...], msgspec.Meta(min_length=1, max_length=MOST_REQUIREMENTS)
]

COLLISION_ALONE: Final = (NoCollision(),)
"""The requirements of a campaign that names none."""


def check_requirements(requirements: Sequence[AnyRequirement], expected: ExpectedCourse) -> None:
    """Refuse requirements that cannot be judged.

    Raises:
        UnknownName: a signal or measure does not exist; the error lists the known ones.
        InvalidValue: a requirement is invalid, or has the name of another one.
    """
    # Tables and filters name a requirement by its label.
    labels = [each.label for each in requirements]
    for place, each in enumerate(requirements):
        field = f"{FIELD}[{place}]"
        if each.label in labels[:place]:
            problem = f"'{each.label}' is the name of an earlier one."
            raise InvalidValue(f"{field}.name", problem, "Give it another name.")
        each.check(expected, field)


class RequirementVerdict(NamedTuple):
    """The verdict of a campaign's requirements on an episode.

    Attributes:
        values: robustness of each requirement, in its unit; None for a requirement that is not
            judged.
        smallest: the smallest robustness ÷ scale; for a safe episode, the value of the importance
            if there is one. 0 if a requirement is violated. If nothing is judged, 1 m more than the
            smallest distance to another vehicle, which is not a statement on a requirement.
        violated: place of the first violated requirement, from 0; None if none is violated.
    """

    values: tuple[float | None, ...]
    smallest: float
    violated: int | None


class EpisodeJudge(NamedTuple):
    """Judge of the episodes of a campaign.

    Attributes:
        requirements: requirements of the campaign, the most important first.
        importance: requirement that guides searches in safe episodes, in place of the
            requirements.
    """

    requirements: tuple[AnyRequirement, ...]
    importance: AnyRequirement | None = None

    @property
    def signals(self) -> frozenset[str]:
        """Names of the necessary signals."""
        followed = () if self.importance is None else (self.importance,)
        return frozenset[str]().union(*[each.signals for each in (*self.requirements, *followed)])

    def judge(self, course: DrivenCourse) -> RequirementVerdict:
        """Judge the course of an episode.

        Raises:
            SimulatorError: a requirement cannot be judged.
        """
        values = tuple(_find_robustness(each, course) for each in self.requirements)
        violated = [
            place for place, value in enumerate(values) if value is not None and value <= 0.0
        ]
        if violated:
            return RequirementVerdict(values, 0.0, violated[0])
        # Only of episodes that are no failures: what counts as a failure must not depend on it.
        if self.importance is not None:
            followed = _find_robustness(self.importance, course)
            if followed is not None:
                followed = min(followed / self.importance.scale, LARGEST)
                return RequirementVerdict(values, _make_positive(followed), None)
        judged = zip(values, self.requirements, strict=True)
        scaled = [value / each.scale for value, each in judged if value is not None]
        smallest = min(scaled) if scaled else _make_positive(course.measures.robustness_m)
        return RequirementVerdict(values, min(smallest, LARGEST), None)


def _find_robustness(requirement: AnyRequirement, course: DrivenCourse) -> float | None:
    value = requirement.find_robustness(course)
    if value is None:
        return None
    if isnan(value):
        raise SimulatorError(f"{requirement.label} has no robustness.", "Look at its signals.")
    # Infinity has no place in JSON, nor in the arithmetic of searches.
    return min(max(value, -LARGEST), LARGEST)


def _make_positive(value: float) -> float:
    """Return a number above 0 that rises with the value; 0 is reserved for failures.

    The number is 1 + v for v ≥ 0, and 1 / (1 - v) below: slope 1 at 0, and the same order
    everywhere.
    """
    return 1.0 + value if value >= 0.0 else 1.0 / (1.0 - value)
