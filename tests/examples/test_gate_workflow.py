"""The example of a workflow: it follows GitHub's schema, and its commands can be run."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer
import yaml

from eigenfail.cli import main
from eigenfail.suites import Suite

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "examples" / "gate.yaml"
CHECK = (Path(sys.executable).parent / "check-jsonschema", "--builtin-schema")
SCHEMA = "vendor.github-workflows"


def conforms(file):
    if not CHECK[0].exists():
        pytest.skip("the extra deploy-checks is not installed: see docs/contributing.md")
    command = [*CHECK, SCHEMA, file]
    return subprocess.run(command, capture_output=True, text=True, check=False).returncode == 0


def test_the_workflow_follows_the_schema_of_workflows(tmp_path):
    assert conforms(WORKFLOW)
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(WORKFLOW.read_text().replace("runs-on:", "runs:"))
    assert not conforms(wrong)


@pytest.fixture
def steps():
    """All steps of all jobs."""
    jobs = yaml.safe_load(WORKFLOW.read_text())["jobs"].values()
    return [step for job in jobs for step in job["steps"]]


def test_its_commands_exist_with_their_options(steps):
    text = "\n".join(step.get("run", "") for step in steps)
    lines = re.findall(r"^eigenfail .*$", text, re.MULTILINE)
    assert len(lines) == 3
    group = typer.main.get_command(main.app)
    for line in lines:
        _, name, action, *words = shlex.split(line.replace('"$', '"'))
        context = group.make_context("eigenfail", [name, action, *words])
        command = group.get_command(context, name).load().get_command(context, action)
        given = command.make_context(action, words, parent=context).params
        assert given["file"] == Path("examples/regression.toml")
        assert given["planner_version"]


def test_what_is_kept_is_what_is_restored(steps):
    kept = {step["with"]["key"] for step in steps if "cache" in step.get("uses", "")}
    assert kept == {
        "eigenfail-${{ github.sha }}",
        "eigenfail-${{ github.event.pull_request.base.sha }}",
    }


def test_the_example_suite_is_small_enough_for_every_change():
    suite = Suite.read(ROOT / "examples" / "regression.toml")
    assert suite.name == "regression"
    assert suite.episodes <= 400
    assert {member.spec.method for member in suite.members} == {"monte_carlo", "cem"}
