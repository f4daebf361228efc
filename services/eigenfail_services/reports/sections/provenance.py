"""Where the numbers come from: programs, schema, seeds, digests."""

import platform
from importlib.metadata import PackageNotFoundError, version

from eigenfail import __version__
from eigenfail.values.report import Cell, ReportSection
from eigenfail_services.reports import formats
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.parts import Part, table
from eigenfail_services.store.schema import VERSION

PACKAGES = (
    *("numpy", "scipy", "scikit-learn", "torch", "stable-baselines3", "highway-env", "osqp"),
    *("ray", "msgspec", "sqlalchemy", "matplotlib"),
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
    "Versions are those of the service that made this report; workers elsewhere may have had "
    "others."
)


def part(material: Material) -> Part:
    """What is needed to trace the numbers back."""
    evidence = [*map(row, material.subjects)]
    section = ReportSection(
        name="provenance",
        title="Provenance",
        words=(REPEATABLE, WHOSE),
        tables=(
            table("evidence", "Campaigns", EVIDENCE_COLUMNS, evidence),
            table("times", "When they ran", TIME_COLUMNS, [*map(times, material.subjects)]),
            table("programs", "Programs", PROGRAM_COLUMNS, [*programs()]),
        ),
    )
    return Part(section)


def row(subject: Subject) -> tuple[Cell, ...]:
    """What tells the results of a campaign from all others."""
    campaign = subject.campaign
    return (
        *(campaign.id, campaign.spec.name, campaign.spec.seed),
        campaign.digest or "not done",
        subject.analysis.id if subject.analysis else None,
    )


def times(subject: Subject) -> tuple[Cell, ...]:
    """When what happened."""
    campaign = subject.campaign
    moments = (campaign.created_ms, campaign.started_ms, campaign.ended_ms)
    return (campaign.id, *map(formats.moment, moments), campaign.active_s)


def programs() -> tuple[tuple[Cell, ...], ...]:
    """Names and versions."""
    return (
        ("eigenfail", __version__),
        ("schema of the database", VERSION),
        ("Python", platform.python_version()),
        *((name, installed(name)) for name in PACKAGES),
    )


def installed(name: str) -> str:
    """The version of a package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
