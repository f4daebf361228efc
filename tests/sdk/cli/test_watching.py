"""`--watch`: one place in a terminal, lines in a pipe, and an end with the campaigns."""

import json

import pytest


@pytest.fixture
def queued(eigenfail, spec_file):
    """The id of a campaign that is at work as long as somebody looks."""
    made = eigenfail("campaign", "create", spec_file, "--json")
    return json.loads(made.stdout)["id"]


def test_in_a_pipe_it_is_lines_and_then_the_page(eigenfail, queued):
    done = eigenfail("campaign", "show", queued, "--watch")
    lines = done.stdout.splitlines()
    assert done.exit_code == 0
    assert lines[0].startswith(f"campaign {queued} (monte_carlo) running: ")
    assert lines[1].startswith(f"campaign {queued} (monte_carlo) done: 24/24 episodes")
    assert lines[2].split() == ["campaign", f"{queued}:", "quick"]
    assert "\x1b" not in done.stdout


def test_a_list_is_watched_until_all_in_it_are_at_rest(eigenfail, queued, spec_file):
    other = json.loads(eigenfail("campaign", "create", spec_file, "--json").stdout)["id"]
    done = eigenfail("campaign", "list", "--watch")
    lines = done.stdout.splitlines()
    for campaign in (queued, other):
        assert any(line.startswith(f"campaign {campaign} (monte_carlo) done") for line in lines)
    assert lines[-1].split()[0] == str(queued)
    assert "24/24" in lines[-1]


def test_a_program_gets_each_change_on_a_line(eigenfail, queued):
    done = eigenfail("campaign", "show", queued, "--watch", "--json")
    seen = [json.loads(line) for line in done.stdout.splitlines()]
    counts = [each["counts"]["completed"] for each in seen]
    assert counts == sorted(set(counts))
    assert seen[-1]["state"] == "done"
    assert all(each["state"] == "running" for each in seen[:-1])


def test_a_terminal_is_drawn_over(eigenfail, queued, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    done = eigenfail("campaign", "show", queued, "--watch")
    assert done.exit_code == 0
    assert "\x1b[2K" in done.stdout
    assert "24 completed of 24" in done.stdout


def test_what_is_at_rest_is_shown_once(eigenfail, done):
    shown = eigenfail("campaign", "show", done, "--watch", "--json").stdout.splitlines()
    assert len(shown) == 1
    assert json.loads(shown[0])["id"] == done
