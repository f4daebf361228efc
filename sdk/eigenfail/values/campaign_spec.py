"""The task of a campaign: its specification, with limits, stop rules and priority."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any

import msgspec
from msgspec import Meta, structs

from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.episode import MAX_SEED, EpisodeSetup
from eigenfail.values.requirements import COLLISION_ALONE, AnyRequirement, Requirements

MAX_USD = 1e9
MAX_WALL_S = 1e8

RESULT_RULES = ("failures", "half_width", "cv")
"""Stop rules on results."""


class StopRules(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Rules that end a campaign: the first one that holds ends it. None: the rule is not used.

    Rules on results are judged at whole rounds in index order, so that a campaign stops at the
    same episode on any worker. Rules on time and cost are judged while the campaign runs, so that
    a repeated campaign may stop at another episode.

    Attributes:
        failures: number of failures. The failure rate is estimated without bias, and its
            interval is exact for this rule.
        half_width: threshold for half the width of the 95 % confidence sequence of the failure
            rate; the rule holds at or below it. The upper end counts errored and unresolved
            episodes as failures. The sequence holds after every round, and is wider than an
            interval for a fixed number of episodes; it is also the interval shown. The rule applies
            to every method, even to a search, whose share of failures is not a probability.
        cv: threshold for the coefficient of variation of the failure probability, or of its lower
            bound, for methods that estimate one; the rule holds at or below it.
        wall_s: maximum running time, without pauses.
        cost_usd: maximum cost of its instances.
    """

    failures: Annotated[int, Meta(ge=1, le=10_000_000)] | None = None
    half_width: Annotated[float, Meta(gt=0.0, lt=0.5)] | None = None
    cv: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None
    wall_s: Annotated[float, Meta(gt=0.0, le=MAX_WALL_S)] | None = None
    cost_usd: Annotated[float, Meta(gt=0.0, le=MAX_USD)] | None = None

    @property
    def judges_failures(self) -> bool:
        """True if a rule on the number of failures or on the failure rate is set."""
        return self.failures is not None or self.half_width is not None

    @property
    def judges_results(self) -> bool:
        """True if a rule on results is set; such rules are judged after each round."""
        return not self.given().keys().isdisjoint(RESULT_RULES)

    def given(self) -> dict[str, float]:
        """Return the limits of the rules that are set, by name."""
        rules = msgspec.structs.asdict(self)
        return {name: limit for name, limit in rules.items() if limit is not None}


class Priority(StrEnum):
    """Priority of a campaign: running campaigns share the workers' time by its weight."""

    LOW = "low"
    NORMAL = "normal"
    HIGH = "high"

    @property
    def weight(self) -> int:
        """Weight: the share of the workers' time is weight ÷ sum over all campaigns with work."""
        return WEIGHTS[self]

    @property
    def head_start_ms(self) -> int:
        """Head start of the campaign in the queue. [ms]"""
        return HEAD_STARTS_MS[self]


# Steps of three: beside a high campaign, a low one still gets a tenth of the workers.
WEIGHTS: Mapping[Priority, int] = {Priority.LOW: 1, Priority.NORMAL: 3, Priority.HIGH: 9}

HOUR_MS = 3_600_000

HEAD_STARTS_MS: Mapping[Priority, int] = {
    Priority.LOW: 0,
    Priority.NORMAL: HOUR_MS,
    Priority.HIGH: 2 * HOUR_MS,
}
"""A campaign that is queued over two hours after another one never starts before it."""


class PriorityChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """New priority of a campaign."""

    priority: Priority


MAX_EPISODES = 10_000_000
MOST_PARALLEL = 100_000
LONGEST_NAME = 200
LONGEST_TAG = 80
MOST_TAGS = 50

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_NAME)]

# A dollar sign alone would also accept a line break at the end.
_END = r"(?![\s\S])"

PlannerVersion = Annotated[str, msgspec.Meta(pattern=rf"^[\w.+/-]{{1,{LONGEST_TAG}}}{_END}")]
"""Version of a planner, such as a commit or a tag: letters, digits and . _ + / -"""

# No blank at either end: two projects that look alike must be one.
Project = Annotated[
    str, msgspec.Meta(min_length=1, max_length=LONGEST_TAG, pattern=rf"^\S([^\r\n]*\S)?{_END}")
]

Tag = Annotated[str, msgspec.Meta(pattern=rf"^[\w.+/:=-]{{1,{LONGEST_TAG}}}{_END}")]

Settings = dict[str, Any]


class Section(StrEnum):
    """Section of the launch form; fields without a section appear with their plug-ins."""

    CAMPAIGN = "Campaign"
    RECORDS = "Price, records and priority"
    PLUGINS = ""


class SpecField(msgspec.Struct, frozen=True, kw_only=True):
    """Description of a field of a spec, for forms, pages and comparisons.

    The description is part of the field's type, so that a new field is described in one place.

    Attributes:
        help: sentence next to the field in a form.
        section: section of the form.
        label: label on the page of a campaign; empty for fields that the page shows elsewhere.
        changes_episodes: whether campaigns that differ in this field have different episodes.
    """

    help: str
    section: Section = Section.PLUGINS
    label: str = ""
    changes_episodes: bool = True


class LabelField(SpecField, frozen=True, kw_only=True):
    """Description of a field that does not change the episodes."""

    changes_episodes: bool = False


class CampaignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Specification of a campaign as requested by the user.

    Attributes:
        episodes: the budget; every simulated episode counts.
        stop: stop rules, which may end the campaign before its budget is spent.
        price_usd_per_hour: price of one instance.
        instances: number of instances that the campaign occupies while it runs.
        parallel: number of workers to keep busy: enough episodes are open for them, so that a
            method that learns does not wait for its last rounds. At least as many episodes are open
            as by default, unless chains move in groups instead of all at once. The setting is part
            of the campaign's identity, so that its episodes are the same for any number of workers.
            None: the method's default.
        scene_every: keep the scene of every n-th episode, besides the scenes of all failures.
        requirements: conditions that an episode must satisfy, the most important first; an episode
            that violates one of them is a failure. If absent: no collision.
        importance: requirement whose robustness guides searches in safe episodes, in place of the
            requirements' robustness; episodes need not satisfy it. It changes how soon failures are
            found, but not which episodes are failures.
        priority: weight of the campaign when workers are shared, and its place in the queue. It may
            be changed later, and does not change episodes.
        planner_version: version of the planner, such as a commit. Specs with different versions are
            different campaigns, even if nothing else differs.
        project: project that the campaign belongs to; not part of the campaign's identity.
        tags: search words for the campaign; not part of the campaign's identity.
    """

    name: Annotated[
        Name,
        LabelField(help="Name of the campaign in lists.", section=Section.CAMPAIGN),
    ]
    method: Annotated[Name, SpecField(help="Search method that chooses the disturbances.")]
    episodes: Annotated[
        int,
        msgspec.Meta(ge=1, le=MAX_EPISODES),
        SpecField(
            help="The budget: every simulated episode counts.",
            section=Section.CAMPAIGN,
            label="episodes",
        ),
    ]
    seed: Annotated[
        int,
        msgspec.Meta(ge=0, le=MAX_SEED),
        SpecField(
            help="Equal campaigns with equal seeds have equal episodes.",
            section=Section.CAMPAIGN,
            label="seed",
        ),
    ] = 0
    # msgspec copies an empty default for each value, as a dataclass would not.
    settings: Settings = {}
    scenario: Annotated[Name, SpecField(help="The road, the actors and the goal.")] = "cut_in"
    scenario_parameters: Annotated[
        Settings,
        SpecField(help='As JSON: {"steps": 100}, "dt_s" if it is not 0.1, and its own.'),
    ] = {}
    planner: Annotated[Name, SpecField(help="The system under test.")] = "rulebook"
    planner_settings: Annotated[
        Settings,
        SpecField(help="As JSON: those of the planner, as eigenfail doctor --bridge lists them."),
    ] = {}
    simulator: Annotated[Name, SpecField(help="What moves the vehicles.", label="simulator")] = (
        "highway"
    )
    disturbance: DisturbanceModel = DisturbanceModel()
    stop: StopRules = StopRules()
    parallel: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=MOST_PARALLEL)] | None,
        SpecField(
            help="Number of workers to keep busy: at least as many episodes are open as they need. "
            "None: what the method keeps open by itself.",
            section=Section.CAMPAIGN,
            label="workers to keep busy",
        ),
    ] = None
    price_usd_per_hour: Annotated[
        float,
        msgspec.Meta(ge=0.0, le=100_000.0),
        LabelField(help="Price of one instance.", section=Section.RECORDS, label="price [USD/h]"),
    ] = 1.20
    instances: Annotated[
        int,
        msgspec.Meta(ge=1, le=100_000),
        LabelField(
            help="Number of instances that the campaign occupies while it runs.",
            section=Section.RECORDS,
            label="instances",
        ),
    ] = 1
    scene_every: Annotated[
        int,
        msgspec.Meta(ge=1, le=MAX_EPISODES),
        LabelField(
            help="Besides all failures, the scene of every n-th episode is kept.",
            section=Section.RECORDS,
            label="scene kept every",
        ),
    ] = 50
    priority: Annotated[
        Priority,
        LabelField(
            help="Share of the workers beside other campaigns, and place in the queue.",
            section=Section.RECORDS,
        ),
    ] = Priority.NORMAL
    # Absent from texts, keys and digests where it is not given, as there was no such field once.
    requirements: Annotated[
        Requirements | msgspec.UnsetType,
        SpecField(
            help='What an episode must satisfy, as JSON: [{"kind": "time_headway"}]. Left out, no '
            "collision is required.",
            section=Section.CAMPAIGN,
        ),
    ] = msgspec.UNSET
    importance: Annotated[
        AnyRequirement | msgspec.UnsetType,
        SpecField(
            help='What searches follow in place of the requirements, as JSON: {"kind": "measure", '
            '"measure": "max_drac_mps2", "at_most": 7}.',
            section=Section.CAMPAIGN,
        ),
    ] = msgspec.UNSET
    planner_version: Annotated[
        PlannerVersion | msgspec.UnsetType,
        LabelField(
            help="Version of the planner, such as a commit: letters, digits and . _ + / -.",
            section=Section.CAMPAIGN,
        ),
    ] = msgspec.UNSET
    project: Annotated[
        Project | msgspec.UnsetType,
        LabelField(help="Project that the campaign belongs to.", section=Section.CAMPAIGN),
    ] = msgspec.UNSET
    tags: Annotated[
        Annotated[tuple[Tag, ...], msgspec.Meta(max_length=MOST_TAGS)] | msgspec.UnsetType,
        LabelField(help="Words by which campaigns are found.", section=Section.CAMPAIGN),
    ] = msgspec.UNSET

    @property
    def named_requirements(self) -> tuple[AnyRequirement, ...]:
        """The named requirements; empty if the only requirement is the default, no collision."""
        return () if isinstance(self.requirements, msgspec.UnsetType) else self.requirements

    @property
    def all_requirements(self) -> tuple[AnyRequirement, ...]:
        """The requirements, including the default one if none is named."""
        return self.named_requirements or COLLISION_ALONE

    @property
    def fails_by_collision_alone(self) -> bool:
        """True if the absence of a collision is the only requirement."""
        return self.all_requirements == COLLISION_ALONE

    @property
    def version(self) -> str:
        """The version of the planner; empty if none is given."""
        return "" if isinstance(self.planner_version, msgspec.UnsetType) else self.planner_version

    @property
    def all_tags(self) -> tuple[str, ...]:
        """The tags; none if none are given."""
        return () if isinstance(self.tags, msgspec.UnsetType) else self.tags

    def is_like(self, other: "CampaignSpec") -> bool:
        """Return whether both specs describe the same campaign, at any priority.

        Projects and tags do not count.

        Two spellings that a service uses for stored specs make no difference: channels that are
        written out, and "no collision" as the only named requirement.
        """
        # Everything that does not count is made equal, so that a new field counts by itself.
        like = {
            "priority": other.priority,
            "project": other.project,
            "tags": other.tags,
            "disturbance": other.disturbance,
            "requirements": other.requirements,
        }
        return (
            msgspec.structs.replace(self, **like) == other
            and self.all_requirements == other.all_requirements
            and self.disturbance.is_like(other.disturbance)
        )

    def setup(self) -> EpisodeSetup:
        """Return the setup that all episodes of the campaign share."""
        return EpisodeSetup(
            simulator=self.simulator,
            scenario=self.scenario,
            scenario_parameters=self.scenario_parameters,
            planner=self.planner,
            planner_settings=self.planner_settings,
            disturbance=self.disturbance,
            scene_every=self.scene_every,
            requirements=self.requirements,
            importance=self.importance,
        )


SPEC_FIELDS: Mapping[str, SpecField] = {
    field.name: description
    for field in structs.fields(CampaignSpec)
    for description in getattr(field.type, "__metadata__", ())
    if isinstance(description, SpecField)
}
"""Descriptions by field name, in the order of the fields."""
