"""Finding and exporting episodes at the command line."""

import csv
import json

import pytest


def test_episodes_are_filtered_sorted_and_cut_to_columns(eigenfail, done):
    asked = ("--filter", "outcome = collision", "--sort", "-log_probability", "--limit", 100)
    rows = json.loads(eigenfail("episode", "list", done, *asked, "--json").stdout)
    likely = [row["log_probability"] for row in rows]
    assert len(rows) > 1
    assert likely == sorted(likely, reverse=True)
    assert {row["outcome"] for row in rows} == {"collision"}
    fields = ("--fields", "index,class,robustness_m")
    picked = json.loads(eigenfail("episode", "list", done, *asked, *fields, "--json").stdout)
    assert [row["index"] for row in picked] == [row["index"] for row in rows]
    assert list(picked[0]) == ["index", "class", "robustness_m"]
    header, *lines = eigenfail("episode", "list", done, *asked, *fields).stdout.splitlines()
    assert header.split() == ["index", "class", "robustness_m"]
    assert lines[1].split()[0] == str(rows[0]["index"])
    assert "more" not in lines[-1]


def test_a_list_says_that_it_was_cut(check_session, eigenfail, done):
    check_session("cli/episodes_cut", ("episode", "list", done, "--limit", 2))
    assert len(json.loads(eigenfail("episode", "list", done, "--limit", 2, "--json").stdout)) == 2


def test_episodes_are_exported(eigenfail, done, tmp_path):
    path = tmp_path / "failures.csv"
    asked = ("--filter", "outcome = collision", "--sort", "-index", "--fields", "index,worker")
    written = eigenfail("episode", "export", done, "-o", path, *asked)
    assert written.exit_code == 0, written.output
    assert f"Wrote {path}." in written.stderr
    indices = [int(row["index"]) for row in csv.DictReader(path.read_text().splitlines())]
    listed = eigenfail("episode", "list", done, "--outcome", "collision", "--json", "--limit", 100)
    assert indices == [row["index"] for row in json.loads(listed.stdout)][::-1]


def test_an_export_is_told_of_as_json(eigenfail, done, tmp_path):
    path = tmp_path / "all.csv"
    told = json.loads(eigenfail("episode", "export", done, "-o", path, "--json").stdout)
    assert told == {"file": str(path), "size_bytes": path.stat().st_size}


def test_what_is_wrong_is_told_and_ends_with_2(check_session, done):
    wrong = (
        ("list", "--filter", "sevrity > 3"),
        ("list", "--filter", "severity >"),
        ("list", "--sort", "worst"),
        ("list", "--fields", "indx"),
        ("export", "-o", "a.xlsx"),
        ("export", "-o", "a.csv", "--noise"),
    )
    asked = (("episode", words[0], done, *words[1:]) for words in wrong)
    check_session("cli/errors/episodes", *asked)


@pytest.mark.parametrize("name", ["one.poses", "one.gif"])
@pytest.mark.usefixtures("tiny_formats")
def test_an_episode_is_exported_for_other_tools(eigenfail, done, tmp_path, name):
    path = tmp_path / name
    told = json.loads(eigenfail("episode", "export", f"{done}/0", "-o", path, "--json").stdout)
    assert told == {"file": str(path), "size_bytes": path.stat().st_size}
    assert path.read_bytes()[:2] in {b'{"', b"GI"}


def test_what_cannot_be_exported_of_an_episode_ends_with_2(check_session, done, tiny_formats):
    tiny_formats.update(openscenario=tiny_formats.pop("poses"), mcap=tiny_formats["gif"])
    wrong = (
        (f"{done}/x", "-o", "a.gif"),
        (f"{done}/0", "-o", "a.csv"),
        (f"{done}/0", "-o", "a.xosc"),
        (f"{done}/0", "-o", "a.gif", "--noise"),
        (f"{done}/0", "-o", "a.gif", "--ego", "controller"),
        (done, "-o", "a.gif"),
        (done, "-o", "a.csv", "--ego", "recorded"),
        ("all", "-o", "a.csv"),
    )
    check_session("cli/recordings_refused", *(("episode", "export", *words) for words in wrong))


@pytest.mark.usefixtures("tiny_formats")
def test_a_format_that_the_service_lacks_ends_with_2(eigenfail, done):
    refused = eigenfail("episode", "export", f"{done}/0", "-o", "a.mcap")
    assert refused.exit_code == 2
    assert "'mcap' is in the package" in refused.stderr
    assert "Installed formats: gif, poses." in refused.stderr
