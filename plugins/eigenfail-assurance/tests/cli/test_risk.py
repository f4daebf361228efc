"""`eigenfail risk` against the real API: verdicts, exit codes, and what is refused."""

import json

import pytest

from eigenfail_services.statistics.intervals import clopper_pearson

FILE = """name = "Motorway"
severity = [50.0]

[target]
per_hour = {target}

[exposure]
hours = 200.0
kilometres = 16000.0
"""

SCENARIO = """
[[scenarios]]
name = "{name}"
encounters = {encounters}
campaigns = {campaigns}
"""


@pytest.fixture
def two(eigenfail, spec_file):
    """Two campaigns of Monte Carlo that differ in their seeds."""
    runs = (eigenfail("run", spec_file, "--seed", seed, "--json") for seed in (1, 2))
    return [json.loads(run.stdout)["campaign"] for run in runs]


@pytest.fixture
def write(tmp_path):
    """Writes a file with a target and scenarios with their campaigns."""

    def write_file(target, **campaigns):
        file = tmp_path / "risk.toml"
        text = FILE.format(target=target)
        for name, each in campaigns.items():
            listed = json.dumps(each)
            text += SCENARIO.format(name=name, encounters=40, campaigns=listed)
        file.write_text(text)
        return file

    return write_file


def ask(eigenfail, file, code):
    done = eigenfail("risk", file, "--json")
    assert done.exit_code == code, done.output
    return json.loads(done.stdout)


def test_the_answer_is_tables_with_sentences(check_session, write, two):
    file = write(1.0, cut_in=[two[0]], merge=[two[1]])
    check_session("cli/risk/met", ("risk", file), ("risk", "next", file, "--episodes", 500))


@pytest.mark.parametrize("case", [(1.0, "met", 0), (1e-9, "not met", 1)])
def test_the_exit_code_is_that_of_the_verdict(eigenfail, write, two, case):
    target, verdict, code = case
    found = ask(eigenfail, write(target, cut_in=[two[0]], merge=[two[1]]), code)
    assert found["verdict"] == verdict
    assert found["planner"] == "idm"


def test_a_scenario_without_a_campaign_leaves_it_undecided(check_session, eigenfail, write, two):
    file = write(1.0, cut_in=[two[0]], merge=[])
    assert ask(eigenfail, file, 3)["per_hour"]["value"] is None
    check_session("cli/risk/undecided", ("risk", file))


def test_what_to_do_next_is_no_part_of_json(eigenfail, write, two):
    undecided = eigenfail("risk", write(1.0, cut_in=[two[0]], merge=[]), "--json")
    assert json.loads(undecided.stdout)["verdict"] == "undecided"
    assert undecided.stderr == ""


def test_a_scenario_without_a_campaign_does_not_hide_a_missed_target(eigenfail, write, two):
    found = ask(eigenfail, write(1e-9, cut_in=[two[0]], merge=[]), 1)
    assert found["verdict"] == "not met"


def test_a_search_states_no_probability(eigenfail, write, spec_file, two):
    spec_file.write_text(spec_file.read_text().replace("monte_carlo", "cem"))
    search = json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]
    found = ask(eigenfail, write(1.0, cut_in=[two[0]], merge=[search]), 3)
    assert "is a search ('cem')" in found["scenarios"][1]["problem"]


def test_the_total_is_that_of_counts(eigenfail, write, two, store):
    found = ask(eigenfail, write(1.0, cut_in=[two[0]], merge=[two[1]]), 0)
    failures = [store.campaigns.get(each).counts.failures for each in two]
    assert min(failures) > 0
    assert found["per_hour"]["value"] == pytest.approx(0.2 * sum(failures) / 24)
    assert found["per_million_km"]["value"] == pytest.approx(0.2 * sum(failures) / 24 / 80 * 1e6)
    assert sum(each["counted"] for each in found["severity"]) == sum(failures)
    bounds = [each["at_most"] for each in found["severity"]]
    assert all(0.0 < each <= found["per_hour"]["at_most"] for each in bounds)


def test_unresolved_episodes_are_failures_in_the_upper_bounds_alone(eigenfail, write, two, store):
    found = ask(eigenfail, write(1.0, cut_in=[two[0]], merge=[two[1]]), 0)
    unresolved = [store.figures.totals([each])[each].conflicts.unresolved for each in two]
    assert sum(unresolved) > 0
    for scenario, of_one in zip(found["scenarios"], unresolved, strict=True):
        k, n = scenario["failures"], scenario["episodes"]
        interval = scenario["probability"]["interval"]
        assert interval["low"] == pytest.approx(clopper_pearson(k, n).low, rel=1e-3)
        assert interval["high"] == pytest.approx(clopper_pearson(k + of_one, n).high, rel=1e-3)
    assert f"{sum(unresolved)} episodes ended unresolved" in " ".join(found["notes"])


def test_campaigns_of_one_scenario_are_counted_together(eigenfail, write, two, store):
    found = ask(eigenfail, write(1.0, cut_in=two), 0)
    (scenario,) = found["scenarios"]
    counts = [store.campaigns.get(each).counts for each in two]
    assert scenario["episodes"] == sum(each.completed for each in counts) == 48
    assert scenario["failures"] == sum(each.failures for each in counts)


def test_name_of_several_campaigns_is_refused_with_their_ids(eigenfail, write, two, store):
    """A later campaign of a name must not take the place of an earlier one unseen."""
    name = store.campaigns.get(two[0]).spec.name
    refused = eigenfail("risk", write(1.0, cut_in=[name]))
    assert refused.exit_code == 2
    assert f"'{name}' is the name of campaigns {two[1]} (done), {two[0]} (done)." in " ".join(
        refused.stderr.split()
    )


def test_equal_seeds_are_told(eigenfail, write, spec_file, two):
    spec_file.write_text(spec_file.read_text().replace("episodes = 24", "episodes = 30"))
    alike = json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]
    found = ask(eigenfail, write(1.0, cut_in=[two[0]], merge=[alike]), 0)
    assert any("have the same seed" in note for note in found["notes"])


def test_what_cannot_be_is_refused_by_name(check_session, eigenfail, write, spec_file, two):
    spec_file.write_text(spec_file.read_text().replace('"idm"', '"rulebook"'))
    other = json.loads(eigenfail("run", spec_file, "--json").stdout)["campaign"]
    for name, campaigns in {
        "twice": {"cut_in": [two[0]], "merge": [two[0]]},
        "planners": {"cut_in": [two[0]], "merge": [other]},
        "unlike": {"cut_in": [two[0], other]},
        "missing": {"cut_in": [99]},
        "unnamed": {"cut_in": ["No such campaign"]},
    }.items():
        check_session(f"cli/risk/{name}", ("risk", write(1.0, **campaigns)))


def test_a_bad_file_exits_with_2_and_names_the_field(eigenfail, write, tmp_path, two):
    file = write(1.0, cut_in=[two[0]])
    file.write_text(file.read_text().replace("encounters", "encounter"))
    done = eigenfail("risk", file)
    assert done.exit_code == 2
    assert "encounter" in done.stderr
    assert "encounters" in done.stderr
    assert eigenfail("risk", tmp_path / "none.toml").exit_code == 2
    assert eigenfail("risk", "next", tmp_path / "none.toml").exit_code == 2


def test_failures_may_come_from_another_campaign(eigenfail, write, two, store):
    file = write(1.0, cut_in=[two[0]])
    text = file.read_text()
    file.write_text(f"{text}failures_from = {two[1]}\n")
    found = ask(eigenfail, file, 0)
    counted = sum(each["counted"] for each in found["severity"])
    assert counted == store.campaigns.get(two[1]).counts.failures
    assert {each["at_most"] for each in found["severity"]} == {None}
