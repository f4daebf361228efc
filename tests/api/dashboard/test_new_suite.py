"""The page that launches a suite: its file is previewed, refused by line or field, and launched."""

import html
import json
import re
from pathlib import Path

import pytest

from eigenfail_api import concurrency

PAGE = "/launch/suite"
KEY = re.compile(r'data-key="([^"]*)"')
BODY = re.compile(r'data-body="([^"]*)"')
EXAMPLE = Path(__file__).parents[3] / "examples" / "suite.toml"
SUITE = """
name = "two by two"
[base]
method = "monte_carlo"
episodes = 20
simulator = "point_mass"
[grid]
seed = [1, 2]
planner = ["idm", "rulebook"]
"""


@pytest.fixture
def draw(http):
    def post(text):
        answer = http.post(PAGE, data={"toml": text, "wish": "check"})
        assert answer.status_code == 200, answer.text
        return answer.text

    return post


def test_a_suite_is_previewed_and_launched(draw, http, store, golden):
    page = draw(SUITE)
    golden.check_page("dashboard/new_suite/valid", page)
    assert KEY.search(page)[1]
    assert 'data-page="/suites/two%20by%20two"' in page
    made = http.post("/api/v1/suites", json=json.loads(html.unescape(BODY.search(page)[1])))
    assert made.status_code == 201, made.text
    assert len(store.campaigns.page(10).items) == 4


def test_refused_members_are_marked_and_named_once(draw, golden):
    page = draw(SUITE.replace("[1, 2]", "[1, 2]\nsettings.round_size = [5, 0]"))
    golden.check_page("dashboard/new_suite/refused_members", page)
    assert not KEY.search(page)[1]


def test_the_example_and_members_that_build_upon_others_are_valid(draw):
    follower = '[[campaigns]]\nmethod = "replay"\nsettings.campaign = "first"'
    listed = f'[[campaigns]]\nname = "first"\n{follower}'
    for text in (EXAMPLE.read_text(), SUITE[: SUITE.index("[grid]")] + listed):
        assert KEY.search(draw(text))[1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "name: "),
        ("name = ", "The file is not TOML: Invalid value (at end of document)"),
        (SUITE.replace("[base]", "[base"), "at line 3"),
        (".".join(["a"] * 3_000) + " = 1", "The file is nested too deeply."),
        (f"x = {'9' * 5_000}", "The file is not TOML"),
        ('name = "one"\nmethod = "cem"\nepisodes = 5', "describes a campaign, not a suite"),
        (SUITE.replace("[grid]", "[gird]"), "Did you mean 'grid'"),
        (SUITE.replace("20", "inf"), "episodes"),
        (SUITE.replace("[1, 2]", "3"), "grid.seed: Is not a list."),
        (SUITE.replace("[1, 2]", f"[{','.join(map(str, range(600)))}]"), "more than 1000"),
        (SUITE.replace("two by two", "a: b"), "name: A campaign"),
        (SUITE.replace('"monte_carlo"', '"monte_karlo"'), "Did you mean 'monte_carlo'"),
    ],
    ids=str,
)
def test_a_file_that_cannot_be_launched_is_refused_by_line_or_field(draw, text, words):
    page = draw(text)
    assert words in html.unescape(page)
    assert not KEY.search(page)[1]


def test_markup_in_a_file_is_text(draw):
    assert "<script>x" not in draw(SUITE.replace("two", "<script>x</script></textarea>"))


def test_a_crowd_of_forms_is_refused(http, monkeypatch):
    monkeypatch.setattr(concurrency, "MOST_WAITING", -concurrency.MOST_RUNNING)
    assert http.post(PAGE, data={"toml": SUITE}).status_code == 503
