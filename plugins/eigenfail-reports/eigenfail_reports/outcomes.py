"""The first sections of a report: results, set-up and provenance."""

import platform
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import msgspec

from eigenfail import __version__, plugins
from eigenfail.errors import InputError
from eigenfail.presentation import figures
from eigenfail.presentation.rates import FAILED_SHARE, NO_ESTIMATE
from eigenfail.presentation.tables import format_cell, format_cost
from eigenfail.settings import defaults_of
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.estimates import Rate
from eigenfail.worlds import describe_disturbance, describe_requirements, world_of
from eigenfail_reports import page
from eigenfail_reports.contents import OWN_EPISODES, Cell
from eigenfail_reports.material import Material, Subject
from eigenfail_services.comparison.sides import warn_of_seeds
from eigenfail_services.store.schema import VERSION

RESULTS_COLUMNS = (
    ("campaign", "Campaign"),
    ("name", "Name"),
    ("method", "Method"),
    ("planner", "Planner"),
    ("scenario", "Scenario"),
    ("state", "State"),
    ("n", "Episodes completed"),
    ("failures", "Failures"),
    ("failure_rate", FAILED_SHARE, "share"),
    ("failure_rate_low", "from", "share"),
    ("failure_rate_high", "to", "share"),
    ("horizon", "Horizon", "s"),
    ("unresolved", "Unresolved at the horizon"),
    ("cost_per_failure", "Cost per failure", "USD"),
    ("cost_per_failure_low", "from", "USD"),
    ("cost_per_failure_high", "to", "USD"),
    ("cost_per_failure_at_least", "Cost per failure at least", "USD"),
    ("cost", "Cost", "USD"),
    ("instance_hours", "Instance-hours", "h"),
    ("log_p_per_step", "log p per step of the failures", "nat"),
    ("log_p", "Mean log p of the failures", "nat"),
    ("severity", "Mean severity", "m²/s²"),
    ("probability", "Failure probability"),
    ("probability_low", "from"),
    ("probability_high", "to"),
    ("probability_at_least", "Failure probability at least"),
    ("probability_cv", "Coefficient of variation"),
    ("probability_n", "Episodes it rests on"),
    ("probability_by", "Found by"),
    ("probability_problem", "Why it is not given"),
    ("probability_note", "Limitations"),
    ("episodes_per_s", "Episodes per second", "1/s"),
    ("active_s", "Time running", "s"),
)


RATE_ON_ROADS = (
    "A failure rate is the share of completed episodes with a failure within the horizon, a "
    "collision or the violation of a requirement that its campaign names, where episodes are drawn "
    "from p(x); the share of the episodes that a search chose is none."
)
RATE_OF_FUNCTIONS = (
    "The failure rate of a function is the share of completed episodes in which its answer, the "
    "robustness, is 0 or less, where episodes are drawn from p(x)."
)
INTERVALS = "Intervals are 95 % confidence intervals."
SEVERITY = "Severity is ‖v_ego − v_actor‖² at the collision."
LIKELIHOOD = (
    "log p is the log-density of the injected noise; per step it can be compared between episodes "
    "of different length, and higher is likelier."
)


def describe_columns(material: Material) -> str:
    """Return how to read the results of the kinds of campaigns in a report."""
    return " ".join(
        (
            material.pick_words(RATE_ON_ROADS, RATE_OF_FUNCTIONS),
            INTERVALS,
            *([SEVERITY] if material.has_roads else []),
            LIKELIHOOD,
            f"Cost is that of computing{', not of collisions' if material.has_roads else ''}.",
        )
    )


def make_results(material: Material) -> page.ReportPart:
    """The results side by side."""
    subjects = material.subjects
    return page.ReportPart(
        name="results",
        title="Results",
        words=(
            *map(describe_outcome, subjects),
            *warn_of_seeds([s.campaign for s in subjects]),
            describe_columns(material),
        ),
        tables=(
            page.make_table(
                "results",
                "Results of the campaigns",
                RESULTS_COLUMNS,
                [*map(list_results, subjects)],
            ),
        ),
        grids={"results": page.make_comparison_grids(subjects, choose_figures(material))},
    )


def list_results(subject: Subject) -> tuple[Cell, ...]:
    """The numbers of a campaign."""
    campaign, summary = subject.campaign, subject.summary
    spec = campaign.spec
    return (
        campaign.id,
        spec.name,
        spec.method,
        spec.planner,
        spec.scenario,
        campaign.state_word,
        summary.counts.completed,
        summary.counts.failures,
        *rate_cells(subject),
        *make_cost_cells(subject),
        summary.log_probability_per_step,
        summary.mean_log_probability,
        summary.mean_severity,
        *make_probability_cells(subject),
        summary.episodes_per_s,
        campaign.active_s,
    )


def list_bounds(rate: Rate) -> tuple[float | None, float | None]:
    """Return both ends of the interval of a rate; None for the episodes of a search."""
    bounds = rate.interval
    return (None, None) if bounds is None else (bounds.low, bounds.high)


def rate_cells(subject: Subject) -> tuple[Cell, ...]:
    """The failure rate with its interval and time limit, and episodes that ended too early."""
    rate, ended = subject.summary.failure_rate, subject.summary.unresolved
    bounds = (rate.value, *list_bounds(rate)) if rate else (None,) * 3
    # No episode of a function could end before a collision that is certain.
    return (*bounds, ended.horizon_s, ended.count if subject.has_road else None)


def make_cost_cells(subject: Subject) -> tuple[Cell, ...]:
    """Return the cost per failure and the total cost."""
    cost = subject.summary.cost
    bounds = (cost.interval_usd.low, cost.interval_usd.high) if cost.interval_usd else (None, None)
    per_failure = (cost.per_failure_usd, *bounds, cost.at_least_usd)
    return (*per_failure, cost.total_usd, cost.instance_hours)


def make_probability_cells(subject: Subject) -> tuple[Cell, ...]:
    """Return the failure probability, or the reason why there is none."""
    found, rate = subject.summary.estimate, find_sampled_rate(subject)
    if rate is not None:
        basis = (None, rate.n, BY_RATE, NO_ESTIMATE if rate.value is None else "")
        return (rate.value, *list_bounds(rate), None, *basis, subject.summary.rate_note)
    if found is None:
        return (None,) * 9
    basis_of_estimate = (found.cv, found.episodes, found.by, found.problem, found.note)
    return (*page.list_probability(found), *basis_of_estimate)


BY_RATE = "failure rate of episodes drawn from p(x)"


def find_sampled_rate(subject: Subject) -> Rate | None:
    """Return the failure rate if it is the failure probability under p(x); None otherwise.

    This holds if the episodes are drawn from p(x) and the method gives no estimate.
    """
    rate = subject.summary.failure_rate
    is_probability = rate is not None and rate.sampled and subject.summary.estimate is None
    return rate if is_probability else None


def show_probability(subject: Subject) -> tuple[str, ...]:
    """Return the failure probability as text, with a remark if it is a failure rate."""
    rate = find_sampled_rate(subject)
    if rate is None:
        return format_cell(subject.summary.estimate).lines
    return (*format_cell(rate).lines, BY_RATE)


def describe_outcome(subject: Subject) -> str:
    """Return the findings of a campaign as a sentence."""
    summary, spec = subject.summary, subject.campaign.spec
    who = f"Campaign {subject.id}, {spec.name} ({spec.method}, {spec.planner} in {spec.scenario})"
    rate = summary.failure_rate
    if rate is None:
        return f"{who}: {summary.remark or 'no episode has ended yet.'}"
    if not rate.k:
        found = f"no failure in {rate.n:,} episodes; {price(subject)}."
        return f"{who}: {found} {summary.remark}".strip()
    found = f"{rate.k:,} failures in {rate.n:,} episodes"
    sure = (
        OWN_EPISODES
        if rate.interval is None
        else f"(95 %: {figures.format_percent_interval(rate.interval)})"
    )
    share = f"{figures.format_share(rate.value)} {sure}" if rate.value is not None else sure
    return f"{who}: {found}, {share}; {price(subject)}. {summary.remark}".strip()


def price(subject: Subject) -> str:
    """The cost of a failure, or a lower bound of it."""
    cost = format_cost(subject.summary.cost)
    if subject.summary.counts.failures:
        return f"a failure cost {cost.value}{f' (95 %: {cost.interval})' if cost.interval else ''}"
    if subject.summary.cost.at_least_usd is None:
        return f"{figures.format_money(subject.summary.cost.total_usd)} were spent"
    return f"a failure costs at least {cost.value.removeprefix('≥ ')} (95 %)"


def describe_basis(subject: Subject) -> str:
    """Return the number of failures behind a mean."""
    return f"n = {figures.format_count(subject.summary.counts.failures)}"


SEVERITY_FIGURE = "Mean severity of the collisions [m²/s²]"


FIGURES: Mapping[str, Callable[[Subject], tuple[str, ...]]] = {
    "Method": lambda s: (s.campaign.spec.method,),
    "State": lambda s: (s.campaign.state_word,),
    "Episodes completed": lambda s: (figures.format_count(s.summary.counts.completed),),
    "Failures": lambda s: (figures.format_count(s.summary.counts.failures),),
    FAILED_SHARE: lambda s: format_cell(s.summary.failure_rate).lines,
    "Cost per failure": lambda s: format_cost(s.summary.cost).lines,
    "Cost": lambda s: (
        figures.format_money(s.summary.cost.total_usd),
        f"{figures.format_number(s.summary.cost.instance_hours)} instance-hours",
    ),
    "log p per step of the failures [nat]": lambda s: (
        figures.format_number(s.summary.log_probability_per_step),
        describe_basis(s),
    ),
    SEVERITY_FIGURE: lambda s: (
        (figures.format_number(s.summary.mean_severity), f"n = {s.summary.conflicts.collisions:,}")
        if s.has_road
        else (figures.UNKNOWN,)
    ),
    "Failure probability under p(x)": show_probability,
    "Episodes per second": lambda s: (figures.format_number(s.summary.episodes_per_s),),
}


def choose_figures(material: Material) -> Mapping[str, Callable[[Subject], tuple[str, ...]]]:
    """Return the rows of the table: no severity if every campaign has a function."""
    if material.has_roads:
        return FIGURES
    return {name: figure for name, figure in FIGURES.items() if name != SEVERITY_FIGURE}


SETUP, DEFAULTS = "setup", "defaults"


SETUP_COLUMNS = (("campaign", "Campaign"), ("setting", "Setting"), ("value", "Value"))


DEFAULT_COLUMNS = (
    ("kind", "Kind"),
    ("plugin", "Plug-in"),
    ("setting", "Setting"),
    ("default", "Default"),
)


ON_ROADS = (
    "A campaign searches with one method for disturbances under which one planner collides. A "
    "disturbance is an error of what the planner perceives at every step: of the position of the "
    "nearest vehicle, unless the campaign names other channels. a_t = σ_t · u_t, with |dx| and "
    "|dy| the true distances along and across the road, and d the distance of a channel."
)
OF_FUNCTIONS = (
    "A campaign on a function searches with one method for noise under which the function fails: "
    "its answer, the robustness, is 0 or less. Its noise, at every step and in every channel, is "
    "a = σ · u, with σ the scale of the disturbance model, and u made of independent standard "
    "normal z by the shape of the model."
)
NOT_LISTED = "Settings that are not listed here had their defaults, which stand below."


KINDS = {
    "scenario": (plugins.SCENARIOS, "Parameters"),
    "planner": (plugins.PLANNERS, "Settings"),
    "method": (plugins.METHODS, "Settings"),
}


class Setting(NamedTuple):
    """One thing that was asked for."""

    name: str
    value: str


def make_setup(material: Material) -> page.ReportPart:
    """Return the settings of the campaigns side by side, followed by defaults."""
    found = {
        subject.id: dict(list_campaign_settings(subject.campaign)) for subject in material.subjects
    }
    rows = [(id_, name, value) for id_, of in found.items() for name, value in of.items()]
    unset = [*list_default_rows([subject.campaign.spec for subject in material.subjects])]
    facts = {id_: {name: (value,) for name, value in of.items()} for id_, of in found.items()}
    return page.ReportPart(
        name="setup",
        title="Set-up",
        words=(f"{material.pick_words(ON_ROADS, OF_FUNCTIONS)} {NOT_LISTED}",),
        tables=(
            page.make_table(SETUP, "What was asked for", SETUP_COLUMNS, rows),
            page.make_table(DEFAULTS, "Defaults of this release", DEFAULT_COLUMNS, unset),
        ),
        grids={SETUP: page.make_named_grids(material.subjects, facts)},
        folded=frozenset({DEFAULTS}),
    )


def list_campaign_settings(campaign: Campaign) -> Iterator[Setting]:
    """Return the specification of a campaign, and why it ended."""
    spec = campaign.spec
    yield Setting("Scenario", spec.scenario)
    yield from list_given_settings("Scenario", spec.scenario_parameters)
    yield Setting("Planner", spec.planner)
    if spec.version:
        yield Setting("Planner: version", spec.version)
    yield from list_given_settings("Planner", spec.planner_settings)
    yield Setting("Simulator", spec.simulator)
    for name, value in describe_disturbance(spec).items():
        yield Setting(f"Disturbance: {name}", value)
    for name, value in describe_requirements(spec).items():
        yield Setting(name.capitalize(), value)
    yield Setting("Method", spec.method)
    yield from list_given_settings("Method", spec.settings)
    yield Setting("Seed", str(spec.seed))
    yield Setting("Budget [episodes]", str(spec.episodes))
    for name, limit in spec.stop.given().items():
        yield Setting(f"Stops at {name}", str(limit))
    yield Setting("Price [USD per instance-hour]", str(spec.price_usd_per_hour))
    yield Setting("Instances", str(spec.instances))
    yield Setting("Ended because", campaign.stopped_because or f"it is {campaign.state}")


def list_given_settings(group: str, values: Mapping[str, Any]) -> Iterator[Setting]:
    """The settings of a plug-in that a user gave."""
    for name, value in iterate_leaves(values):
        yield Setting(f"{group}: {name}", value)


def list_default_rows(specs: list[CampaignSpec]) -> Iterator[tuple[Cell, ...]]:
    """Yield the defaults of every plug-in that was used, each plug-in once."""
    used = dict.fromkeys(
        (kind, str(getattr(spec, kind)))
        for kind in KINDS
        for spec in specs
        if kind == "method" or kind in world_of(spec.simulator).plugin_fields
    )
    for kind, plugin in used:
        for name, value in iterate_leaves(find_plugin_defaults(kind, plugin)):
            yield (kind, plugin, name, value)


def find_plugin_defaults(kind: str, plugin: str) -> dict[str, Any]:
    """Return the default settings of a plug-in; none if it is not installed here."""
    group, attribute = KINDS[kind]
    try:
        return defaults_of(getattr(plugins.load(group, plugin), attribute))
    except InputError:
        return {}


def iterate_leaves(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    """Yield each value of nested settings with its dotted name, as text."""
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from iterate_leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", format_setting(value)


def format_setting(value: Any) -> str:
    """A setting as it would be written in a file."""
    if value is None:
        return figures.UNKNOWN
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()


PACKAGES = (
    "numpy",
    "scipy",
    "scikit-learn",
    "torch",
    "stable-baselines3",
    "highway-env",
    "osqp",
    "ray",
    "msgspec",
    "sqlalchemy",
    "matplotlib",
)


PROGRAM_COLUMNS = (("thing", "Thing"), ("version", "Version"))


EVIDENCE_COLUMNS = (
    ("campaign", "Campaign"),
    ("name", "Name"),
    ("seed", "Seed"),
    ("digest", "Digest of all results (SHA-256)"),
    ("analysis", "Analysis"),
)


TIME_COLUMNS = (
    ("campaign", "Campaign"),
    ("created", "Created"),
    ("started", "Started"),
    ("ended", "Ended"),
    ("active_s", "Time running", "s"),
)


REPEATABLE = (
    "Everything random in an episode follows from the campaign's seed and the episode's number: "
    "the same set-up and seed give the same episodes, and so the same digest, with one worker or "
    "many. To check a campaign, run its set-up again and compare the digests."
)


WHOSE = (
    "Versions of programs are those of the service that made this report; workers elsewhere may "
    "have had others. Which code they ran says its fingerprint, the first digits of a SHA-256 over "
    "the files of a package: the same where all of them are the same."
)


CODE_COLUMNS = (
    ("campaign", "Campaign"),
    ("planner", "Planner"),
    ("planner_version", "Version of the planner"),
    ("code", "Code of the workers"),
    ("package", "Package"),
    ("fingerprint", "Fingerprint"),
)


CODE_NOTE = (
    "Code of the workers is numbered: a campaign with a second number was run by workers with "
    "different code. No fingerprint: a function, a process behind a bridge, or workers of a "
    "release that recorded none."
)


def make_provenance(material: Material) -> page.ReportPart:
    """Return the facts that make the numbers traceable."""
    evidence = [*map(list_provenance, material.subjects)]
    return page.ReportPart(
        name="provenance",
        title="Provenance",
        words=(REPEATABLE, WHOSE),
        tables=(
            page.make_table("evidence", "Campaigns", EVIDENCE_COLUMNS, evidence),
            page.make_table(
                "code",
                "Planner and code that ran the episodes",
                CODE_COLUMNS,
                [row for each in material.subjects for row in list_code(each.campaign)],
                CODE_NOTE,
            ),
            page.make_table(
                "times", "When they ran", TIME_COLUMNS, [*map(list_time_cells, material.subjects)]
            ),
            page.make_table("programs", "Programs", PROGRAM_COLUMNS, [*list_programs()]),
        ),
    )


def list_provenance(subject: Subject) -> tuple[Cell, ...]:
    """Return the facts that identify the results of a campaign."""
    campaign = subject.campaign
    return (
        campaign.id,
        campaign.spec.name,
        campaign.spec.seed,
        campaign.digest or "not done",
        subject.analysis.id if subject.analysis else None,
    )


def list_code(campaign: Campaign) -> Iterator[tuple[Cell, ...]]:
    """Yield a row for each package that the workers of a campaign ran; one without if not known."""
    who = (campaign.id, campaign.spec.planner, campaign.spec.version or "not given")
    if not any(campaign.code):
        yield (*who, None, None, None)
    for number, code in enumerate(campaign.code, start=1):
        for package, digest in sorted(code.items()):
            yield (*who, number, package, digest)


def list_time_cells(subject: Subject) -> tuple[Cell, ...]:
    """Return the times of the campaign's changes of state."""
    campaign = subject.campaign
    moments = (campaign.created_ms, campaign.started_ms, campaign.ended_ms)
    return (campaign.id, *map(figures.format_utc, moments), campaign.active_s)


def list_programs() -> tuple[tuple[Cell, ...], ...]:
    """Return names and versions of the programs."""
    return (
        ("eigenfail", __version__),
        ("schema of the database", VERSION),
        ("Python", platform.python_version()),
        *((name, read_version(name)) for name in PACKAGES),
    )


def read_version(name: str) -> str:
    """The version of a package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
