"""Documents that cannot rot: their commands, links, files and tables are held against the code."""

import re
import shlex
from ast import literal_eval

import pytest
import typer
from starlette.testclient import TestClient

from eigenfail.cli import main
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail.presentation.campaigns import tabulate_results
from eigenfail.suites import Suite
from eigenfail_api.app import create_app
from eigenfail_api.settings import ApiSettings
from eigenfail_services.store.store import open_store

LINK = re.compile(r"\[[^\]]+\]\(([^)#\s]+)\)")


def parse(words):
    """Parse a command as it would be run, and do nothing; raises what the parser raises."""
    command = typer.main.get_command(main.app)
    context = command.make_context("eigenfail", list(words))
    while rest := [*getattr(context, "_protected_args", []), *context.args]:
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)
        command = context.command
    return command


def test_the_parser_sees_a_wrong_command():
    assert parse(["campaign", "list", "--limit", "3"]).name == "list"
    for wrong in (["campaign", "lst"], ["run", "x.toml", "--fast"], ["episode", "list", "x"]):
        with pytest.raises(Exception, match=r"No such|valid integer"):
            parse(wrong)


def test_every_command_in_the_documents_exists_with_its_options(documents):
    # The command of docs/plugins.md is that of the plug-in which the page has its reader write.
    pages = [document for document in documents if document.path.name != "plugins.md"]
    lines = [line for document in pages for line in document.commands("eigenfail")]
    assert len(lines) > 15
    for line in lines:
        parse(shlex.split(line)[1:])


def test_every_command_of_the_command_line_is_in_the_documents(documents):
    text = "\n".join(document.text for document in documents)
    assert [name for name in main.COMMANDS if name not in text] == []


def test_every_make_target_in_the_documents_exists(documents, root):
    targets = set(re.findall(r"^([a-z]+):", (root / "Makefile").read_text(), re.MULTILINE))
    named = {line.split()[1] for document in documents for line in document.commands("make")}
    assert {"demo", "test", "setup"} <= named <= targets


def test_every_file_in_the_documents_exists(documents, root):
    for document in documents:
        for target in LINK.findall(document.text):
            # The folder of a plug-in may be deleted, and pages go on to name what it brings.
            if not target.startswith("http") and "plugins/eigenfail-" not in target:
                assert (document.path.parent / target).exists(), target
        for name in re.findall(r"(?<![\w/])(?:examples|deploy)/[\w.]+", document.text):
            if name != "deploy/.env":
                assert (root / name).exists(), name


def test_python_in_the_documents_compiles(documents):
    blocks = [block for document in documents for block in document.blocks("python")]
    assert blocks
    for block in blocks:
        compile(block, "document", "exec")


def test_the_readme_is_short_and_names_the_two_commands(readme):
    assert len(readme.text.splitlines()) <= 90
    assert readme.blocks("sh")[0] == "make demo\nmake test\n"


def test_the_readme_shows_what_the_demo_prints(readme, root):
    shown = readme.text.split("<!-- demo -->")[1].split("<!-- /demo -->")[0]
    columns = [column.label for column in tabulate_results([]).columns]
    (header,) = [line for line in shown.splitlines() if "episodes/s" in line]
    assert " ".join(header.split()) == " ".join(columns)
    demo = (root / "examples" / "demo.py").read_text()
    (methods,) = re.findall(r"^EPISODES = (\{.*\})$", demo, re.MULTILINE)
    rows = re.findall(r"^ (\d) (\w+) ", shown, re.MULTILINE)
    assert rows == [(str(n), method) for n, method in enumerate(literal_eval(methods), 1)]
    assert "reproduced a failure" in shown


def test_the_code_map_names_each_folder(root):
    text = (root / "docs" / "code_map.md").read_text()
    packages = text.partition("## Packages")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`.*?) \|", packages, re.MULTILINE)
    folders = [name.removesuffix("/*") for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert len(folders) >= 9
    assert [name for name in folders if not (root / name).is_dir()] == []
    tops = {name.partition("/")[0] for name in folders}
    listed = {path.name for path in root.iterdir() if path.is_dir()}
    assert {"sdk", "services", "workers", "api", "deploy", "migrations", "tests"} <= tops & listed


def test_the_changelog_keeps_its_form(changelog):
    assert "## [Unreleased]" in changelog.text
    kinds = re.findall(r"^### (.*)$", changelog.text, re.MULTILINE)
    assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_every_example_is_a_campaign_that_can_be_run(root, monkeypatch):
    monkeypatch.chdir(root / "examples")
    files = sorted(set((root / "examples").glob("*.toml")) - set(suites(root)))
    methods = {"correlated": "monte_carlo", "any_function": "cem", "transfer": "ensemble"}
    methods |= {"highway_drive": "monte_carlo", "paper_steps": "ast"}
    assert {"ast", "cem", "correlated", "difs", "monte_carlo"} <= {file.stem for file in files}
    for file in files:
        spec = read_spec(file)
        check_plugins(spec)
        assert spec.method == methods.get(file.stem, file.stem)


def suites(root):
    return [
        root / "examples" / name
        for name in ("regression.toml", "suite.toml", "sweep.toml", "challenges.toml")
    ]


def test_every_example_of_a_suite_can_be_run(root):
    for file in suites(root):
        for member in Suite.read(file).members:
            check_plugins(member.spec)


def test_addresses_of_the_service_in_the_documents_answer(documents):
    text = "\n".join(document.text for document in documents)
    paths = set(re.findall(r"http://127\.0\.0\.1:8440([\w/.-]*)", text))
    assert paths
    store = open_store("memory://")
    with TestClient(create_app(store, ApiSettings()), base_url="http://127.0.0.1:8440") as browser:
        assert {path: browser.head(path).status_code for path in paths} == dict.fromkeys(paths, 200)
    store.close()
