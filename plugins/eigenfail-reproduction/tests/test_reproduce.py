"""`eigenfail reproduce` on a service whose campaigns take no time; benchmarks run the real ones."""

import csv
import json

import msgspec
import pytest

from eigenfail import plugins
from eigenfail.suites import Suite, SuiteMember
from eigenfail_reproduction import commands
from eigenfail_reproduction.paper import PaperReproduction
from eigenfail_reproduction.programme import build_suite

QUICK = {
    "method": "monte_carlo",
    "settings": {},
    "planner": "idm",
    "planner_settings": {},
    "scenario_parameters": {},
    "simulator": "point_mass",
    "episodes": 8,
}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """The members of the programme by their names, each as a campaign of eight episodes."""

    def members(scale, seed, scenario):
        suite = build_suite(scale, seed, scenario)
        specs = (msgspec.structs.replace(member.spec, **QUICK) for member in suite.members)
        named = zip(suite.members, specs, strict=True)
        return Suite(suite.name, tuple(SuiteMember(member.name, spec) for member, spec in named))

    monkeypatch.setattr(commands, "build_suite", members)


def test_tables_and_statements_are_printed(eigenfail):
    told = eigenfail("reproduce", "--seed", "3")
    assert told.exit_code == 0, told.output
    for title in ("Planners under Monte Carlo", "Sweep of AST's settings", "Safety measures"):
        assert title in told.stdout
    assert "(paper 94.6)" in told.stdout
    assert "What the paper says" in told.stdout
    assert "Monte Carlo finds no failure where AST and DiFS both do." in told.stdout


def test_run_again_it_does_nothing_twice(eigenfail, store):
    first = eigenfail("reproduce", "--json")
    campaigns = len(store.campaigns.page(100).items)
    analyses = len(store.analyses.page(100).items)
    again = eigenfail("reproduce", "--json")
    assert first.stdout == again.stdout
    assert len(store.campaigns.page(100).items) == campaigns
    assert len(store.analyses.page(100).items) == analyses == 12
    found = msgspec.json.decode(first.stdout, type=PaperReproduction)
    assert found.scale == "small"
    assert found.tables[-1].rows[0].numbers[0].value is not None, "eigenfailures were replayed"


def test_the_folder_holds_report_page_numbers_and_claims(eigenfail, tmp_path):
    out = tmp_path / "out"
    told = eigenfail("reproduce", "-o", out)
    assert told.exit_code == 0, told.output
    claims = json.loads((out / "claims.json").read_text())
    page = (out / "paper.md").read_text()
    assert claims.keys() == {part.split()[0] for part in page.split("<!-- claim ")[1:]} | {
        name for name, claim in claims.items() if claim["value"] is None
    }
    with (out / "tables" / "paper-evaluation.csv").open() as file:
        rows = {row["row"]: row for row in csv.DictReader(file)}
    rate = claims["paper.evaluation.ast_evaluation.failure_rate"]
    assert float(rows["ast evaluation"]["failure_rate"]) == rate["value"]
    assert float(rows["ast evaluation"]["failure_rate_paper"]) == 0.946
    # Another plug-in makes reports, and it need not be installed.
    assert (out / "report.html").exists() == ("report" in plugins.names(plugins.ROUTES))


def test_a_scenario_without_a_programme_is_refused_with_the_nearest_one(eigenfail, store):
    told = eigenfail("reproduce", "--scenario", "highway_drove")
    assert told.exit_code == 2
    assert "Did you mean 'highway_drive'? Known: cut_in, highway_drive." in told.stderr
    assert store.campaigns.page(10).items == ()


def test_a_folder_that_is_there_is_refused_before_anything_is_run(eigenfail, store, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    told = eigenfail("reproduce", "-o", tmp_path)
    assert told.exit_code == 2
    assert store.campaigns.page(10).items == ()
