"""Results of gates: each report once, with its event in the log and in the outbox."""

import hashlib

import msgspec
from msgspec.structs import replace
from sqlalchemy import Connection, RowMapping, insert, select
from sqlalchemy.exc import IntegrityError

from eigenfail.gate.report import GateReport, MemberReport
from eigenfail.gate.results import GateResult, GateSummary, make_result, summarise_report
from eigenfail.gate.verdicts import GateVerdict
from eigenfail.values import Page
from eigenfail.values.webhooks import WebhookEvent
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.errors import make_gate_error
from eigenfail_services.store.events import append_event, describe_gate
from eigenfail_services.store.outbox import queue_gate_failure
from eigenfail_services.store.schema import gates

_SUMMARY = tuple(
    column for column in gates.c if column is not gates.c.report and column is not gates.c.digest
)

_reports = msgspec.json.Decoder(GateReport)
_counts = msgspec.json.Decoder(dict[GateVerdict, int])


class GateStore:
    """Results of gates, which never change."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def record(self, report: GateReport) -> GateSummary:
        """Store a report, log its verdict, and tell webhooks of a gate that is closed.

        A report that is stored already is returned as it is, and told once, also where the file of
        the suite, the links or the matched modes differ.
        """
        try:
            with self._database.writing() as connection:
                return _record_once(connection, report)
        except IntegrityError:
            # Another request stored the report at the same time: now it can be read.
            with self._database.writing() as connection:
                return _record_once(connection, report)

    def get(self, gate: int) -> GateResult:
        """Return the result of a gate.

        Raises:
            NotFound: no such result.
        """
        query = select(gates.c.id, gates.c.created_ms, gates.c.report).where(gates.c.id == gate)
        with self._database.reading() as connection:
            found = connection.execute(query).one_or_none()
        if found is None:
            raise make_gate_error(gate)
        return make_result(_reports.decode(found.report), found.id, found.created_ms)

    def page(self, limit: int, before: int | None = None) -> Page[GateSummary]:
        """Return results without their reports, newest first, with ids below `before`."""
        query = select(*_SUMMARY).order_by(gates.c.id.desc()).limit(limit + 1)
        if before is not None:
            query = query.where(gates.c.id < before)
        with self._database.reading() as connection:
            found = [_to_summary(row) for row in connection.execute(query).mappings()]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)


def _record_once(connection: Connection, report: GateReport) -> GateSummary:
    digest = _digest_judged(report)
    query = select(*_SUMMARY).where(gates.c.digest == digest)
    if (known := connection.execute(query).mappings().one_or_none()) is not None:
        return _to_summary(known)
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
    summary = _to_summary(connection.execute(statement.returning(*_SUMMARY)).mappings().one())
    queue_gate_failure(connection, summary.id, report)
    append_event(connection, _choose_kind(report), describe_gate(report))
    return summary


def _choose_kind(report: GateReport) -> str:
    """Return the kind of the event of a report."""
    if not report.gate.baseline:
        return "gate.baseline"
    return "gate.passed" if report.open else WebhookEvent.GATE_FAILED.value


def _digest_judged(report: GateReport) -> str:
    """Return the SHA-256 of the judgements in a report, as a hexadecimal number.

    The file of the suite and the links depend on where the command was run, and the matched modes
    on other campaigns of the service: the same gate is the same result whatever they are.
    """
    judged = replace(
        report,
        gate=replace(report.gate, file=""),
        members=tuple(map(_remove_links, report.members)),
        matched=(),
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


def _to_summary(found: RowMapping) -> GateSummary:
    values = dict(found)
    return GateSummary(counts=_counts.decode(values.pop("counts")), **values)
