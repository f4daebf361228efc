"""Checks of the results of gates: each report is kept once, as it was judged."""

from msgspec.structs import replace

from eigenfail.gate.report import GateReport, GateRun, MemberReport, build_report
from eigenfail.gate.reruns import GateFinding, JudgedBy, Rerun, RerunFigures
from eigenfail.gate.results import check_report
from eigenfail.gate.verdicts import GateVerdict
from eigenfail_services.store.store import Store
from store_checks.crowds import at_once
from store_checks.examples import equal


def make_report(*verdicts: GateVerdict, version: str = "v2", baseline: str = "v1") -> GateReport:
    """The report of a gate of one member, whose known failures have these verdicts."""
    known = tuple(
        GateFinding(
            verdict=each,
            what=f"medoid {place}, 1/{place}",
            was=f"1/{place}",
            mode=f"1/{place}",
            episode=f"3/{place}",
        )
        for place, each in enumerate(verdicts, start=1)
    )
    sides = [RerunFigures(campaign=n, completed=90, failures=5, errored=0) for n in (1, 2)]
    rerun = Rerun(
        before=sides[0],
        now=sides[1],
        method="cem",
        verdict=GateVerdict.STILL_FAILING,
        by=JudgedBy.RATE,
        words="5 of 90 fail, 5 of 90 did: a difference within the gate's threshold.",
        unpaired_because="Their noise depends on the planner.",
    )
    run = GateRun(
        suite="nightly",
        version=version,
        run=f"nightly @ {version}",
        baseline=baseline,
        file="nightly.toml",
    )
    compared = rerun if baseline else None
    member = MemberReport(member="cut-in", baseline=sides[0], known=known, rerun=compared)
    absent = MemberReport(member="merge", notes=("It is not in the baseline.",))
    return build_report(run, [member, absent])


def keeps_reports(store: Store) -> None:
    """A report comes back as it was sent, with its conclusions; lists have no reports."""
    reports = [make_report(GateVerdict.FIXED), make_report(GateVerdict.NEW, GateVerdict.FIXED)]
    made = [store.gates.record(each) for each in reports]
    for report, summary in zip(reports, made, strict=True):
        check_report(report)
        found = store.gates.get(summary.id)
        equal(found.report, report, "The report")
        equal(found.conclusions[0], summary.conclusion, "The verdict in a sentence")
        equal(found.created_ms, summary.created_ms, "When it came")
    equal([each.verdict for each in made], ["open", "closed"], "Verdicts")
    equal(made[1].counts, {"new": 1, "fixed": 1, "still failing": 1}, "Counts")
    page = store.gates.page(1)
    equal((page.items, page.next), ((made[1],), made[1].id), "The newest")
    equal(store.gates.page(9, made[1].id).items, (made[0],), "Older ones")


def keeps_a_report_once(store: Store) -> None:
    """The same report has one result and one event, also when it comes several times at once."""
    report = make_report(GateVerdict.NEW)
    found = at_once(lambda _: store.gates.record(report))
    equal(len({each.id for each in found}), 1, "Results")
    equal(len(store.gates.page(9).items), 1, "Results in the list")
    equal(len(store.events.latest(9)), 1, "Events")
    store.gates.record(make_report(GateVerdict.NEW, version="v3"))
    equal(len(store.gates.page(9).items), 2, "Results of two versions")


def keeps_a_gate_of_two_places_once(store: Store) -> None:
    """A gate from another folder or over another URL is the same result."""
    report = make_report(GateVerdict.NEW)
    first, *others = report.members
    known = tuple(replace(each, link="https://other.example/") for each in first.known)
    elsewhere = replace(
        report,
        gate=replace(report.gate, file="suites/nightly.toml"),
        members=(replace(first, known=known), *others),
    )
    made = [store.gates.record(each) for each in (report, elsewhere)]
    equal(made[1], made[0], "The same gate")
    equal(store.gates.get(made[0].id).report, report, "The report that came first")
    store.gates.record(replace(report, gate=replace(report.gate, strict=True)))
    equal(len(store.gates.page(9).items), 2, "Results with another setting")


def tells_no_verdict_of_a_baseline(store: Store) -> None:
    """A run that is compared with nothing is a baseline in the log, and no failed gate."""
    made = make_report(GateVerdict.STILL_FAILING, baseline="")
    strict = build_report(replace(made.gate, strict=True), made.members)
    for report in (make_report(version="v3", baseline=""), strict):
        store.gates.record(report)
    equal([each.open for each in store.gates.page(9).items], [False, True], "Whether they are open")
    logged = [(each.kind, each.message) for each in store.events.latest(2)]
    told = [
        ("gate.baseline", f"Version {version} is a baseline of suite 'nightly'.")
        for version in ("v2", "v3")
    ]
    equal(logged, told, "Events")
