"""A report on small real campaigns: complete, self-contained, and true to the store."""

import csv
import io
import re
import zipfile
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from store_checks.examples import analyse_function

from eigenfail.errors import InvalidValue, NotFound
from eigenfail.presentation.figures import format_money, format_utc
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.triage import TriageChange, TriageState
from eigenfail.wire.http import decode
from eigenfail_reports.contents import Report, ReportTable
from eigenfail_reports.page import MOST_ROWS, format_plain, to_csv
from eigenfail_reports.report import Made, make
from eigenfail_services.campaigns.analysis_jobs import run_analysis
from eigenfail_services.campaigns.summary import find_safety, summarise_campaign
from eigenfail_services.comparison.seeds import find_spreads
from eigenfail_services.store.store import Store, open_store

NOW_MS = 1_760_000_000_000

ALWAYS = ("results", "setup", "safety", "learning", "likelihood", "cost", "modes", "provenance")
WITH_MODES = ("eigenfailures", "collisions", "influence", "variance", "training")


def table(report: Report, name: str) -> ReportTable:
    return next(table for table in report.tables if table.name == name)


def records(table: ReportTable) -> list[dict[str, Any]]:
    names = [column.name for column in table.columns]
    return [dict(zip(names, row, strict=True)) for row in table.rows]


def test_every_section_is_there_and_in_the_contents(made: Made, page: Any) -> None:
    names = [section.name for section in made.report.sections]
    assert set(names) >= {*ALWAYS, *WITH_MODES}
    assert [each["id"] for each in page.all("section")] == names
    assert {f"#{name}" for name in names} <= {each["href"] for each in page.all("a")}


def test_a_campaign_without_failures_has_no_section_on_modes(store: Store, parse: Any) -> None:
    made = make(store, (2,), NOW_MS)
    names = {section.name for section in made.report.sections}
    assert names >= set(ALWAYS)
    assert names.isdisjoint(WITH_MODES)
    (row,) = records(table(made.report, "results"))
    assert (row["failures"], row["cost_per_failure"], row["log_p_per_step"]) == (0, None, None)
    text = parse(made.html()).text
    assert "Campaign 2: no failure, so there is no mode." in text
    cost = summarise_campaign(store, store.campaigns.get(2)).cost
    assert row["cost_per_failure_at_least"] == cost.at_least_usd
    assert f"≥ {format_money(cost.at_least_usd)}" in text


def test_a_campaign_that_runs_or_waits_is_told_as_such(made: Made, page: Any) -> None:
    assert made.report.warnings == (
        "Campaign 3 is running: its figures may still change.",
        "Campaign 4 is running: its figures may still change.",
    )
    assert all(warning in page.text for warning in made.report.warnings)
    assert "Campaign 4, Queued (monte_carlo, idm in cut_in): no episode has ended yet." in page.text


def test_the_numbers_are_those_of_the_store(made: Made, store: Store) -> None:
    for row in records(table(made.report, "results")):
        campaign = store.campaigns.get(row["campaign"])
        summary = summarise_campaign(store, campaign)
        assert row["failures"] == summary.counts.failures
        assert row["severity"] == summary.mean_severity
        assert row["log_p_per_step"] == summary.log_probability_per_step
        assert row["cost"] == summary.cost.total_usd
        rate = summary.failure_rate
        assert row["failure_rate"] == (rate.value if rate else None)
        assert row["failure_rate_high"] == (rate.interval.high if rate else None)
    safety = find_safety(store, store.campaigns.get(1))
    (worst,) = [
        row
        for row in records(table(made.report, "safety"))
        if row["campaign"] == 1 and row["measure"] == "MinTTC worst"
    ]
    assert (worst["value"], worst["n"]) == (safety.ttc.worst, safety.ttc.n)


def test_modes_and_their_bands_are_those_of_the_analysis(made: Made, store: Store) -> None:
    result = store.analyses.get(1).result
    assert result is not None
    modes = records(table(made.report, "modes"))
    assert [row["failures"] for row in modes] == [mode.failures for mode in result.modes]
    first = [row for row in records(table(made.report, "eigenfailures")) if row["mode"] == 1]
    z = [row["eigenfailure_lateral"] for row in first]
    assert z == result.modes[0].eigenfailure[:, 1].astype(float).tolist()
    members = [e for e, label in zip(result.episodes, result.labels, strict=True) if label == 0]
    noise = [store.episodes.get(1, index).noise.z for index in members]
    assert first[0]["members"] == len(members)
    assert first[0]["mean_longitudinal"] == pytest.approx(
        sum(float(each[0, 0]) for each in noise) / len(noise), abs=1e-6
    )


def test_the_page_needs_nothing_and_runs_nothing(html: bytes, page: Any) -> None:
    text = html.decode()
    assert not re.search(r"https?:|@import|url\((?!#)|\bsrc=", text)
    assert not page.all("script")
    assert not page.all("link")
    assert not [name for _, each in page.elements for name in each if name.startswith("on")]
    assert {each.get("href", "#")[:1] for each in page.all("a")} == {"#"}
    assert page.open == []


def test_names_of_users_are_text(html: bytes, page: Any, made: Made, parse: Any) -> None:
    assert b"<script" not in html
    assert "=A $b$ <script>alert(1)</script> & c" in page.text
    labels = [text for svg in made.drawn.values() for text in parse(svg.encode()).texts]
    assert ("text", "1: =A $b$ <script>alert(1)</script> & c") in labels


def test_every_picture_has_words_and_numbers(made: Made, page: Any) -> None:
    pictures = [picture for section in made.report.sections for picture in section.pictures]
    assert len(pictures) >= 8
    drawn = page.all("svg")
    assert [each["role"] for each in drawn] == ["img"] * len(pictures)
    for picture in pictures:
        assert len(picture.alternative) > 20
        assert set(picture.campaigns) <= {
            row["campaign"] for row in records(table(made.report, picture.table))
        }
    named = [each["id"] for _, each in page.elements if each.get("id")]
    assert len(named) == len(set(named))
    for each in drawn:
        assert set((each["aria-labelledby"] or "").split()) <= set(named)


def test_long_tables_are_cut_with_a_word_on_it(made: Made, page: Any) -> None:
    rows = len(table(made.report, "eigenfailures").rows)
    assert rows > MOST_ROWS
    assert f"The first {MOST_ROWS} of {rows:,} rows." in page.text


def test_the_same_results_give_the_same_bytes(store: Store, made: Made, html: bytes) -> None:
    again = make(store, (1, 2, 3, 4), NOW_MS)
    assert again.html() == html
    later = make(store, (1, 2, 3, 4), NOW_MS + 86_400_000)
    assert later.report != made.report
    assert msgspec.structs.replace(later.report, made_ms=NOW_MS) == made.report
    assert html.decode().count(format_utc(NOW_MS)) == 1


def test_the_bundle_has_page_data_tables_and_pictures(made: Made, html: bytes) -> None:
    bundle = made.bundle()
    with zipfile.ZipFile(io.BytesIO(bundle)) as packed:
        names = packed.namelist()
        report = decode(packed.read("report.json"), Report)
        assert packed.read("report.html") == html
        told = packed.read("tables/results.csv")
    assert report == made.report
    assert {f"tables/{each.name}.csv" for each in report.tables} <= set(names)
    assert {f"pictures/{name}.svg" for name in made.drawn} <= set(names)
    row, *_ = csv.DictReader(io.StringIO(told.decode()))
    same, *_ = records(table(report, "results"))
    assert row["name"] == "'" + same["name"]
    assert float(row["failure_rate"]) == same["failure_rate"]
    assert int(row["failures"]) == same["failures"]
    assert float(row["probability"]) == same["probability"]
    assert made.bundle() == bundle


def test_csv_holds_every_number_as_exact_as_json(made: Made) -> None:
    for each in made.report.tables:
        lines = [*csv.reader(io.StringIO(to_csv(each).decode()))]
        assert lines[0] == [column.name for column in each.columns]
        for row, cells in zip(each.rows, lines[1:], strict=True):
            for cell, text in zip(row, cells, strict=True):
                assert text == format_plain(cell)
                if isinstance(cell, float):
                    assert float(text) == cell


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@x", "\tx"])
def test_no_text_is_a_formula(text: str) -> None:
    assert format_plain(text) == f"'{text}"
    assert format_plain(-1.5) == "-1.5"


def test_set_up_tells_what_was_given_and_what_was_not(made: Made, page: Any) -> None:
    given = {
        (row["campaign"], row["setting"]): row["value"]
        for row in records(table(made.report, "setup"))
    }
    assert given[1, "Seed"] == "1"
    assert given[2, "Disturbance: scale"] == "both sigmas × 0.01"
    assert given[1, "Ended because"] == "The budget was spent."
    defaults = {(row["plugin"], row["setting"]) for row in records(table(made.report, "defaults"))}
    assert ("idm", "time_headway_s") in defaults
    assert made.report.campaigns[0].spec.seed == 1


def test_provenance_has_versions_seeds_and_digests(made: Made, store: Store) -> None:
    evidence = {row["campaign"]: row for row in records(table(made.report, "evidence"))}
    assert evidence[1]["digest"] == store.campaigns.get(1).digest
    assert evidence[3]["digest"] == "not done"
    programs = {row["thing"] for row in records(table(made.report, "programs"))}
    assert {"eigenfail", "schema of the database", "Python", "numpy", "matplotlib"} <= programs
    assert made.report.command == "eigenfail report 1 2 3 4"


@pytest.mark.parametrize("campaigns", [(), (1, 1), tuple(range(1, 30))])
def test_what_no_report_can_be_made_of_is_refused(store: Store, campaigns: tuple[int, ...]) -> None:
    with pytest.raises(InvalidValue):
        make(store, campaigns, NOW_MS)


def test_a_campaign_that_is_not_there_is_named(store: Store) -> None:
    with pytest.raises(NotFound, match="99"):
        make(store, (1, 99), NOW_MS)


def test_campaigns_that_differ_by_seed_have_a_section_over_seeds(
    made: Made, store: Store, page: Any
) -> None:
    (spread,) = find_spreads(store, (1, 2, 3, 4))
    (row,) = records(table(made.report, "over-seeds"))
    assert (row["campaigns"], row["seeds"], row["n"]) == ("1, 3", "1, 3", 34)
    assert row["failures"] == spread.failures
    assert spread.share.interval
    assert (row["share"], row["share_low"], row["share_high"]) == (
        spread.share.mean,
        spread.share.interval.low,
        spread.share.interval.high,
    )
    assert row["share_deviation"] == spread.share.deviation
    assert row["cost_per_failure"] == spread.cost.per_failure_usd
    assert (
        "Share of episodes that failed, mean over 2 seeds [95 % interval of the mean]" in page.text
    )
    assert "No episode is completed with seed 4" in page.text


def test_without_campaigns_that_differ_by_seed_there_is_no_such_section(store: Store) -> None:
    names = {section.name for section in make(store, (1, 2), NOW_MS).report.sections}
    assert "over-seeds" not in names


CHANNELS = ("gust", "campaign", "gust_campaign", "glare", "delay", "bias", "drift")


@pytest.mark.parametrize("count", [1, 3, 5, 7])
def test_noise_has_the_names_of_its_channels(count: int) -> None:
    store, channels = open_store("memory://"), CHANNELS[:count]
    made = make(store, (analyse_function(store, channels)[0],), NOW_MS)
    tables = {table.name: table for table in made.report.tables}
    names = [column.name for table in tables.values() for column in table.columns]
    assert not any("longitudinal" in name or "lateral" in name for name in names)
    assert "longitudinal" not in made.html().decode()
    for table in tables.values():
        columns = [column.name for column in table.columns]
        assert len({*columns}) == len(columns)
        assert {len(row) for row in table.rows} <= {len(columns)}
    result = store.analyses.get(1).result
    assert result is not None
    influence = [row[-count:] for row in tables["influence"].rows]
    assert influence == [tuple(row) for row in result.influence.astype(float).tolist()]
    titles = re.findall(r"mode 1, (\w+)", made.drawn["eigenfailures-campaign-1"])
    assert titles == [name for name in channels if name in titles]
    assert len(titles) == min(count, 3)
    assert channels[-1] in titles  # the channel of greatest influence is always drawn
    pictures = {each.name: each for part in made.report.sections for each in part.pictures}
    assert pictures["influence-campaign-1"].note == (
        f"The 3 channels of greatest influence, of {count}." if count > 3 else ""
    )


def test_campaigns_of_other_channels_share_a_table(run: Callable[..., int]) -> None:
    store = open_store("memory://")
    run(store, name="Road")
    run_analysis(store, store.analyses.create(1, AnalysisSettings(clusters=2, bootstrap=0)).id)
    made = make(store, (1, analyse_function(store, CHANNELS[:1])[0]), NOW_MS)
    (table,) = [each for each in made.report.tables if each.name == "influence"]
    assert [column.name for column in table.columns][-3:] == ["longitudinal", "lateral", "gust"]
    for row in table.rows:
        assert [cell is None for cell in row[-3:]] == ([row[0] == 2] * 2 + [row[0] == 1])


ROAD_WORDS = ("collision", "vehicle", "v_ego", "|dx|", "MinTTC below", "planner")


def test_a_report_on_a_function_claims_nothing_that_was_not_measured() -> None:
    store = open_store("memory://")
    made = make(store, (analyse_function(store, CHANNELS[:1])[0],), NOW_MS)
    sections = {section.name: section for section in made.report.sections}
    for name in ("results", "setup", "safety", "likelihood"):
        text = " ".join(sections[name].words)
        assert [words for words in ROAD_WORDS if words in text] == [], name
    (words,) = sections["likelihood"].words
    assert words == (
        "Campaign 1: severity is not measured for a function, so that its 24 failures are not "
        "drawn."
    )
    assert "its answer, the robustness, is 0 or less" in sections["setup"].words[0]
    (row,) = records(table(made.report, "safety"))
    assert (row["measure"], row["k"], row["n"]) == ("failures", 24, 24)
    (row,) = records(table(made.report, "results"))
    assert row["unresolved"] is row["severity"] is None
    html = made.html().decode()
    for words in ("Near misses<", "Planner failures", "Mean severity", "|dx|", "v_actor"):
        assert words not in html


def test_of_both_kinds_each_has_its_own_words_and_a_function_has_dashes(
    run: Callable[..., int], parse: Callable[[bytes], Any]
) -> None:
    store = open_store("memory://")
    run(store, name="Road")
    road = make(store, (1,), NOW_MS)
    made = make(store, (1, analyse_function(store, CHANNELS[:1])[0]), NOW_MS)
    alone, both = (
        {section.name: section for section in each.report.sections} for each in (road, made)
    )
    for name, of_function in (
        ("results", "The failure rate of a function"),
        ("setup", "A campaign on a function"),
        ("safety", "A failure of a function"),
    ):
        texts = [" ".join(sections[name].words) for sections in (alone, both)]
        assert [of_function in text for text in texts] == [False, True]
    assert "|dx|" in both["setup"].words[0]
    assert "‖v_ego − v_actor‖²" in both["results"].words[-1]
    assert both["likelihood"].words[-1].startswith("Campaign 2: severity is not measured")
    assert len(both["likelihood"].pictures) == 1
    (grid,) = next(part.grids["safety"] for part in made._parts if "safety" in part.grids)
    rows = {row[0][0]: row[1:] for row in grid.rows}
    assert rows["Failures"][1][0] == "24 of 24"
    assert {cells[1] for title, cells in rows.items() if title != "Failures"} == {("–",)}
    assert rows["Near misses"][0] != ("–",)
    assert "Near misses" in parse(made.html()).text


def test_the_robustness_of_a_function_has_no_unit(run: Callable[..., int]) -> None:
    store = open_store("memory://")
    run(store, name="Road")
    function = analyse_function(store, CHANNELS[:1])[0]
    units = []
    for campaigns in ((1,), (function,), (1, function)):
        columns = table(make(store, campaigns, NOW_MS).report, "learning-curve").columns
        units.append({each.unit for each in columns if each.name.endswith("robustness_m")})
    assert units == [{"m"}, {""}, {"m on the road"}]


@pytest.fixture(scope="module")
def triaged(run: Callable[..., int]) -> Store:
    """A store whose campaign was run by workers with two codes, and whose results were triaged."""
    store = open_store("memory://")
    run(store, name="Triaged", planner_version="2.1")
    for digest in ("0123456789ab", "ba9876543210"):
        store.campaigns.add_code(1, {"eigenfail_workers": digest})
    run_analysis(store, store.analyses.create(1, AnalysisSettings(clusters=2, bootstrap=0)).id)
    change = TriageChange(TriageState.KNOWN, "https://t/7", "<b>seen</b> on track 3")
    store.analyses.change_triage(1, 2, change, "anna's key")
    return store


def test_triage_of_modes_is_told(triaged: Store, parse: Any) -> None:
    made = make(triaged, (1,), NOW_MS)
    rows = records(table(made.report, "triage"))
    modes = triaged.analyses.modes(1)
    assert [(row["analysis"], row["number"], row["name"]) for row in rows] == [
        (1, mode.number, mode.name) for mode in modes
    ]
    assert [row["state"] for row in rows] == ["new", "known"]
    known = rows[1]
    assert (known["ticket"], known["note"], known["changed_by"]) == (
        *("https://t/7", "<b>seen</b> on track 3"),
        "anna's key",
    )
    html = made.html()
    assert b"<b>seen" not in html
    text = parse(html).text
    assert "<b>seen</b> on track 3" in text
    assert "Campaign 1: 2 modes: 1 known, 1 new." in text


def test_triage_that_changes_no_result_changes_no_digest(triaged: Store) -> None:
    made = make(triaged, (1,), NOW_MS)
    (evidence,) = records(table(made.report, "evidence"))
    assert evidence["digest"] == triaged.campaigns.get(1).digest


def test_without_modes_there_is_no_triage(store: Store) -> None:
    names = {section.name for section in make(store, (2,), NOW_MS).report.sections}
    assert "triage" not in names


def test_version_of_the_planner_and_code_of_the_workers_are_told(
    triaged: Store, made: Made
) -> None:
    report = make(triaged, (1,), NOW_MS).report
    rows = records(table(report, "code"))
    assert [(row["code"], row["package"], row["fingerprint"]) for row in rows] == [
        (1, "eigenfail_workers", "0123456789ab"),
        (2, "eigenfail_workers", "ba9876543210"),
    ]
    assert {(row["planner"], row["planner_version"]) for row in rows} == {("idm", "2.1")}
    setup = {row["setting"]: row["value"] for row in records(table(report, "setup"))}
    assert setup["Planner: version"] == "2.1"
    # Without a version and without workers that told their code, the rows say so.
    for row in records(table(made.report, "code")):
        assert (row["planner_version"], row["fingerprint"]) == ("not given", None)


def test_the_failure_probability_of_monte_carlo_is_its_failure_rate(
    made: Made, store: Store, page: Any
) -> None:
    for row in records(table(made.report, "results")):
        summary = summarise_campaign(store, store.campaigns.get(row["campaign"]))
        rate = summary.failure_rate
        if rate is None:
            assert row["probability"] is row["probability_by"] is None
            continue
        assert rate.interval
        assert (row["probability"], row["probability_low"], row["probability_high"]) == (
            *(rate.value, rate.interval.low),
            rate.interval.high,
        )
        assert (row["probability_n"], row["probability_at_least"]) == (rate.n, None)
        assert row["probability_by"] == "failure rate of episodes drawn from p(x)"
    assert page.text.count("failure rate of episodes drawn from p(x)") >= 3


def test_the_share_of_a_search_is_no_failure_probability(run: Callable[..., int]) -> None:
    store = open_store("memory://")
    run(store, name="Search", method="cem", episodes=40)
    report = make(store, (1,), NOW_MS).report
    (row,) = records(table(report, "results"))
    assert row["failure_rate"] is not None
    assert row["probability_by"] != "failure rate of episodes drawn from p(x)"
    (picture,) = [
        picture
        for section in report.sections
        if section.name == "learning"
        for picture in section.pictures
    ]
    assert picture.title == "Share of episodes that failed and likelihood of failures over episodes"
    assert "share of episodes that failed" in picture.alternative
    titles = {column.title for each in report.tables for column in each.columns}
    assert "Failure rate" not in titles
