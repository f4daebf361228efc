"""The pages of gates: the list, and the report of one."""

from store_checks.gates import make_report

from eigenfail.gate.verdicts import GateVerdict
from eigenfail_api.dashboard import gate_page
from eigenfail_api.dashboard.rendering import write_time


def test_gates_have_pages(store, check_page):
    check_page("dashboard/gates/none", "/gates")
    store.gates.record(make_report(GateVerdict.STILL_FAILING, version="v1", baseline=""))
    store.gates.record(make_report(GateVerdict.FIXED, GateVerdict.NEW))
    check_page("dashboard/gates/list", "/gates")
    check_page("dashboard/gates/baseline", "/gates/1")
    check_page("dashboard/gates/closed", "/gates/2")


def test_a_known_failure_leads_to_its_episodes_its_mode_and_the_campaigns(store, http):
    made = store.gates.record(make_report(GateVerdict.NEW))
    text = http.get(f"/gates/{made.id}").text
    addresses = ("/campaigns/1/episodes/1", "/campaigns/3/episodes/1", "/analyses/1/modes/1")
    more = ("/campaigns/1", "/campaigns/2", "/comparison?a=1&amp;b=2", "/releases/2")
    for address in (*addresses, *more):
        assert f'href="{address}"' in text
    assert "eigenfail gate nightly.toml --planner-version v2 --baseline v1" in text
    assert text.index("together: 1 new") < text.rindex("Known failures")


def test_pages_of_gates_have_times_that_scripts_show_in_the_zone_of_the_browser(store, http):
    made = store.gates.record(make_report(GateVerdict.NEW))
    written = str(write_time(made.created_ms))
    assert written.startswith("<time datetime=")
    for address in ("/gates", f"/gates/{made.id}"):
        assert written in http.get(address).text


def test_text_of_a_report_is_no_address_and_no_markup(store, http):
    report = make_report(GateVerdict.NEW)
    member, *others = report.members
    (known,) = member.known
    changes = {"episode": "javascript:alert(1)", "mode": "1/2/3", "what": "<script>"}
    odd = type(known)(**{name: getattr(known, name) for name in ("verdict", "was")} | changes)
    members = (type(member)(member="m", baseline=member.baseline, known=(odd,)), *others)
    odd_report = type(report)(gate=report.gate, open=False, counts={}, members=members)
    made = store.gates.record(odd_report)
    text = http.get(f"/gates/{made.id}").text
    assert 'href="javascript' not in text
    assert "<script>alert" not in text
    assert "&lt;script&gt;" in text


def test_older_gates_are_on_the_next_page(store, http, monkeypatch):
    monkeypatch.setattr(gate_page, "SHOWN", 1)
    for version in ("v2", "v3"):
        store.gates.record(make_report(GateVerdict.FIXED, version=version))
    first = http.get("/gates").text
    assert 'href="/gates/2"' in first
    assert 'href="/gates/1"' not in first
    assert 'href="/gates/1"' in http.get("/gates?before=2").text
