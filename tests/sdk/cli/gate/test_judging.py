"""What `eigenfail gate` makes of a better planner, a worse one, the same one, and new code."""

import json
import re

from store_checks.examples import deliver, running

from eigenfail.cli.connection import Place
from eigenfail.cli.gate_runs import Runner
from eigenfail.client import Client
from eigenfail.testing.examples import result
from eigenfail.values.measures import Measures
from eigenfail_workers.planners.idm import IntelligentDriver


def test_without_a_baseline_one_is_made_with_its_known_failures(baseline, store):
    assert baseline["gate"]["run"] == "trio @ v1"
    assert baseline["gate"]["baseline"] == ""
    one, _ = baseline["members"]
    assert one["baseline"]["failures"] == store.campaigns.get(1).counts.failures > 0
    assert one["rerun"] is None
    medoids = [known for known in one["known"] if known["what"].startswith("medoid")]
    assert medoids
    assert {known["verdict"] for known in medoids} == {"still failing"}
    assert "unproven" not in baseline["counts"]


def test_a_better_planner_passes_and_everything_is_fixed(gate, baseline):
    report = json.loads(gate("better", "--json").stdout)
    assert report["open"]
    assert set(report["counts"]) <= {"fixed", "safe"}
    for member in report["members"]:
        assert member["rerun"]["verdict"] == "fixed"
        assert member["rerun"]["counts"] == {"fixed": member["baseline"]["failures"]}
        assert member["rerun"]["now"]["failures"] == 0


def test_a_worse_planner_does_not_pass_and_each_new_failure_can_be_replayed(gate, eigenfail):
    done = gate("worse", "--json")
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    rerun = report["members"][0]["rerun"]
    known = rerun["before"]["failures"]
    assert rerun["counts"] == {"new": 16 - known, "still failing": known}
    assert "McNemar" in rerun["words"]
    first = rerun["findings"][0]
    assert first["verdict"] == "new"
    assert re.fullmatch(r"http://127.0.0.1:8440/campaigns/\d+/episodes/\d+", first["link"])
    replayed = eigenfail(*first["replay"].split()[1:], "--json")
    assert replayed.exit_code == 0
    assert json.loads(replayed.stdout)["stored_outcome"] == "collision"
    was = eigenfail("episode", "show", first["was"], "--json")
    assert json.loads(was.stdout)["outcome"] == "safe"


def test_the_same_planner_passes_unless_the_gate_is_strict(gate):
    same = gate("usual", "--json")
    assert same.exit_code == 0
    assert "new" not in json.loads(same.stdout)["counts"]
    strict = gate("usual", "--strict")
    assert strict.exit_code == 1
    assert "asked for the same thing" not in strict.stdout
    assert "against v1 is closed" in strict.stdout


def test_new_code_of_the_same_planner_is_run_anew(gate, monkeypatch, store):
    usual = IntelligentDriver.act

    def blind(self, perception):
        return usual(self, type(perception)(perception.time_s, perception.ego, (), ()))

    monkeypatch.setattr(IntelligentDriver, "act", blind)
    done = gate("usual", "--json", version="v1-blind")
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    assert report["counts"]["new"] > 0
    numbers = [report["members"][0]["rerun"][side]["campaign"] for side in ("before", "now")]
    old, new = (store.campaigns.get(number) for number in numbers)
    assert (old.spec.name, new.spec.name) == ("trio @ v1: one", "trio @ v1-blind: one")
    assert old.spec.planner_settings == new.spec.planner_settings


def test_a_planner_that_breaks_closes_the_gate(eigenfail, baseline, suite):
    file = suite()
    text = (
        file.read_text().replace('"idm"', '"test_raises"').replace("lane_half_width_m = 2.25", "")
    )
    file.write_text(text)
    done = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1", "--json")
    assert done.exit_code == 1, done.output
    report = json.loads(done.stdout)
    assert set(report["counts"]) == {"cannot be run"}
    assert report["members"][0]["known"][0]["problem"].startswith("planner: ")


def test_a_gate_can_be_the_next_baseline(eigenfail, gate, suite):
    gate("better")
    words = ("--planner-version", "v3", "--baseline", "v2", "--json")
    worse = eigenfail("gate", suite("usual"), *words)
    assert worse.exit_code == 1
    assert json.loads(worse.stdout)["members"][0]["known"] == []


def test_unresolved_episodes_are_read_by_the_brakes_that_each_has(store, working_service):
    ends = (3.5, 3.2), (3.0, 3.2), (7.5, None), (7.5, 8.0), (6.9, None), (0.0, 3.2), (8.5, 8.0)
    campaign = running(store, episodes=len(ends))
    given = [
        result(n, measures=Measures(1.0, final_drac_mps2=drac, peak_braking_mps2=peak))
        for n, (drac, peak) in enumerate(ends)
    ]
    deliver(store, campaign, *given)
    client = Client("http://127.0.0.1:1", working_service(store))
    side = Runner(client, Place("http://127.0.0.1:1"), "")._read_side(
        store.campaigns.get(campaign.id)
    )
    assert sorted(side.outcomes.unresolved) == [0, 2, 6]
