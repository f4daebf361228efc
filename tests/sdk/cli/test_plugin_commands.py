"""Commands of other distributions: listed without being imported, and refused in one sentence."""

import sys

import pytest
from distributions import write_record
from plugin_absence import forget_entry_points
from typer.testing import CliRunner

from eigenfail import plugins
from eigenfail.cli import main

WIDE = {"TERMINAL_WIDTH": "200", "COLUMNS": "200"}
MODULE = '''# A comment before the docstring.
"""`eigenfail {name}`: count the sheep of a campaign.

More of it.
"""

import typer

app = typer.Typer()


@app.command()
def count() -> None:
    """Count."""
    print("seven")
'''
RAISES = '"""Raise when imported."""\n\nraise RuntimeError("imported")\n'


@pytest.fixture(autouse=True)
def forget():
    """Has entry points read anew, before and after."""
    forget_entry_points()
    yield
    forget_entry_points()
    for name in [*sys.modules]:
        if name.startswith(("eigenfail_sheep", "eigenfail_goats")):
            del sys.modules[name]


@pytest.fixture
def bring(tmp_path, monkeypatch):
    """Installs a distribution that brings a command."""

    def install(distribution, name, text=MODULE, attribute="app"):
        package = distribution.replace("-", "_")
        folder = tmp_path / distribution
        (folder / package).mkdir(parents=True)
        (folder / package / "__init__.py").write_text("")
        (folder / package / "commands.py").write_text(text.replace("{name}", name))
        points = f"[eigenfail.commands]\n{name} = {package}.commands:{attribute}\n"
        write_record(folder, distribution, points)
        monkeypatch.syspath_prepend(folder)
        return folder / package

    return install


def call(*words):
    return CliRunner().invoke(main.app, words, env=WIDE)


def rows(printed):
    """What the list of commands says, by name."""
    lines = [line.strip("│ ").split(maxsplit=1) for line in printed.splitlines() if "│" in line]
    return {line[0]: line[1].strip() for line in lines if len(line) == 2}


def test_a_plug_in_s_command_is_listed_after_those_of_the_core_and_run(bring):
    bring("eigenfail-sheep", "sheep")
    listed = rows(call("--help").stdout)
    assert listed["sheep"] == "Count the sheep of a campaign."
    assert list(listed)[-1] > "doctor"
    assert [*listed].index("sheep") > max([*listed].index(name) for name in main.COMMANDS)
    done = call("sheep")
    assert (done.exit_code, done.stdout) == (0, "seven\n")


def test_the_list_imports_neither_the_module_nor_its_package(bring):
    package = bring("eigenfail-sheep", "sheep", RAISES)
    (package / "__init__.py").write_text('raise RuntimeError("imported")\n')
    assert rows(call("--help").stdout)["sheep"] == "Raise when imported."
    done = call("sheep")
    assert done.exit_code == 2
    assert "'sheep' cannot be loaded: RuntimeError: imported" in done.stderr


@pytest.mark.parametrize("text", ["", "x = 1\n", "def f(:\n", '"""\\xzz"""\n', "'''unfinished"])
def test_a_module_whose_docstring_cannot_be_read_is_named_by_its_package(bring, text):
    bring("eigenfail-sheep", "sheep", text)
    assert rows(call("--help").stdout)["sheep"] == "Brought by eigenfail-sheep."


def test_a_module_that_is_gone_is_an_error_of_its_command_alone(bring):
    package = bring("eigenfail-sheep", "sheep")
    (package / "commands.py").unlink()
    assert rows(call("--help").stdout)["sheep"] == "Brought by eigenfail-sheep."
    done = call("sheep")
    assert done.exit_code == 2
    assert "No module named 'eigenfail_sheep.commands'" in done.stderr


@pytest.mark.parametrize("name", ["run", "db"])
def test_a_name_of_the_core_is_refused_and_both_packages_are_named(bring, name):
    bring("eigenfail-sheep", name)
    text = f"'{name}' is claimed by several packages: eigenfail, eigenfail-sheep."
    listed = rows(call("--help").stdout)[name]
    assert listed == "Refused: claimed by eigenfail, eigenfail-sheep."
    done = call(name, "x.toml")
    assert done.exit_code == 2
    assert f"{text} Uninstall one of them: pip uninstall eigenfail-sheep." in done.stderr
    assert call("doctor", "--help").exit_code == 0


def test_a_name_that_two_plug_ins_claim_is_refused_and_both_are_named(bring):
    bring("eigenfail-sheep", "count")
    bring("eigenfail-goats", "count")
    done = call("count")
    assert done.exit_code == 2
    assert (
        "'count' is claimed by several packages: eigenfail-goats, eigenfail-sheep." in done.stderr
    )


def test_a_method_that_two_packages_claim_is_refused_wherever_it_is_loaded(bring):
    folder = bring("eigenfail-sheep", "sheep").parent
    (points,) = folder.glob("*.dist-info/entry_points.txt")
    points.write_text("[eigenfail.methods]\nast = eigenfail_sheep.commands:app\n")
    assert "ast" in plugins.names(plugins.METHODS)
    with pytest.raises(main.InvalidValue, match="packages: eigenfail, eigenfail-sheep"):
        plugins.load(plugins.METHODS, "ast")


def test_an_object_that_is_no_command_is_refused(bring):
    bring("eigenfail-sheep", "sheep", attribute="count")
    done = call("sheep")
    assert done.exit_code == 2
    assert "'sheep' is of the type function, and must be a typer.Typer." in done.stderr


@pytest.mark.parametrize("name", main.PLUGINS)
def test_a_command_that_is_not_installed_says_which_package_brings_it(monkeypatch, name):
    monkeypatch.setattr(plugins, "list_claims", lambda group: {})
    assert name not in rows(call("--help").stdout)
    done = call(name, "anything")
    assert done.exit_code == 2
    package = main.PLUGINS[name]
    assert f"'eigenfail {name}' is in the package {package}, which is not installed" in done.stderr
    assert f"pip install plugins/{package}" in done.stderr
