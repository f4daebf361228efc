"""The commands against the real API: what they print, for people and for programs."""

import json
import os
import re
import signal
from types import SimpleNamespace

import httpx2
import msgspec
import numpy as np
import pytest

from eigenfail import replays
from eigenfail.cli import connection as places_module
from eigenfail.cli.doctor import check_workers, list_troubled_campaigns
from eigenfail.cli.render import INTERRUPTED
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_URL, Address, DataFolder
from eigenfail.hosting.service import Plan
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.operations import Arrival, Presence, Retention, Staffing
from eigenfail.versions import versions


def test_run_prints_the_result_table(check_session, spec_file):
    check_session("cli/run", ("run", spec_file))


def test_run_as_json_prints_the_summary_and_nothing_else(eigenfail, spec_file):
    done = eigenfail("run", spec_file, "--json", "--episodes", 9)
    summary = json.loads(done.stdout)
    assert (summary["campaign"], summary["counts"]["completed"]) == (1, 9)
    assert summary["cost"]["at_least_usd"] > 0


def test_the_gate_closes_when_failures_were_found(eigenfail, spec_file, done, store):
    assert store.campaigns.get(done).counts.failures > 0
    assert eigenfail("run", spec_file).exit_code == 0
    assert eigenfail("run", spec_file, "--gate").exit_code == 1
    assert eigenfail("campaign", "watch", done, "--gate").exit_code == 1
    assert eigenfail("campaign", "watch", done).exit_code == 0


def test_the_gate_opens_when_there_was_none(eigenfail, spec_file, store):
    calm = (
        spec_file.read_text() + "[disturbance]\nlateral_base_m = 1e-9\nlongitudinal_base_m = 1e-9"
    )
    spec_file.write_text(calm + "\nlateral_slope = 0.0\nlongitudinal_slope = 0.0\n")
    run = eigenfail("run", spec_file, "--gate", "--json")
    assert json.loads(run.stdout)["counts"]["failures"] == 0
    assert run.exit_code == 0


@pytest.mark.fault("campaign whose every episode errors")
def test_a_campaign_whose_every_episode_errored_exits_with_3_and_says_why(
    check_session, eigenfail, spec_file
):
    spec_file.write_text(spec_file.read_text().replace('"idm"', '"test_raises"'))
    check_session(
        "cli/errored",
        ("run", spec_file),
        ("campaign", "watch", 1),
        ("campaign", "list"),
        ("campaign", "show", 1),
    )
    assert eigenfail("run", spec_file, "--gate").exit_code == 3


@pytest.mark.fault("campaign with a name that the bridge does not know")
def test_a_campaign_that_the_service_paused_exits_with_3_and_says_why(
    check_session, eigenfail, spec_file, store
):
    eigenfail("campaign", "create", spec_file, "--episodes", 10)
    eigenfail("campaign", "pause", 1)
    assert eigenfail("campaign", "watch", 1).exit_code == 0
    eigenfail("campaign", "resume", 1)
    store.campaigns.move(1, CampaignState.PAUSED, "Worker w can run no episode.")
    check_session("cli/paused", ("campaign", "watch", 1), ("campaign", "show", 1))


@pytest.mark.fault("campaign resumed by another release")
def test_a_campaign_of_two_releases_shows_which_versions_changed(check_session, done, store):
    for version in ("9.9.8", "9.9.9"):
        store.campaigns.begin_part(done, {"eigenfail": version})
    check_session("cli/two_releases", ("campaign", "show", done))


@pytest.mark.fault("campaign whose every episode errors")
@pytest.mark.parametrize("word", ["errored", "failed"])
def test_errored_episodes_are_found_by_that_word_and_the_old_one(eigenfail, spec_file, word):
    spec_file.write_text(spec_file.read_text().replace('"idm"', '"test_raises"'))
    eigenfail("run", spec_file)
    listed = eigenfail("episode", "list", 1, "--outcome", word, "--json")
    assert "a stranger's bug" in json.loads(listed.stdout)[0]["problem"]
    filtered = eigenfail("episode", "list", 1, "--filter", f"outcome = {word}")
    assert filtered.stdout.split().count("errored") == 20


def test_a_gate_does_not_open_on_a_campaign_that_was_cut_short(
    check_session, eigenfail, spec_file, store
):
    eigenfail("campaign", "create", spec_file, "--episodes", 1000)
    check_session("cli/cut_short", ("campaign", "cancel", 1), ("campaign", "watch", 1, "--gate"))
    assert store.campaigns.get(1).state == "cancelled"


def test_a_dead_campaign_says_why(check_session, eigenfail, spec_file, store):
    eigenfail("campaign", "create", spec_file)
    store.campaigns.move(1, "dead", "Its learner could not go on.")
    check_session("cli/dead", ("campaign", "watch", 1), ("campaign", "resume", 1))


def test_the_life_of_a_campaign(eigenfail, spec_file):
    created = eigenfail("campaign", "create", spec_file, "--episodes", 1000, "--json")
    assert json.loads(created.stdout)["id"] == 1
    states = {}
    for verb in ("show", "pause", "show", "resume", "cancel", "show"):
        step = eigenfail("campaign", verb, 1, "--json")
        assert step.exit_code == 0, step.output
        told = json.loads(step.stdout)
        states[verb] = (told if verb == "show" else told[0])["state"]
    assert states == {
        "pause": "pausing",
        "resume": "queued",
        "cancel": "cancelling",
        "show": "cancelled",
    }


def test_campaigns_are_listed_newest_first(check_session, eigenfail, spec_file, done):
    named = 'name = "[bold red]x[/] <b>"\n' + spec_file.read_text()
    spec_file.write_text(named)
    eigenfail("campaign", "create", spec_file, "--episodes", 1000)
    ended = json.loads(eigenfail("campaign", "list", "--state", "done", "--json").stdout)
    assert [campaign["id"] for campaign in ended] == [done]
    check_session(
        "cli/campaigns",
        ("campaign", "create", spec_file, "--seed", 5, "--priority", "low"),
        ("campaign", "list"),
        ("campaign", "list", "--limit", 1),
        ("campaign", "show", done),
        ("campaign", "show", 3),
        ("campaign", "priority", 2, "high"),
        ("campaign", "priority", 2, "urgent"),
    )


def test_equal_campaigns_have_equal_digests(eigenfail, spec_file, done):
    eigenfail("run", spec_file)
    eigenfail("run", spec_file, "--seed", 2)
    digests = [eigenfail("campaign", "digest", number).stdout.strip() for number in (1, 2, 3)]
    assert digests[0] == digests[1] != digests[2]
    assert len(digests[0]) == 64
    assert json.loads(eigenfail("campaign", "digest", 1, "--json").stdout)["digest"] == digests[0]


def test_episodes_are_listed_and_shown(check_session, eigenfail, done):
    rows = json.loads(eigenfail("episode", "list", done, "--limit", 100, "--json").stdout)
    assert [row["index"] for row in rows] == list(range(24))
    crashes = json.loads(
        eigenfail("episode", "list", done, "--outcome", "collision", "--json").stdout
    )
    assert {row["outcome"] for row in crashes} == {"collision"}
    first = f"{done}/{crashes[0]['index']}"
    shown = json.loads(eigenfail("episode", "show", first, "--json").stdout)
    assert len(shown["noise"]["z"]) == shown["steps"]
    check_session("cli/episodes", ("episode", "list", done), ("episode", "show", first))


def test_a_stored_episode_replays_to_the_same_digest(check_session, eigenfail, done):
    replayed = eigenfail("episode", "replay", f"{done}/3", "--json")
    assert replayed.exit_code == 0, replayed.output
    comparison = json.loads(replayed.stdout)
    assert comparison["same"]
    assert comparison["digest"] == comparison["stored_digest"]
    check_session("cli/replay/same", ("episode", "replay", f"{done}/3"))


def test_an_episode_without_noise_is_drawn_again_from_its_seed(
    check_session, eigenfail, done, store
):
    stored = json.loads(eigenfail("episode", "replay", f"{done}/3", "--json").stdout)
    assert store.retention.prune(done, Retention(keep_every=2), "test")
    drawn = eigenfail("episode", "replay", f"{done}/3", "--json")
    assert drawn.exit_code == 0, drawn.output
    assert json.loads(drawn.stdout) == stored
    check_session("cli/replay/pruned", ("episode", "show", f"{done}/3"))


def test_an_episode_that_varies_shows_and_replays_what_it_drew(eigenfail, spec_file):
    varied = "[scenario_parameters]\ndistance_m = { uniform = [52, 70] }\n"
    spec_file.write_text(spec_file.read_text() + varied)
    assert eigenfail("run", spec_file).exit_code == 0
    replayed = json.loads(eigenfail("episode", "replay", "1/3", "--json").stdout)
    assert replayed["same"]
    explained = eigenfail("episode", "explain", "1/3")
    assert explained.exit_code == 0, explained.output
    shown = [eigenfail("episode", "show", f"1/{index}").stdout for index in (3, 4)]
    drawn = [re.search(r"scenario +distance_m = (\S+)", text)[1] for text in shown]
    assert 52.0 <= float(drawn[0]) != float(drawn[1]) <= 70.0


def test_a_replay_that_differs_exits_with_1(check_session, done, monkeypatch):
    load = replays.load_engine
    monkeypatch.setattr(replays, "load_engine", lambda: lambda setup: Shifted(load()(setup)))
    check_session("cli/replay/differs", ("episode", "replay", f"{done}/3"))


@pytest.mark.parametrize(
    ("numpy", "words"),
    [("0.1", f"numpy 0.1 then, {np.__version__} now"), (np.__version__, "something is left to")],
)
def test_a_replay_that_differs_says_under_which_versions(
    *, eigenfail, spec_file, store, monkeypatch, numpy, words
):
    there = versions() | {"numpy": numpy}
    store.roster.arrived([Arrival(worker="by hand", host="", pid=1, versions=there)])
    assert eigenfail("run", spec_file).exit_code == 0
    load = replays.load_engine
    monkeypatch.setattr(replays, "load_engine", lambda: lambda setup: Shifted(load()(setup)))
    told = " ".join(eigenfail("episode", "replay", "1/3").stdout.split())
    assert words in told
    found = json.loads(eigenfail("episode", "replay", "1/3", "--json").stdout)
    assert len(found["differing"]) == (numpy == "0.1")


class Shifted:
    """An engine that is not the one of old: it runs the task with another seed's noise."""

    def __init__(self, engine):
        self.engine = engine

    def run(self, tasks):
        return self.engine.run(
            [type(t)(t.index, t.seed, t.source.__class__(-t.source.z)) for t in tasks]
        )

    def close(self):
        self.engine.close()


def test_a_replay_without_the_world_says_what_to_install(check_session, done, monkeypatch):
    def missing(group, name):
        raise InvalidValue("engine", "'default' cannot be loaded: No module named 'osqp'.")

    monkeypatch.setattr(replays.plugins, "load", missing)
    check_session("cli/replay/without_world", ("episode", "replay", f"{done}/3"))


def test_an_episode_is_written_with_a_slash(check_session):
    wrong = ("3", "a/b", "1/", "/1", "1/-1", "1/2/3", "../etc")
    check_session("cli/errors/episode_ids", *(("episode", "show", "--", each) for each in wrong))


def test_failures_are_grouped_replayed_and_counted(check_session, eigenfail, done, store):
    check_session("cli/analyze/prove", ("analyze", done, "--clusters", 2, "--prove"))
    replays = store.analyses.replays(1)
    *in_scenarios, search = map(store.campaigns.get, replays)
    assert [each.counts.completed for each in in_scenarios] == [4, 4, 4]
    # The centres of both modes do not fail.
    assert (search.spec.method, search.counts.completed) == ("nearest", 28)
    found = json.loads(eigenfail("analyze", done, "--clusters", 2, "--json").stdout)
    assert len(found["analysis"]["result"]["modes"]) == 2
    assert found["proof"] is None


def test_it_is_said_in_which_scenarios_to_replay(check_session, eigenfail, done, store):
    words = ("--prove", "--variation", "distance_m = 55.0", "--variation", "", "--json")
    told = eigenfail("analyze", done, "--clusters", 2, *words)
    proof = json.loads(told.stdout)["proof"]
    assert [each["scenario_parameters"] for each in proof["scenarios"]] == [
        {"distance_m": 55.0},
        {},
    ]
    assert proof["reproduced"]["rate"]["n"] == 2
    assert proof["medoids"]["rate"]["n"] == 4
    wrong = ("distance_m", "distance_m = 1.0", "distance = 55.0")
    asked = (("analyze", done, "--prove", "--variation", each) for each in wrong)
    check_session("cli/errors/variations", *asked)


def test_without_failures_there_is_nothing_to_analyse(check_session, eigenfail, spec_file, store):
    eigenfail("campaign", "create", spec_file)
    store.campaigns.move(1, "cancelled")
    check_session("cli/analyze/nothing", ("analyze", 1))


def test_what_does_not_exist_exits_with_2(check_session):
    check_session(
        "cli/errors/unknown_ids",
        ("campaign", "show", 99),
        ("campaign", "pause", 99),
        ("campaign", "digest", 99),
        ("campaign", "watch", 99),
        ("episode", "list", 99),
        ("episode", "show", "99/0"),
        ("episode", "replay", "99/0"),
        ("analyze", 99),
    )


@pytest.mark.usefixtures("without_plugins")
def test_a_wrong_file_is_refused_before_anything_is_asked(check_session, spec_file, store):
    text = spec_file.read_text()
    spec_file.write_text("epsiodes = 3")
    check_session("cli/errors/field", ("run", spec_file), ("campaign", "create", spec_file))
    spec_file.write_text(text.replace("monte_carlo", "monte_calro"))
    check_session("cli/errors/method", ("run", spec_file))
    assert store.campaigns.page(10).items == ()


def test_ctrl_c_pauses_the_campaign_and_says_how_to_go_on(eigenfail, spec_file, service, store):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    service.__class__ = Interrupting
    stopped = eigenfail("run", spec_file)
    assert stopped.exit_code == INTERRUPTED
    assert store.campaigns.get(1).state == "paused"
    assert "is paused after" in stopped.stderr
    assert "eigenfail campaign resume 1" in stopped.stderr
    assert eigenfail("campaign", "resume", 1).exit_code == 0
    assert eigenfail("campaign", "watch", 1).exit_code == 0
    assert store.campaigns.get(1).counts.completed == 24


def test_nobody_there_exits_with_3_and_the_remedy(check_session, service, monkeypatch):
    def refuse(request):
        raise httpx2.ConnectError("refused")

    monkeypatch.setattr(service, "handle_request", refuse)
    words = ("campaign", "list", "--url")
    check_session("cli/errors/address", (*words, "http://127.0.0.1:1"), (*words, "http://[::"))


def test_the_doctor_finds_what_is_there(eigenfail, tmp_path):
    told = eigenfail("doctor", "--json", "--data", tmp_path)
    assert told.exit_code == 0, told.output
    found = {finding["what"]: finding["found"] for finding in json.loads(told.stdout)}
    assert "monte_carlo" in found["eigenfail.methods"]
    assert "rulebook" in found["eigenfail.planners"]
    assert found["service http://127.0.0.1:8440"] == "answers"
    assert str(tmp_path) in found["data folder"]
    assert "eigenfail.planners" in eigenfail("doctor", "--data", tmp_path).stdout


def test_the_doctor_names_the_address_that_it_asked(eigenfail, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = DataFolder(tmp_path / "eigenfail-data")
    with folder.claimed():
        folder.publish(Address("http://127.0.0.1:8512", "tcp://127.0.0.1:8513"))
        told = eigenfail("doctor", "--json")
    assert told.exit_code == 0, told.output
    found = {finding["what"]: finding["found"] for finding in json.loads(told.stdout)}
    assert found["service http://127.0.0.1:8512"] == "answers"
    assert "service http://127.0.0.1:8440" not in found


def there(version):
    times = {"arrived_ms": 0, "heard_ms": 0}
    return Presence(id=1, worker="w", host="h", pid=7, versions={"eigenfail": version}, **times)


ASKED = "4 workers asked of Ray, none placed yet."


@pytest.mark.parametrize(
    ("here", "states", "said", "found", "wrong"),
    [
        ((), (), "", "no workers are connected", False),
        ((), ("queued",), "", "no workers are connected, and campaigns are waiting", True),
        (
            (),
            ("running",),
            ASKED,
            f"no workers are connected, and campaigns are waiting. {ASKED}",
            True,
        ),
        ((there("1.0.0"),), ("running",), ASKED, "1 connected", False),
        (
            (there("1.0.0"), there("1.0.1"), there("1.0.0")),
            (),
            "",
            "3 connected, of eigenfail 1.0.0 and 1.0.1",
            False,
        ),
    ],
)
def test_the_doctor_says_whether_anybody_works(here, states, said, found, wrong):
    campaigns = SimpleNamespace(list=lambda state: [1] if state in states else [])
    client = SimpleNamespace(
        present_workers=lambda: here,
        campaigns=campaigns,
        staffing=lambda: Staffing(workers=len(here), said=said),
    )
    finding = check_workers(client)
    assert (finding.found, finding.wrong) == (found, wrong)


def test_the_doctor_says_what_is_wrong(eigenfail, tmp_path):
    (tmp_path / "file").write_text("")
    told = eigenfail("doctor", "--json", "--data", tmp_path / "file" / "data")
    assert told.exit_code == 3
    (wrong,) = [finding for finding in json.loads(told.stdout) if finding["wrong"]]
    assert wrong["what"] == "data folder"


@pytest.mark.parametrize(
    ("source", "places"),
    [("DEFAULT", [DEFAULT_URL]), ("COMMANDLINE", []), ("ENVIRONMENT", [])],
)
def test_a_folder_that_is_named_keeps_the_campaign_away_from_other_services(
    tmp_path, source, places
):
    found = SimpleNamespace(name=source)
    context = SimpleNamespace(get_parameter_source=lambda _: found)
    assert list(places_module._list_addresses(context, Plan(tmp_path, 0))) == places


@pytest.mark.parametrize(
    ("changes", "workers", "told"),
    [
        ({"method": "ast"}, 20, []),
        (
            {"method": "ast"},
            21,
            [("runs at most 20 episodes at a time, and 21 workers are connected", "= 21")],
        ),
        (
            {"method": "ast", "episodes": 2000},
            500,
            [("runs at most 20 episodes at a time, and 500 workers are connected", "12 or more")],
        ),
        ({"method": "ast", "parallel": 30}, 50, []),
        (
            {"method": "subset", "episodes": 20_000},
            220,
            [("runs at most 219 episodes at a time, and 220 workers are connected", "--seeds N")],
        ),
        (
            {"method": "cem", "settings": {"batch": 10}},
            11,
            [("runs at most 10 episodes at a time, and 11 workers are connected", "--seeds N")],
        ),
        ({"method": "ast", "stop": {"failures": 3}}, 500, []),
        ({"method": "somewhere_else"}, 500, []),
    ],
)
def test_the_doctor_says_when_campaigns_are_too_narrow_for_the_workers(changes, workers, told):
    spec = msgspec.convert({"name": "n", "episodes": 1000} | changes, CampaignSpec)
    campaign = SimpleNamespace(id=7, spec=spec)
    client = SimpleNamespace(
        staffing=lambda: SimpleNamespace(stranded=()),
        present_workers=lambda: (None,) * workers,
        campaigns=SimpleNamespace(list=lambda _state: iter((campaign,))),
    )
    findings = list(list_troubled_campaigns(client))
    assert [one.found for one in findings] == [found for found, _ in told]
    assert all(one.remedy.endswith(end) for one, (_, end) in zip(findings, told, strict=True))
    assert not any(one.wrong for one in findings)


def test_campaigns_are_labelled_in_a_file_and_found_by_labels(eigenfail, spec_file):
    eigenfail("campaign", "create", spec_file)
    labels = 'project = "lane keeping"\ntags = ["a", "b"]\nplanner_version = "v2"\n'
    spec_file.write_text(spec_file.read_text() + labels)
    shown = eigenfail("campaign", "create", spec_file)
    assert "lane keeping" in shown.stdout
    assert "a, b" in shown.stdout
    for option in (("--project", "lane keeping"), ("--tag", "b"), ("--planner-version", "v2")):
        found = json.loads(eigenfail("campaign", "list", *option, "--json").stdout)
        assert [each["id"] for each in found] == [2], option
