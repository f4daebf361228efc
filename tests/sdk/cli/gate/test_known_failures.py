"""Known failures that are replayed: minimal ones, and those of scenarios that vary."""

import json

from accepted import accept_spec
from campaigns_here import run_here
from msgspec.structs import replace

from eigenfail.client.campaigns import Campaigns
from eigenfail_services.campaigns.minimal_failures import find_minimal_failure


def shrunk(store, was):
    """A finished campaign of `minimal` that shrank an episode, run here; its id."""
    campaign, index = map(int, was.split("/"))
    settings = {"campaign": campaign, "episode": index}
    fields = {"method": "minimal", "settings": settings, "episodes": 60, "name": "shrunk"}
    spec = replace(store.campaigns.get(campaign).spec, **fields)
    return run_here(store, store.campaigns.create(accept_spec(spec)).id)


def medoid_of(baseline):
    return next(each["was"] for each in baseline["members"][0]["known"] if each["was"])


def test_a_minimal_failure_is_replayed_too(gate, baseline, store):
    number = shrunk(store, medoid_of(baseline))
    index = find_minimal_failure(store, store.campaigns.get(number)).index
    report = json.loads(gate("better", "--json").stdout)
    known = {each["what"]: each["verdict"] for each in report["members"][0]["known"]}
    assert known[f"minimal failure {number}/{index}"] == "fixed"


def test_what_is_shrunk_while_a_gate_begins_does_not_stop_it(gate, baseline, store, monkeypatch):
    listed = Campaigns.list

    def list_and_shrink(self, state=None, suite=None, *, archived=False):
        found = [*listed(self, state, suite, archived=archived)]
        if state == "done":
            shrunk(store, medoid_of(baseline))
        return iter(found)

    monkeypatch.setattr(Campaigns, "list", list_and_shrink)
    assert gate("better", "--json").exit_code == 0


def test_where_the_scenario_varies_each_known_failure_is_replayed_in_its_own(eigenfail, tmp_path):
    file = tmp_path / "varied.toml"
    file.write_text(
        'name = "varied"\n[base]\nmethod = "monte_carlo"\nplanner = "idm"\nepisodes = 12\n'
        'simulator = "point_mass"\nscenario_parameters.distance_m = { uniform = [52.0, 70.0] }\n'
        "[grid]\nseed = [1]\n"
    )
    made = eigenfail("gate", file, "--planner-version", "v1", "--json")
    assert made.exit_code == 0, made.output
    known = json.loads(made.stdout)["members"][0]["known"]
    medoids = [each for each in known if each["what"].startswith("medoid")]
    assert {each["verdict"] for each in medoids} == {"still failing"}

    def shown(episode):
        return json.loads(eigenfail("episode", "show", episode, "--json").stdout)

    for medoid in medoids:
        was, now = shown(medoid["was"]), shown(medoid["episode"])
        assert now["measures"] == was["measures"]
