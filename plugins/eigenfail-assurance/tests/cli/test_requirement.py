"""`eigenfail requirement` against the real API, and once with a service of its own."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from eigenfail.cli.render import INTERRUPTED

EIGENFAIL = Path(sys.executable).parent / "eigenfail"
SEARCH = ("--target", 0.3, "--low", 0.05, "--high", 2, "--tolerance", 1, "--budget", 24)
JOINT = (*SEARCH, "--channels", "longitudinal,lateral", "--points", 2)


def ask(eigenfail, *words):
    done = eigenfail("requirement", *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_the_answer_is_a_table_with_sentences(check_session, spec_file):
    check_session("cli/requirement/scale", ("requirement", spec_file, *SEARCH))


def test_two_channels_have_a_frontier(check_session, spec_file):
    check_session("cli/requirement/frontier", ("requirement", spec_file, *JOINT))


def test_every_error_is_a_campaign_that_is_run_once(eigenfail, spec_file, store):
    first = ask(eigenfail, spec_file, *SEARCH)
    (limit,) = first["answer"]["limits"]
    campaigns = store.campaigns.page(100).items
    assert len(campaigns) == len(first["answer"]["anchors"]) == len(limit["tests"])
    scales = [campaign.spec.disturbance.scale for campaign in reversed(campaigns)]
    assert scales == limit["tests"]
    assert {campaign.spec.seed for campaign in campaigns} == {1}
    for anchor in first["answer"]["anchors"]:
        met = anchor["multiples"]["scale"] <= limit["largest"]
        assert (anchor["verdict"] == "met") is met
    assert ask(eigenfail, spec_file, *SEARCH) == first
    assert len(store.campaigns.page(100).items) == len(campaigns)


def test_another_budget_is_another_search(eigenfail, spec_file, store):
    ask(eigenfail, spec_file, *SEARCH)
    before = len(store.campaigns.page(100).items)
    ask(eigenfail, spec_file, *SEARCH[:-1], 25)
    assert len(store.campaigns.page(100).items) > before


def test_the_page_holds_the_answer_and_its_pictures(eigenfail, spec_file, tmp_path):
    page = tmp_path / "sensor.html"
    answer = ask(eigenfail, spec_file, *JOINT, "--output", page)
    text = page.read_text()
    for sentence in answer["conclusions"][:2]:
        assert sentence in text
    pictures = [f"<svg{part.partition('</svg>')[0]}</svg>" for part in text.split("<svg")[1:]]
    assert len(pictures) == 3
    shown = [ET.fromstring(picture) for picture in pictures]
    marks = {"●", "○", "×"}
    verdicts = {"met": "●", "undecided": "○", "not met": "×"}
    texts = [each.text for each in shown[0].iter() if each.text in marks]
    assert sorted(texts) == sorted(verdicts[one["verdict"]] for one in answer["answer"]["anchors"])
    assert any(each.text == "the campaign's sensor" for each in shown[0].iter())
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    kept = eigenfail("requirement", spec_file, *JOINT, "--output", page)
    assert kept.exit_code == 2
    assert "exists already" in kept.stderr
    assert eigenfail("requirement", spec_file, *JOINT, "-o", page, "--force").exit_code == 0
    assert page.read_text() == text


def test_ctrl_c_pauses_the_campaign_and_the_same_command_goes_on(
    eigenfail, spec_file, service, store
):
    class Interrupting(type(service)):
        def run_some(self, campaign):
            super().run_some(campaign)
            if campaign.id == 3 and campaign.counts.completed == 0:
                os.kill(os.getpid(), signal.SIGINT)

    service.__class__ = Interrupting
    search = (*SEARCH[:-1], 96)
    stopped = eigenfail("requirement", spec_file, *search)
    assert stopped.exit_code == INTERRUPTED
    assert "1 paused" in stopped.stderr
    assert "To continue: rerun the same command" in stopped.stderr
    assert store.campaigns.get(3).state == "paused"
    assert eigenfail("requirement", spec_file, *search).exit_code == 0
    assert store.campaigns.get(3).counts.completed == 96


def test_a_campaign_that_completes_nothing_says_nothing(check_session, spec_file):
    spec_file.write_text(spec_file.read_text().replace('"idm"', '"test_raises"'))
    check_session("cli/requirement/errored", ("requirement", spec_file, *SEARCH))


def test_a_question_that_makes_no_sense_exits_with_2(check_session, spec_file, store):
    wrong = (
        (),
        ("--target", 1.5),
        ("--target", "small"),
        (*SEARCH, "--low", 3),
        (*SEARCH, "--tolerance", 0),
        (*SEARCH, "--channels", "latral"),
        (*SEARCH, "--channels", "lateral,missed"),
        (*SEARCH, "--channels", ""),
        (*SEARCH, "--points", 1),
        (*SEARCH, "--confidence", 1),
        (*SEARCH, "--budget", 10),
    )
    check_session("cli/errors/requirement", *(("requirement", spec_file, *each) for each in wrong))
    assert store.campaigns.page(10).items == ()


def test_a_method_that_bounds_no_probability_is_refused(eigenfail, spec_file):
    spec_file.write_text(spec_file.read_text().replace("monte_carlo", "cem"))
    refused = eigenfail("requirement", spec_file, *SEARCH)
    assert refused.exit_code == 2
    assert "method: 'cem' gives no estimate of P(failure) with an interval." in refused.stderr
    assert "Take subset or mixture" in refused.stderr


@pytest.mark.service
def test_a_search_on_a_service_of_its_own(spec_file, tmp_path):
    words = ("requirement", spec_file, *SEARCH, "--json")
    place = ("--data", tmp_path / "data", "--workers", 1)
    done = subprocess.run(
        [EIGENFAIL, *map(str, (*words, *place))], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (limit,) = json.loads(done.stdout)["answer"]["limits"]
    assert 0.05 <= limit["largest"] < 2.0
