"""`eigenfail view`, `--view`, and `eigenfail episode failures`."""

import json
import re
import shlex
from pathlib import Path

from store_checks.failures import fill

from eigenfail.client import Client

PAGE = (Path(__file__).parents[3] / "docs" / "views.md").read_text()
FAILURES = ("episode", "failures")
HARD = ("filter=severity > 2", "sort=-severity", "fields=index,severity,label")


def test_views_are_saved_and_used(store, check_session):
    fill(store)
    check_session(
        "cli/views/used",
        ("view", "save", "hard [2]", "episodes", *(f"--set={each}" for each in HARD)),
        ("view", "save", "any", "campaigns", "--set", "sort=id", "--set", "archived=true"),
        ("episode", "list", 1, "--view", "hard [2]"),
        ("episode", "list", 1, "--view", "hard [2]", "--sort", "index", "--fields", "index"),
        ("view", "rename", "hard [2]", "hard"),
        ("view", "list"),
        ("view", "delete", "hard"),
        ("view", "list", "--page", "episodes"),
    )


def test_what_cannot_be_is_refused(check_session):
    check_session(
        "cli/views/refused",
        ("view", "save", "a", "episodes", "--set", "filter=severity >"),
        ("view", "save", "a", "episodes", "--set", "state=new"),
        ("view", "save", "a", "modes"),
        ("view", "save", " ", "campaigns"),
        ("view", "save", "a", "campaigns", "--set", "sort"),
        ("view", "save", "a", "campaigns"),
        ("view", "save", "a", "failures"),
        ("episode", "failures", "--view", "a"),
        ("campaign", "list", "--view", "b"),
        ("view", "delete", "b"),
        ("episode", "failures", "--sort", "steps"),
    )


def test_failures_of_all_campaigns_are_listed(store, check_session):
    fill(store)
    check_session(
        "cli/views/failures",
        ("episode", "failures", "--limit", 3),
        ("episode", "failures", "--planner", "idm", "--sort", "severity", "--limit", 2),
        ("episode", "failures", "--project", "none"),
    )


def test_options_beside_a_view_replace_its_own(store, eigenfail):
    fill(store)
    eigenfail("view", "save", "idm", "failures", "--set", "planner=idm", "--set", "sort=severity")
    told = json.loads(eigenfail("episode", "failures", "--view", "idm", "--json").stdout)
    assert {row["campaign"] for row in told} == {2, 4}
    assert told[0]["severity"] == 0.0
    ran = eigenfail("episode", "failures", "--view", "idm", "--sort", "-severity", "--json")
    assert json.loads(ran.stdout)[0]["severity"] == 4.0


def test_archived_campaigns_of_a_view_are_hidden_again(store, eigenfail):
    fill(store)
    store.campaigns.archive(2)
    for page, command in (("campaigns", ("campaign", "list")), ("failures", FAILURES)):
        eigenfail("view", "save", f"all {page}", page, "--set", "archived=true")
        asked = (*command, "--view", f"all {page}", "--limit", 99, "--json")
        shown, narrowed = (
            {row["id" if page == "campaigns" else "campaign"] for row in json.loads(ran.stdout)}
            for ran in (eigenfail(*asked), eigenfail(*asked, "--no-archived"))
        )
        assert shown - narrowed == {2}


def test_the_page_is_true(store, eigenfail, service):
    fill(store)
    shells = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (python,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    for line in "".join(shells).splitlines():
        ran = eigenfail(*shlex.split(line)[1:])
        assert ran.exit_code == 0, (line, ran.stderr)
    with Client(transport=service) as client:
        given = {"client": client}
        exec(compile(python, "docs/views.md", "exec"), given)
        assert [row.severity for row in given["worst"]] == [4.0, 4.0, 4.0]
        assert [view.name for view in client.views.list()] == ["done, worst first", "hard and new"]
