"""`eigenfail gate` against the real API, and once with a service of its own and changed code."""

import json
import os
import re
import signal
import subprocess
import sys
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from eigenfail import plugins
from eigenfail.cli.interruption import INTERRUPTED
from eigenfail.cli.main import app
from eigenfail.cli.surroundings import Surroundings
from eigenfail.client import Client
from eigenfail.client.campaigns import Campaigns
from eigenfail.values.records import Delivery
from eigenfail_services.campaigns.materials import learner_context
from eigenfail_services.campaigns.minimal_failures import minimal_failure
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.methods.minimal.method import Minimal
from eigenfail_services.store import open_store
from eigenfail_workers.planners.idm import IntelligentDriver

EIGENFAIL = Path(sys.executable).parent / "eigenfail"

SUITE = """
name = "trio"
[base]
method = "monte_carlo"
planner = "idm"
simulator = "point_mass"
episodes = 16
[base.planner_settings]
lane_half_width_m = {width}
[[campaigns]]
name = "one"
seed = 1
[[campaigns]]
name = "two"
seed = 2
"""

USUAL, BETTER, WORSE = 2.25, 3.0, 1.5
"""The planner's lane: the wider, the earlier it heeds who comes in."""


@pytest.fixture
def suite(tmp_path):
    """Writes the suite with a planner of this width."""

    def write(width=USUAL, name="trio.toml", more=""):
        file = tmp_path / name
        file.write_text(SUITE.format(width=width) + more)
        return file

    return write


@pytest.fixture(scope="module")
def made(tmp_path_factory, working_service):
    """A store with a baseline of version v1, and what was said of it."""
    file = tmp_path_factory.mktemp("made") / "trio.toml"
    file.write_text(SUITE.format(width=USUAL))
    store = open_store("memory://")
    surroundings = Surroundings(connect=lambda url: Client(url, working_service(store)))
    words = ["gate", str(file), "--planner-version", "v1", "--json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eigenfail.client.waiting.sleep", lambda seconds: None)
        run = CliRunner().invoke(app, words, obj=surroundings)
    assert run.exit_code == 0, run.output
    yield store, json.loads(run.stdout)
    store.close()


@pytest.fixture
def store(made):
    """A copy of that store, in place of an empty one: making a baseline takes seconds."""
    tables = made[0].campaigns._tables
    shared = {id(each): each for each in (tables.lock, tables.job_ids)}
    return deepcopy(made[0], shared)


@pytest.fixture
def baseline(made):
    """What was said of the baseline."""
    return made[1]


@pytest.fixture
def gate(eigenfail, suite):
    """Gates a planner of this width against v1."""

    def run(width, *words, version="v2"):
        given = ("--planner-version", version, "--baseline", "v1")
        done = eigenfail("gate", suite(width), *given, *words)
        assert done.exit_code in {0, 1}, done.output
        return done

    return run


def report_of(done):
    return json.loads(done.stdout)


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
    report = report_of(gate(BETTER, "--json"))
    assert report["open"]
    assert set(report["counts"]) <= {"fixed", "safe"}
    for member in report["members"]:
        assert member["rerun"]["verdict"] == "fixed"
        assert member["rerun"]["counts"] == {"fixed": member["baseline"]["failures"]}
        assert member["rerun"]["now"]["failures"] == 0


def test_a_worse_planner_does_not_pass_and_each_new_failure_can_be_replayed(gate, eigenfail):
    done = gate(WORSE, "--json")
    assert done.exit_code == 1
    report = report_of(done)
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
    same = gate(USUAL, "--json")
    assert same.exit_code == 0
    assert "new" not in report_of(same)["counts"]
    strict = gate(USUAL, "--strict")
    assert strict.exit_code == 1
    assert "against v1 is closed" in strict.stdout


def test_new_code_of_the_same_planner_is_run_anew(gate, monkeypatch, store):
    usual = IntelligentDriver.act

    def blind(self, perception):
        return usual(self, type(perception)(perception.time_s, perception.ego, ()))

    monkeypatch.setattr(IntelligentDriver, "act", blind)
    done = gate(USUAL, "--json", version="v1-blind")
    assert done.exit_code == 1
    report = report_of(done)
    assert report["counts"]["new"] > 0
    numbers = [report["members"][0]["rerun"][side]["campaign"] for side in ("before", "now")]
    old, new = (store.campaigns.get(number) for number in numbers)
    assert (old.spec.name, new.spec.name) == ("trio @ v1: one", "trio @ v1-blind: one")
    assert old.spec.planner_settings == new.spec.planner_settings


def test_the_same_gate_again_runs_nothing_twice(gate, store):
    first = gate(WORSE, "--json")
    count = len(store.campaigns.page(100).items)
    assert gate(WORSE, "--json").stdout == first.stdout
    assert len(store.campaigns.page(100).items) == count


def test_ctrl_c_pauses_and_the_same_gate_goes_on(eigenfail, suite, service, store, working_service):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.spec.name == "trio @ v2: two" and campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    service.__class__ = Interrupting
    service.episodes_at_once = 4
    words = ("gate", suite(BETTER), "--planner-version", "v2", "--baseline", "v1")
    stopped = eigenfail(*words)
    assert stopped.exit_code == INTERRUPTED
    assert "To go on: eigenfail" in stopped.stderr
    assert "paused" in {campaign.state for campaign in store.campaigns.page(100).items}
    service.__class__ = working_service
    assert eigenfail(*words).exit_code == 0


def test_people_see_what_is_new_and_what_it_means(gate):
    done = gate(WORSE)
    assert "The gate of trio @ v2 against v1 is closed:" in done.stdout
    assert re.search(r"one +medoid 1, 1/\d+ +still failing +eigenfail episode replay", done.stdout)
    assert re.search(r"one +episode \d+ +new +eigenfail episode replay", done.stdout)
    assert "\x1b" not in done.stdout
    assert "can be a baseline" not in done.stdout


def test_junit_is_written_whole(gate, tmp_path):
    file = tmp_path / "gate.xml"
    assert gate(WORSE, "--junit", file).exit_code == 1
    root = ET.fromstring(file.read_bytes())
    assert int(root.get("failures")) > 0
    assert [suite.get("name") for suite in root] == ["trio: one", "trio: two"]
    assert sorted(path.name for path in tmp_path.glob("*.xml*")) == ["gate.xml"]


@pytest.mark.parametrize("named", ["trio @ v1", "1,2"])
def test_a_baseline_is_named_by_its_run_or_its_campaigns(eigenfail, suite, gate, named):
    gate(BETTER)
    done = eigenfail(
        "gate", suite(BETTER), "--planner-version", "v2", "--baseline", named, "--json"
    )
    assert done.exit_code == 0, done.output
    assert [each["baseline"]["campaign"] for each in report_of(done)["members"]] == [1, 2]


def test_a_suite_that_was_run_is_a_baseline_whose_eigenfailures_are_unproven(
    eigenfail, suite, store
):
    before = suite(USUAL, "before.toml")
    assert eigenfail("suite", "run", before).exit_code == 0
    words = ("gate", suite(WORSE), "--planner-version", "v2", "--json", "--baseline")
    report = report_of(eigenfail(*words, before))
    by_name = report_of(eigenfail(*words, "trio"))
    assert by_name["members"] == report["members"]
    verdicts = {
        known["verdict"]
        for member in report["members"]
        for known in member["known"]
        if known["what"].startswith("eigenfailure")
    }
    assert verdicts <= {"unproven", "safe"}
    assert len(store.analyses.page(10).items) == 4


def shrunk(store, was):
    """A finished campaign of `minimal` that shrank an episode, run here; its id."""
    campaign, index = map(int, was.split("/"))
    settings = {"campaign": campaign, "episode": index}
    fields = {"method": "minimal", "settings": settings, "episodes": 60, "name": "shrunk"}
    spec = replace(store.campaigns.get(campaign).spec, **fields)
    number = store.campaigns.create(spec).id
    running = store.campaigns.move(number, "running")
    learner = Minimal(learner_context(running, store), Minimal.Settings(**settings))
    rounds = Rounds(learner, spec.seed, spec.episodes)
    engine = plugins.load(plugins.ENGINES, "default")(spec.setup())
    for result in run_in_process(rounds, engine):
        store.episodes.commit(number, [Delivery(result, "by hand")])
    store.checkpoints.save(number, rounds.checkpoint())
    store.campaigns.move(number, "done")
    return number


def medoid_of(baseline):
    return next(each["was"] for each in baseline["members"][0]["known"] if each["was"])


def test_a_minimal_failure_is_replayed_too(gate, baseline, store):
    number = shrunk(store, medoid_of(baseline))
    index = minimal_failure(store, store.campaigns.get(number)).index
    report = report_of(gate(BETTER, "--json"))
    known = {each["what"]: each["verdict"] for each in report["members"][0]["known"]}
    assert known[f"minimal failure {number}/{index}"] == "fixed"


def test_what_is_shrunk_while_a_gate_begins_does_not_stop_it(gate, baseline, store, monkeypatch):
    listed = Campaigns.list

    def list_and_shrink(self, state=None):
        found = [*listed(self, state)]
        if state == "done":
            shrunk(store, medoid_of(baseline))
        return iter(found)

    monkeypatch.setattr(Campaigns, "list", list_and_shrink)
    assert gate(BETTER, "--json").exit_code == 0


def test_a_planner_that_breaks_closes_the_gate(eigenfail, baseline, suite):
    file = suite()
    text = (
        file.read_text().replace('"idm"', '"test_raises"').replace("lane_half_width_m = 2.25", "")
    )
    file.write_text(text)
    done = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1", "--json")
    assert done.exit_code == 1, done.output
    report = report_of(done)
    assert set(report["counts"]) == {"cannot be run"}
    assert report["members"][0]["known"][0]["problem"].startswith("planner: ")


def test_members_that_the_baseline_lacks_are_told_and_not_judged(eigenfail, baseline, suite):
    file = suite(BETTER, more='[[campaigns]]\nname = "three"\nseed = 3\n')
    done = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1")
    assert done.exit_code == 0, done.output
    assert "three: It is not in the baseline." in done.stdout


def test_a_gate_can_be_the_next_baseline(eigenfail, gate, suite):
    gate(BETTER)
    words = ("--planner-version", "v3", "--baseline", "v2", "--json")
    worse = eigenfail("gate", suite(USUAL), *words)
    assert worse.exit_code == 1
    assert report_of(worse)["members"][0]["known"] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--baseline", "v0"), "'v0' holds none of the members of trio"),
        (("--baseline", "99"), "There is no campaign 99"),
        (("--baseline", ""), "baseline: is empty"),
        (("--baseline", "v2"), "'v2' is the version under test itself"),
        (("--baseline", "lost.toml"), "lost.toml: cannot be read"),
        (("--planner-version", "v 2"), "letters, digits"),
        (("--junit", "/nowhere/gate.xml"), "There is no folder /nowhere"),
    ],
)
def test_what_makes_no_sense_exits_with_2(eigenfail, suite, store, words, said):
    count = len(store.campaigns.page(100).items)
    refused = eigenfail("gate", suite(BETTER), "--planner-version", "v2", *words)
    assert refused.exit_code == 2, refused.output
    assert said in refused.stderr
    assert len(store.campaigns.page(100).items) == count


def test_another_question_is_refused(eigenfail, baseline, suite):
    file = suite()
    file.write_text(
        file.read_text().replace("[base]", "[base]\nscenario_parameters.distance_m = 53.0")
    )
    refused = eigenfail("gate", file, "--planner-version", "v2", "--baseline", "v1")
    assert refused.exit_code == 2
    assert "scenario_parameters of campaign 1, its baseline, differ" in refused.stderr


def test_a_baseline_that_is_not_finished_is_refused(eigenfail, suite, store):
    created = eigenfail("campaign", "create", one_of(suite), "--json")
    number = json.loads(created.stdout)["id"]
    store.campaigns.move(number, "paused")
    refused = eigenfail("gate", suite(), "--planner-version", "v2", "--baseline", number)
    assert refused.exit_code == 2, refused.output
    assert f"Campaign {number} of the baseline is paused" in refused.stderr


def one_of(suite):
    """The file of a campaign like the suite's first member."""
    file = suite(USUAL, "one.toml")
    file.write_text(
        'name = "trio: one"\nmethod = "monte_carlo"\nplanner = "idm"\nsimulator = "point_mass"\n'
        f"episodes = 16\nseed = 1\nplanner_settings.lane_half_width_m = {USUAL}\n"
    )
    return file


def test_a_dead_campaign_is_service_trouble(eigenfail, baseline, suite, service):
    class Deadly(type(service)):
        def run_some(self, campaign):
            if campaign.spec.name == "trio @ v2: two":
                self.store.campaigns.move(campaign.id, "dead", "The learner ended.")
            else:
                super().run_some(campaign)

    service.__class__ = Deadly
    done = eigenfail("gate", suite(BETTER), "--planner-version", "v2", "--baseline", "v1")
    assert done.exit_code == 3
    assert "is dead, so its gate proves nothing. The learner ended." in done.stderr


def test_a_service_elsewhere_needs_the_version_of_its_planner(eigenfail, suite):
    refused = eigenfail("gate", suite(), "--url", "http://127.0.0.1:8440")
    assert refused.exit_code == 2
    assert "planner-version" in refused.stderr


DIST_INFO = {
    "METADATA": "Metadata-Version: 2.1\nName: gated-planner\nVersion: 1.0\n",
    "entry_points.txt": "[eigenfail.planners]\ngated = gated_planner:Planner\n",
}
PLANNER = (
    "from eigenfail_workers.planners.idm import *\n\n\nclass Planner(IntelligentDriver):\n    {}\n"
)
BLIND = "def _leads(self, ego, other):\n        return False"


@pytest.mark.service
def test_with_a_service_of_its_own_changed_code_is_seen_and_judged(tmp_path):
    info = tmp_path / "gated_planner-1.0.dist-info"
    info.mkdir()
    for name, text in DIST_INFO.items():
        (info / name).write_text(text)
    code = tmp_path / "gated_planner.py"
    suite = tmp_path / "suite.toml"
    suite.write_text(
        'name = "own"\n[base]\nmethod = "monte_carlo"\nplanner = "gated"\nepisodes = 12\n'
        'simulator = "point_mass"\nplanner_settings.lane_half_width_m = 3.0\n[grid]\nseed = [1]\n'
    )

    def gate(*words):
        path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
        return subprocess.run(
            [EIGENFAIL, "gate", suite, "--workers", "1", "--data", "data", "--json", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )

    code.write_text(PLANNER.format("pass"))
    made = gate()
    assert made.returncode == 0, made.stderr
    version = json.loads(made.stdout)["gate"]["version"]
    code.write_text(PLANNER.format(BLIND))
    judged = gate("--baseline", version)
    assert judged.returncode == 1, judged.stderr
    report = json.loads(judged.stdout)
    assert report["gate"]["version"] != version
    rerun = report["members"][0]["rerun"]
    assert rerun["before"]["failures"] == 0 < rerun["now"]["failures"]
    assert rerun["counts"] == {"new": rerun["now"]["failures"]}


def test_where_the_scenario_varies_each_known_failure_is_replayed_in_its_own(eigenfail, tmp_path):
    file = tmp_path / "varied.toml"
    file.write_text(
        'name = "varied"\n[base]\nmethod = "monte_carlo"\nplanner = "idm"\nepisodes = 12\n'
        'simulator = "point_mass"\nscenario_parameters.distance_m = { uniform = [52.0, 70.0] }\n'
        "[grid]\nseed = [1]\n"
    )
    made = eigenfail("gate", file, "--planner-version", "v1", "--json")
    assert made.exit_code == 0, made.output
    known = report_of(made)["members"][0]["known"]
    medoids = [each for each in known if each["what"].startswith("medoid")]
    assert {each["verdict"] for each in medoids} == {"still failing"}

    def shown(episode):
        return json.loads(eigenfail("episode", "show", episode, "--json").stdout)

    for medoid in medoids:
        was, now = shown(medoid["was"]), shown(medoid["episode"])
        assert now["measures"] == was["measures"]
