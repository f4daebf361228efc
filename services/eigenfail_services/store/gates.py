"""Results of gates: each report once, with its event in the log."""

import hashlib

import msgspec
from msgspec.structs import replace
from sqlalchemy import Connection, insert, select

from eigenfail.errors import NotFound
from eigenfail.gate.report import GateReport, MemberReport
from eigenfail.gate.results import GateResult, GateSummary, make_result, summarise_report
from eigenfail.values.records import Page
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.events import EventSubject, append_event
from eigenfail_services.store.schema import gates

_SUMMARIES = StructRows(gates, GateSummary, {"counts": msgspec.json.decode})

_reports = msgspec.json.Decoder(GateReport)


class GateStore(StorePart):
    """Results of gates, which never change."""

    def record(self, report: GateReport) -> GateSummary:
        """Store a report, and log its verdict.

        A report that is stored already is returned unchanged and not logged again, even if the file
        of the suite or the links differ.
        """
        return self._database.write_once(_record_once, report)

    def get(self, gate: int) -> GateResult:
        """Return the result of a gate.

        Raises:
            NotFound: no such result.
        """
        query = select(gates.c.id, gates.c.created_ms, gates.c.report).where(gates.c.id == gate)
        with self._database.reading() as connection:
            found = connection.execute(query).one_or_none()
        if found is None:
            raise NotFound(f"Gate {gate} does not exist.", "`eigenfail gate list` lists them.")
        return make_result(_reports.decode(found.report), found.id, found.created_ms)

    def page(self, limit: int, before: int | None = None) -> Page[GateSummary]:
        """Return results without their reports, newest first, with ids below `before`."""
        return self._database.read(_SUMMARIES.page, limit, before)


def _record_once(connection: Connection, report: GateReport) -> GateSummary:
    # By content, not by an id of the caller: a pipeline that is run again sends the same report.
    digest = _digest_judged(report)
    query = select(*_SUMMARIES.columns).where(gates.c.digest == digest)
    if (known := _SUMMARIES.first(connection, query)) is not None:
        return known
    made = summarise_report(report, 0, now_ms())
    statement = insert(gates).values(
        created_ms=made.created_ms,
        digest=digest,
        suite=made.suite,
        version=made.version,
        run=made.run,
        baseline=made.baseline,
        open=made.open,
        counts=msgspec.json.encode(made.counts).decode(),
        conclusion=made.conclusion,
        report=msgspec.json.encode(report).decode(),
    )
    (summary,) = _SUMMARIES.list(connection, statement.returning(*_SUMMARIES.columns))
    kind, message = _describe_verdict(report)
    append_event(connection, kind, message, subject=EventSubject(summary.id))
    return summary


def _describe_verdict(report: GateReport) -> tuple[str, str]:
    """Return kind and message of the event of a report."""
    gate = report.gate
    if not gate.baseline:
        return "gate.baseline", f"Version {gate.version} is a baseline of suite '{gate.suite}'."
    verdict = "passed" if report.open else "did not pass"
    against = f"suite '{gate.suite}' against {gate.baseline}"
    message = f"Version {gate.version} {verdict} the gate of {against}."
    return "gate.passed" if report.open else "gate.failed", message


def _digest_judged(report: GateReport) -> str:
    """Return the SHA-256 of the judgements in a report, as a hexadecimal number.

    The file of the suite and the links depend on the place of the command: the same gate has the
    same digest whatever they are.
    """
    judged = replace(
        report,
        gate=replace(report.gate, file=""),
        members=tuple(map(_remove_links, report.members)),
    )
    return hashlib.sha256(msgspec.json.encode(judged, order="deterministic")).hexdigest()


def _remove_links(member: MemberReport) -> MemberReport:
    rerun = member.rerun
    if rerun is not None:
        findings, new_modes = (
            tuple(replace(each, link="") for each in group)
            for group in (rerun.findings, rerun.new_modes)
        )
        rerun = replace(rerun, findings=findings, new_modes=new_modes)
    known = tuple(replace(each, link="") for each in member.known)
    return replace(member, known=known, rerun=rerun)
