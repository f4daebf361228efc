"""The story of docs/fix_a_planner.md, from failures that are found to a gate that turns green."""

import json
import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[4] / "docs" / "fix_a_planner.md").read_text()
SUITE, FIX = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
BASELINE, LISTS, LOOKS, JUDGEMENT = (
    [line.split()[1:] for line in block.splitlines()]
    for block in re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
)


@pytest.fixture
def store(empty_store):
    """Nothing was gated before the story begins."""
    return empty_store


@pytest.fixture
def follow(eigenfail, tmp_path, monkeypatch):
    """Runs a command of the page as it stands there; its exit code is to be 0."""
    monkeypatch.chdir(tmp_path)

    def run(words, *more):
        done = eigenfail(*words, *more)
        assert done.exit_code == 0, done.output
        return done.stdout

    return run


def test_the_story_ends_with_a_green_gate(follow, tmp_path):
    file = tmp_path / "lane_keeper.toml"
    file.write_text(SUITE)
    follow(*BASELINE)
    for words in LISTS:
        follow(words)
    listed, shown = LOOKS
    worst, *_ = json.loads(follow(listed, "--json"))
    assert worst["outcome"] == "collision"
    follow([*shown[:-1], f"1/{worst['index']}"])
    failures = json.loads(follow(["campaign", "show", "1", "--json"]))["counts"]["failures"]
    assert failures == 18, "the page says that eighteen of the 40 episodes fail"
    file.write_text(SUITE + FIX)
    report = json.loads(follow(*JUDGEMENT, "--json"))
    assert report["counts"].get("new", 0) == 0
    assert report["counts"]["fixed"] >= failures
    (member,) = report["members"]
    assert member["rerun"]["now"]["failures"] == 0


def test_a_fix_that_is_none_keeps_the_gate_open_but_fixes_nothing(follow, tmp_path):
    file = tmp_path / "lane_keeper.toml"
    file.write_text(SUITE)
    follow(*BASELINE)
    file.write_text(SUITE + FIX.replace("3.0", "2.25"))
    report = json.loads(follow(*JUDGEMENT, "--json"))
    assert "fixed" not in report["counts"]
    assert report["counts"]["still failing"] > 0
