"""The plug-in's documents: their commands run, and what they say is so."""

import re
import shutil

import deadlines
import pytest
from cli_reference import write_commands
from typed_pages import demo_in, seen, shell, type_in
from typer.testing import CliRunner

from eigenfail.cli.main import app
from eigenfail.cli.specs import check_plugins, read_spec
from eigenfail_assurance.evidence.question import EvidenceQuestion
from eigenfail_assurance.risk.question import RiskQuestion

COMMANDS = {
    "requirement": "Find the largest errors of the sensor at which failures stay rare enough.",
    "risk": "Assess failures per hour and per 10^6 km of a planner, against a target rate.",
    "evidence": "Argue claims about a planner with outputs, as a bundle that is verified offline.",
}
"""Commands in the order of the reference, and what lists of commands say of them."""

FOLDER = "plugins/eigenfail-assurance"
KINDS = {"exposure": RiskQuestion, "claim": EvidenceQuestion}
NOT_RUN = {
    f"eigenfail requirement {FOLDER}/examples/sensor_requirement.toml": "It takes an hour or more.",
}
AFTER_DEMO = {
    "sensor_requirement.md": (r"With 95 % confidence",),
    "risk.md": (r"Motorway: undecided", r"next episodes", r"undecided.*RiskFigure"),
    "evidence.md": (r"Cut-in: refuted", r"10 of them run", r"refuted True"),
}
"""Pages that speak of the campaigns of `make demo`, typed one after the other on one service."""

ALLOWED = {
    "eigenfail risk": (0, 3),
    "eigenfail evidence": (0, 1),
    "eigenfail evidence verify": (0,),
}
REPLACED = {
    "--budget 200": "--budget 20",
    "--target 0.05": "--target 0.3",  # 20 episodes can show no less
}
LINK = re.compile(r"\]\(([^)\s]+)\)")
NAMED = re.compile(rf"(?<![\w/])(?:{FOLDER}|examples|benchmarks)/[\w./-]+\.\w+")


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    methods = ("monte_carlo", 20), ("ast", 60)
    with demo_in(tmp_path_factory.mktemp("demo"), *methods) as here:
        yield here


@pytest.mark.service
@pytest.mark.timeout(2 * deadlines.TEST_S)
@pytest.mark.parametrize("page", AFTER_DEMO)
def test_a_page_on_the_campaigns_of_the_demo_runs(page, plugin, demo, tmp_path):
    with shell(tmp_path) as here:
        shutil.copytree(plugin / "examples", here.clone / FOLDER / "examples")
        here.join(demo)
        here.allowed |= ALLOWED
        here.replaced |= REPLACED
        type_in(f"{FOLDER}/docs/{page}", here, NOT_RUN, KINDS)
        seen(here.output, AFTER_DEMO[page])


def test_every_page_is_typed(plugin):
    assert AFTER_DEMO.keys() == {page.name for page in plugin.glob("docs/*.md")}


def test_the_reference_is_the_help_of_today(plugin):
    text = (plugin / "README.md").read_text()
    again = f"python tests/support/cli_reference.py {FOLDER}/README.md {' '.join(COMMANDS)}"
    assert again in text
    assert write_commands(text, tuple(COMMANDS)) == text, again


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_of_commands_says_what_the_help_of_the_command_says(name):
    for words in (["--help"], [name, "--help"]):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0
        said = re.sub(r"[│\s]+", " ", done.stdout)
        assert COMMANDS[name] in said


def test_links_lead_to_files_and_named_files_exist(plugin):
    for page in (plugin / "README.md", *plugin.glob("docs/*.md")):
        text = page.read_text()
        links = [link.partition("#")[0] for link in LINK.findall(text) if "://" not in link]
        assert [link for link in links if link and not (page.parent / link).exists()] == []
        root = plugin.parents[1]
        assert [name for name in NAMED.findall(text) if not (root / name).exists()] == []


def test_the_example_of_a_campaign_can_be_run(plugin):
    spec = read_spec(plugin / "examples" / "sensor_requirement.toml")
    check_plugins(spec)
    assert spec.method == "subset"
