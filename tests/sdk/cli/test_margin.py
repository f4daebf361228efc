"""`eigenfail margin` against the real API, and once with a service of its own."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from eigenfail.cli.render import INTERRUPTED

EIGENFAIL = Path(sys.executable).parent / "eigenfail"
SEARCH = ("--low", 0.05, "--high", 2, "--tolerance", 0.5, "--budget", 12)
SCALES = [0.05, 0.5375, 1.025, 2.0]


def test_the_steps_are_a_table_with_a_sentence(check_session, spec_file):
    check_session("cli/margin/steps", ("margin", spec_file, *SEARCH))


def test_every_step_ends_with_its_first_failure_and_is_tried_once(eigenfail, spec_file, store):
    first = eigenfail("margin", spec_file, *SEARCH, "--json")
    margin = json.loads(first.stdout)["margin"]
    assert [step["scale"] for step in margin["steps"]] == SCALES
    assert margin["largest_safe"]["scale"] == 0.5375
    assert margin["smallest_unsafe"]["scale"] == 1.025
    campaigns = store.campaigns.page(10).items
    assert [campaign.spec.disturbance.scale for campaign in campaigns] == [0.5375, 1.025, 2, 0.05]
    assert {campaign.spec.stop.failures for campaign in campaigns} == {1}
    assert {campaign.spec.seed for campaign in campaigns} == {1}
    assert eigenfail("margin", spec_file, *SEARCH, "--json").stdout == first.stdout
    assert len(store.campaigns.page(10).items) == 4


def test_a_target_is_shown_or_undecided_or_missed(check_session, eigenfail, spec_file, store):
    search = (*SEARCH, "--target", 0.3)
    check_session("cli/margin/target", ("margin", spec_file, *search))
    (decisive,) = {one.spec.stop.failures for one in store.campaigns.page(10).items}
    assert decisive == 8  # of 12: [34.9, 90.1] %
    assert len(store.campaigns.page(10).items) == 4
    eigenfail("margin", spec_file, *search)
    assert len(store.campaigns.page(10).items) == 4


def test_an_earlier_search_is_made_use_of(eigenfail, spec_file, store):
    eigenfail("margin", spec_file, *SEARCH)
    finer = eigenfail("margin", spec_file, *SEARCH[:5], 0.3, *SEARCH[6:], "--json")
    assert len(json.loads(finer.stdout)["margin"]["steps"]) == 5
    assert len(store.campaigns.page(10).items) == 5
    other_budget = eigenfail("margin", spec_file, *SEARCH[:-1], 11)
    assert other_budget.exit_code == 0
    assert len(store.campaigns.page(10).items) == 9


def test_ctrl_c_pauses_the_step_and_the_same_command_goes_on(eigenfail, spec_file, service, store):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.id == 3 and campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    service.__class__ = Interrupting
    search = (*SEARCH[:-1], 48)
    stopped = eigenfail("margin", spec_file, *search)
    assert stopped.exit_code == INTERRUPTED
    assert "1 paused" in stopped.stderr
    assert "To continue: rerun the same command" in stopped.stderr
    assert store.campaigns.get(3).state == "paused"
    assert eigenfail("margin", spec_file, *search).exit_code == 0
    assert store.campaigns.get(3).counts.completed == 48
    assert [campaign.id for campaign in store.campaigns.page(10).items] == [4, 3, 2, 1]


def test_a_step_that_completes_nothing_says_nothing(check_session, spec_file):
    spec_file.write_text(spec_file.read_text().replace('"idm"', '"test_raises"'))
    check_session("cli/margin/errored", ("margin", spec_file, *SEARCH))


def test_a_search_that_makes_no_sense_exits_with_2(check_session, spec_file, store):
    wrong = (
        ("--low", 2, "--high", 1),
        ("--high", 11),
        ("--tolerance", 0),
        ("--budget", 0),
        ("--target", 0.9),
        (*SEARCH, "--target", 0.01),
    )
    check_session("cli/errors/margin", *(("margin", spec_file, *search) for search in wrong))
    assert store.campaigns.page(10).items == ()


@pytest.mark.service
def test_a_search_on_a_service_of_its_own_stops_at_the_first_failure(spec_file, tmp_path):
    spec_file.write_text(spec_file.read_text() + "[settings]\nround_size = 4\n")
    words = ("margin", spec_file, "--low", 0.05, "--high", 3, "--tolerance", 3, "--json")
    place = ("--data", tmp_path / "data", "--workers", 1)
    done = subprocess.run(
        [EIGENFAIL, *map(str, (*words, *place))], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    safe, failing = json.loads(done.stdout)["margin"]["steps"]
    assert (safe["episodes"], safe["failures"]) == (24, 0)
    assert failing["episodes"] < 24
    assert failing["failures"] >= 1
