"""A report as a whole: its sections in reading order, and its files.

Each function in `PARTS` takes the `Material` and returns a `ReportPart`, or None if there is
nothing to say.
"""

import io
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property

from eigenfail.presentation.svg import draw_svg
from eigenfail.wire.http import encode
from eigenfail_reports import (
    causes,
    costs,
    courses,
    evidence,
    failure_modes,
    foreign_sections,
    outcomes,
    seeds,
    triage,
)
from eigenfail_reports import material as materials
from eigenfail_reports.contents import Report
from eigenfail_reports.material import Material
from eigenfail_reports.page import ReportPart, page, to_csv
from eigenfail_services.store.store import Store

MakePart = Callable[[Material], ReportPart | None]

PARTS: tuple[MakePart, ...] = (
    outcomes.make_results,
    seeds.make_over_seeds,
    outcomes.make_setup,
    courses.make_safety,
    courses.make_learning,
    courses.make_likelihood,
    costs.make_cost,
    failure_modes.make_modes,
    triage.make_triage,
    failure_modes.make_eigenfailures,
    evidence.make_proof,
    costs.make_minimal,
    causes.make_collisions,
    causes.make_influence,
    evidence.make_variance,
    evidence.make_training,
)
"""The sections of this package. Those of other plug-ins follow, and provenance ends a report."""

PAGE, DATA = "report.html", "report.json"


LONG_AGO = (1980, 1, 1, 0, 0, 0)


class Made:
    """A report, and how people see its sections."""

    def __init__(self, report: Report, parts: tuple[ReportPart, ...]) -> None:
        self.report = report
        self._parts = parts

    @cached_property
    def drawn(self) -> Mapping[str, str]:
        """An SVG file for each picture, by name."""
        drawn = {}
        for part in self._parts:
            for picture, drawing in part.pictures:
                drawn[picture.name] = draw_svg(
                    picture.name, picture.title, picture.alternative, drawing
                )
        return drawn

    def json(self) -> bytes:
        """Its data."""
        return encode(self.report)

    def html(self) -> bytes:
        """One page that needs nothing else."""
        return page(self.report, self._parts, self.drawn)

    def bundle(self) -> bytes:
        """A zip file of everything; the same bytes for the same report."""
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as bundle:
            for name, content in self._files():
                bundle.writestr(zipfile.ZipInfo(name, LONG_AGO), content, zipfile.ZIP_DEFLATED)
        return file.getvalue()

    def _files(self) -> Iterator[tuple[str, bytes]]:
        yield PAGE, self.html()
        yield DATA, self.json()
        for table in self.report.tables:
            yield f"tables/{table.name}.csv", to_csv(table)
        for name, svg in self.drawn.items():
            yield f"pictures/{name}.svg", svg.encode()


def make(store: Store, campaigns: Sequence[int], made_ms: int) -> Made:
    """A report on these campaigns as they stand.

    Args:
        store: store of the campaigns.
        campaigns: their ids, in the order of the report.
        made_ms: now.

    Raises:
        InvalidValue: no campaign, too many, or one that is named twice.
        NotFound: no such campaign.
    """
    material = materials.gather_material(store, campaigns)
    parts = tuple(list_parts(material))
    ids = " ".join(map(str, campaigns))
    report = Report(
        title=title_report(material),
        made_ms=made_ms,
        command=f"eigenfail report {ids}",
        warnings=tuple(materials.list_unfinished(material)),
        campaigns=tuple(subject.campaign for subject in material.subjects),
        sections=tuple(part.section for part in parts),
    )
    return Made(report, parts)


def list_parts(material: Material) -> Iterator[ReportPart]:
    """Yield the sections that have something to say."""
    taken: set[str] = {"provenance"}
    for make_part in PARTS:
        if part := make_part(material):
            taken |= {part.name, *(table.name for table in part.tables)}
            yield part
    yield from foreign_sections.make_foreign_parts(material, taken)
    yield outcomes.make_provenance(material)


def title_report(material: materials.Material) -> str:
    """Return the title of the report."""
    names = [subject.campaign.spec.name for subject in material.subjects]
    return f"Search for failures: {names[0] if len(names) == 1 else f'{len(names)} campaigns'}"
