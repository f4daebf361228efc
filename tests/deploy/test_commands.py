"""Every command and every variable of the recipes is one that its program knows."""

import argparse
import re
from pathlib import Path
from typing import NamedTuple

import click
import pytest
import typer
import yaml
from manifests import DEPLOY, OVERLAYS, built, example, pods
from ray.scripts.scripts import start

from eigenfail.cli.main import DeferredCommand, app
from eigenfail.errors import EigenfailError
from eigenfail_api import __main__ as api
from eigenfail_services import __main__ as services
from eigenfail_services import options
from eigenfail_workers import __main__ as workers

SETTINGS = (DEPLOY.parent / "docs" / "configuration.md").read_text()
ON_RAY = "/opt/eigenfail-run/on_ray.sh"
SHELLS = {"sh"}


class Call(NamedTuple):
    """What a container runs, and with which variables."""

    where: str
    words: tuple[str, ...]
    variables: tuple[str, ...]


def of_compose():
    for name, service in yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"].items():
        if name != "postgres":
            entrypoint = service.get("entrypoint", ["python", "-m"])
            variables = service.get("environment", {})
            yield Call(name, (*entrypoint, *service["command"]), (*variables,))


def of_kubernetes():
    rendered = [(overlay, built(overlay)) for overlay in OVERLAYS]
    for overlay, manifests in (*rendered, ("example", [example("gate_job.yaml")])):
        for pod in pods(manifests):
            for container in pod.containers():
                words = (*container.get("command", ["python", "-m"]), *container.get("args", ()))
                if container["image"].startswith("eigenfail") and "args" in container:
                    variables = (variable["name"] for variable in container.get("env", ()))
                    yield Call(f"{overlay} {container['name']}", words, (*variables,))


CALLS = [*of_compose(), *of_kubernetes()]


class Parsed(Exception):
    """The command line was read to its end."""


def parse(words, monkeypatch):
    """Raises SystemExit or a click.UsageError if a program does not take its words."""
    program, *rest = words
    if program == ON_RAY:
        assert rest.pop(0).endswith(":6379")
        return parse(("python", "-m", *rest), monkeypatch)
    if program == "ray":
        assert rest.pop(0) == "start"
        return start.make_context("start", rest)
    if program == "eigenfail":
        return parse_eigenfail(rest, monkeypatch)
    assert [program, rest[0]] == ["python", "-m"]
    return PROGRAMS[rest[1]](rest[2:], monkeypatch)


def parse_eigenfail(words, monkeypatch):
    command, rest = typer.main.get_command(app), [*words]
    while rest and rest[0] in getattr(command, "commands", {}):
        command = command.commands[rest.pop(0)]
        command = command.load() if isinstance(command, DeferredCommand) else command
    context = command.make_context("eigenfail", rest)
    if rest and hasattr(command, "commands"):
        command.resolve_command(context, rest)
    return context


def parse_services(words, monkeypatch):
    arguments = services.parse(words)
    if arguments.command is services.serve:
        options.create_launcher(arguments)
    return arguments


def parse_worker(words, monkeypatch):
    true = argparse.ArgumentParser.parse_args

    def parsed(parser, *_):
        raise Parsed(true(parser, words))

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    with pytest.raises(Parsed) as caught:
        workers.serve()
    return caught.value.args[0]


PROGRAMS = {
    "eigenfail": parse_eigenfail,
    "eigenfail_api": lambda words, _: api.read_settings(words),
    "eigenfail_services": parse_services,
    "eigenfail_workers": parse_worker,
}


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.where)
def test_every_program_takes_its_words(call, monkeypatch):
    if call.words[0] not in SHELLS:
        assert parse(call.words, monkeypatch) is not None


@pytest.mark.parametrize(
    "words",
    [
        ("python", "-m", "eigenfail_services", "--max-worker-count=3"),
        ("python", "-m", "eigenfail_services", "--min-workers=9", "--max-workers=3"),
        ("python", "-m", "eigenfail_api", "--hots", "0.0.0.0"),
        ("python", "-m", "eigenfail_workers", "--conect", "tcp://services:8441"),
        ("ray", "start", "--dashboard=false"),
        ("python", "-m", "eigenfail", "db", "upgarde"),
        ("eigenfail", "gate", "run", "suite.toml", "--uri", "http://controller"),
        (ON_RAY, "head:6379", "eigenfail_services", "--hup=tcp://0.0.0.0:8441"),
    ],
)
def test_a_word_that_no_program_takes_is_found(words, monkeypatch):
    wrong = (SystemExit, click.UsageError, *typer.BadParameter.__bases__, EigenfailError)
    with pytest.raises(wrong):
        parse(words, monkeypatch)


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.where)
def test_every_variable_is_told_among_the_settings(call):
    assert [name for name in call.variables if f"`{name}`" not in SETTINGS] == []


def test_variables_of_the_image_and_of_the_health_check_are_told():
    image = re.findall(
        r"^(?:ENV|   ) +([A-Z_]+)=", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE
    )
    health = re.findall(r"port\(\"(\w+)\"", (DEPLOY / "health.py").read_text())
    named = {*image, *(f"EIGENFAIL_{name}" for name in health), "EIGENFAIL_ROLE"}
    usual = {"PATH", "HOME", "PYTHONUNBUFFERED", "PYTHONDONTWRITEBYTECODE"}
    assert named > usual
    assert {
        name for name in named if not name.startswith("PIP_") and f"`{name}`" not in SETTINGS
    } <= usual


def test_the_node_beside_a_program_is_started_with_options_that_ray_has():
    text = (DEPLOY / "on_ray.sh").read_text()
    line = re.search(r"ray start (.*?)\|\|", text.replace("\\\n", " "), re.DOTALL)[1]
    words = line.replace('"$head"', "head:6379").split()
    assert start.make_context("start", words).params["address"] == "head:6379"
    assert (DEPLOY / "on_ray.sh").stat().st_mode & 0o111 == 0o111


def test_ray_is_asked_for_a_token_and_shows_no_dashboard(services):
    for name in ("ray-head", "worker", "services"):
        assert services[name]["environment"]["RAY_AUTH_MODE"] == "token"
    head = start.make_context("start", services["ray-head"]["command"][1:]).params
    assert (head["include_dashboard"], head["num_cpus"], head["port"]) == (False, 0, 6379)


def test_ray_s_token_is_made_once_and_for_its_owner_alone(services, tmp_path):
    import subprocess

    words = services["ray-token"]["command"][0].replace("/var/lib/eigenfail-ray", str(tmp_path))
    tokens = set()
    for _ in range(2):
        subprocess.run([*services["ray-token"]["entrypoint"], words], check=True)
        tokens.add(Path(tmp_path / "token").read_text())
    assert len(tokens) == 1
    assert len(tokens.pop().strip()) == 64
    assert (tmp_path / "token").stat().st_mode & 0o777 == 0o600
