"""Every setting, every error and every document is where its reader looks for it."""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from http import HTTPStatus

import pytest

from eigenfail.errors import EigenfailError
from eigenfail.wire.http import list_error_types, slugify
from eigenfail_api import __main__ as api
from eigenfail_api.openapi import EVERYWHERE, WITH_BODY, WITH_ID
from eigenfail_api.settings import ApiSettings
from eigenfail_services import __main__ as services
from eigenfail_workers import __main__ as workers

HEADING = re.compile(
    r"^### (?P<name>\w+) `(?P<type>[a-z-]+)`, (?:(?P<status>\d+), )?exit code (?P<code>\d)$",
    re.MULTILINE,
)
VARIABLE = re.compile(r"[\"'](EIGENFAIL_[A-Z_]+)[\"']")


def page(root, name):
    return (root / "docs" / f"{name}.md").read_text()


def rows(text):
    lines = re.findall(r"^\| (.*) \|$", text, re.MULTILINE)
    return [[cell.strip().strip("`") for cell in line.split("|")] for line in lines]


def section(text, program):
    return text.split(f"`python -m {program}`")[1].split("\n## ")[0]


def test_every_error_has_an_entry_that_is_true(root):
    entries = {match["name"]: match for match in HEADING.finditer(page(root, "troubleshooting"))}
    kinds = {kind.__name__: kind for kind in list_error_types(EigenfailError)}
    assert entries.keys() == kinds.keys()
    for name, entry in entries.items():
        assert entry["type"] == slugify(kinds[name])
        assert int(entry["code"]) == kinds[name].exit_code
        if entry["status"]:
            assert int(entry["status"]) == kinds[name].http_status


def test_every_status_without_a_type_has_an_entry(root):
    table = page(root, "troubleshooting").split("## Problems without a type")[1].split("\n## ")[0]
    told = {int(row[0]) for row in rows(table) if row[0].isdecimal()}
    assert told == {400, 403, 404, 405, 406, 408, 413, 415, 429, 500, 503}
    typed = {kind.http_status for kind in list_error_types(EigenfailError)} - {400, 404, 500}
    assert {*EVERYWHERE, *WITH_ID, *WITH_BODY} <= told | typed
    assert all(HTTPStatus(status) for status in told)


def test_every_setting_of_the_api_is_told_with_its_default(root):
    table = rows(section(page(root, "configuration"), "eigenfail_api"))
    told = {row[0]: row[2] for row in table if row[0].startswith("EIGENFAIL_")}
    assert told.keys() == {f"EIGENFAIL_{name.upper()}" for name in ApiSettings.model_fields}
    for name, field in ApiSettings.model_fields.items():
        shown = told[f"EIGENFAIL_{name.upper()}"].replace('"', "'")
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        assert shown.lower() == str(default).lower()


class Caught(Exception):
    """The parser, instead of what it would have parsed."""


PROGRAMS = {
    "eigenfail_api": api.main,
    "eigenfail_services": services.parse,
    "eigenfail_workers": workers.serve,
}


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_option_of_a_process_is_told(root, program, monkeypatch):
    def catch(parser, *_):
        raise Caught(parser)

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", catch)
    with pytest.raises(Caught) as caught:
        PROGRAMS[program]()
    (parser,) = caught.value.args
    options = {word for action in parser._actions for word in action.option_strings}
    text = section(page(root, "configuration"), program)
    told = set(re.findall(r"`(--[a-z-]+)`", text))
    assert told == {word for word in options if word.startswith("--")} - {"--help"}


def test_every_environment_variable_of_the_code_is_told(root):
    folders = ("sdk", "api", "services", "workers")
    sources = [file.read_text() for name in folders for file in (root / name).rglob("*.py")]
    names = {name for text in sources for name in VARIABLE.findall(text)}
    assert {"EIGENFAIL_URL", "EIGENFAIL_DATA"} <= names
    text = page(root, "configuration")
    assert [name for name in sorted(names) if f"`{name}`" not in text] == []


def test_files_of_the_deployment_are_told(root):
    text = page(root, "deployment")
    names = {file.name for file in (root / "deploy").iterdir() if file.is_file()}
    names -= {"Dockerfile.dockerignore", ".env"}
    assert {name for name in names if f"deploy/{name}`" not in text} == set()


def build_site(sources, target):
    """What mkdocs says, and its exit code."""
    command = [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(target)]
    plain = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(
        command, cwd=sources, env=plain, capture_output=True, text=True, check=False
    )


def test_the_site_is_built_and_asks_no_other_machine(root, tmp_path):
    built = build_site(root, tmp_path)
    assert built.returncode == 0, built.stderr
    for page in tmp_path.glob("*.html"):
        text = page.read_text()
        loaded = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)"', text)
        assert loaded == [], page.name
    found = json.loads((tmp_path / "search" / "search_index.json").read_text())["docs"]
    assert "Quickstart" in {entry["title"] for entry in found}
    assert (tmp_path / "source/examples/my_planner.py").exists()


def test_links_that_lead_nowhere_break_the_site(root, tmp_path):
    golden = "workers/eigenfail_workers/bridge/golden"
    for name in ("deploy", "mkdocs.yml", "examples", golden):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).symlink_to(root / name)
    shutil.copytree(root / "docs", tmp_path / "docs")
    targets = ("nowhere.md", "faq.md#nowhere", "../examples/nowhere.toml")
    with (tmp_path / "docs" / "faq.md").open("a") as page:
        page.write("".join(f"\n[x]({target})\n" for target in targets))
    built = build_site(tmp_path, tmp_path / "site")
    assert built.returncode == 1
    # The link to a source is one below `source` by then.
    names = [target.rpartition("/")[2] for target in targets]
    assert [name for name in names if name not in built.stderr] == [], built.stderr
