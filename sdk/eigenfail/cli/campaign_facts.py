"""One campaign, as it is printed: what was asked, how it stands, and its episodes by class."""

from collections.abc import Iterator

from rich.table import Table

from eigenfail.cli.figures import UNKNOWN, number, probability
from eigenfail.cli.moments import moment
from eigenfail.cli.tables import facts
from eigenfail.functions import disturbance_in_words
from eigenfail.values import Campaign, CampaignSpec, Conflicts, Counts, Estimate, MeanTime
from eigenfail.values.variation import in_words


def campaign_facts(campaign: Campaign) -> Table:
    """One campaign as it stands."""
    spec, counts = campaign.spec, campaign.counts
    rows = [
        ("campaign", f"{campaign.id}: {spec.name}"),
        ("state", " ".join(filter(None, (campaign.state, campaign.stopped_because)))),
        ("method", f"{spec.method} {spec.settings or ''}"),
        ("scenario", " ".join((spec.scenario, parameters(spec)))),
        ("planner", f"{spec.planner} {spec.planner_settings or ''}"),
        ("simulator", f"{spec.simulator}, seed {spec.seed}"),
        ("disturbance", "; ".join(map(" ".join, disturbance_in_words(spec).items()))),
        ("budget", f"{spec.episodes} episodes{rules(spec)}"),
        ("priority", spec.priority),
        ("episodes", ", ".join(episodes(counts))),
        ("failures", str(counts.failures)),
        *estimate_facts(campaign.estimate),
        *training_facts(campaign),
        ("created", moment(campaign.created_ms)),
        ("active", f"{campaign.active_s:.1f} s"),
        ("digest", campaign.digest or UNKNOWN),
    ]
    return facts(rows)


def parameters(spec: CampaignSpec) -> str:
    """What was said of the scenario; a distribution in words."""
    said = in_words(spec.scenario_parameters).items()
    return ", ".join(f"{name} = {value}" for name, value in said)


def estimate_facts(estimate: Estimate | None) -> Iterator[tuple[str, str]]:
    """The failure probability with what it rests on, or why it is not told; nothing of none."""
    if estimate is None:
        return
    how = f"{probability(estimate)}, {estimate.by}, cv {number(estimate.cv)}"
    yield "P(failure)", how if estimate.probability is not None else f"unknown, {estimate.by}"
    if remark := estimate.problem or estimate.note:
        yield "", remark


def training_facts(campaign: Campaign) -> Iterator[tuple[str, str]]:
    """How many episodes were trained with; nothing where the method does not say."""
    if campaign.trained_episodes is not None:
        yield "trained with", f"{campaign.trained_episodes} episodes"


def rules(spec: CampaignSpec) -> str:
    """What may end a campaign before its budget is spent."""
    limits = [f"{name} = {limit}" for name, limit in spec.stop.given().items()]
    return f"; stops at {', '.join(limits)}" if limits else ""


def episodes(counts: Counts) -> Iterator[str]:
    """What became of a campaign's episodes."""
    yield f"{counts.completed} completed of {counts.planned}"
    yield f"{counts.failed} failed"
    if counts.cancelled:
        yield f"{counts.cancelled} not run"


def conflict_facts(campaign: Campaign, conflicts: Conflicts) -> Table:
    """The episodes of a campaign by class, and how early its collisions showed."""
    collisions, late = campaign.counts.failures, conflicts.unclassified
    classes = (
        f"{conflicts.unavoidable} unavoidable",
        f"{conflicts.planner_failures} planner failures",
        *([f"{late} not classified"] if late else []),
    )
    return facts(
        [
            ("collisions", f"{collisions} of {campaign.counts.completed}: {', '.join(classes)}"),
            ("near misses", f"{conflicts.near_misses} with MinTTC < 1.5 s"),
            (
                "mean lead time",
                f"{mean(conflicts.ttc_lead)} MinTTC, {mean(conflicts.drac_lead)} DRAC",
            ),
        ]
    )


def mean(time: MeanTime) -> str:
    """A mean time, and what it rests on."""
    return f"{number(time.mean_s)} s (n = {time.n})" if time.n else UNKNOWN
