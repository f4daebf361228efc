"""Shell completion, as bash asks for it."""

import subprocess
import sys
import time
from pathlib import Path

import deadlines
import pytest
import shellingham
from typer.testing import CliRunner

from eigenfail.cli import completion
from eigenfail.cli.main import COMMANDS, app
from eigenfail.client import Client


@pytest.fixture
def complete(monkeypatch):
    """What bash offers behind these words, the last of which may be begun."""

    def ask(*words):
        monkeypatch.setenv("COMP_WORDS", " ".join(["eigenfail", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        done = CliRunner().invoke(
            app, [], prog_name="eigenfail", env={"_EIGENFAIL_COMPLETE": "complete_bash"}
        )
        return done.stdout.split()

    return ask


def run(*words):
    return CliRunner().invoke(app, words, prog_name="eigenfail")


def find_none():
    raise shellingham.ShellDetectionFailure


@pytest.fixture
def without_shell(monkeypatch):
    """Nobody among the parent processes is a shell."""
    monkeypatch.setattr(shellingham, "detect_shell", find_none)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize("words", [("--show-completion", "{}"), ("--show-completion={}",)])
def test_the_script_of_the_named_shell_is_printed(without_shell, words, shell):
    done = run(*(word.format(shell) for word in words))
    assert done.exit_code == 0
    assert f"_EIGENFAIL_COMPLETE=complete_{shell}" in done.stdout


def test_the_script_is_installed_for_the_named_shell(without_shell, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    done = run("--install-completion", "bash")
    assert done.exit_code == 0
    script = tmp_path / ".bash_completions" / "eigenfail.sh"
    assert str(script) in done.stdout.replace("\n", "")
    assert "complete_bash" in script.read_text()
    assert str(script) in (tmp_path / ".bashrc").read_text()


def test_without_a_name_it_is_the_shell_that_runs_the_program(monkeypatch):
    monkeypatch.setattr(shellingham, "detect_shell", lambda: ("zsh", "/bin/zsh"))
    assert "complete_zsh" in run("--show-completion").stdout


@pytest.mark.parametrize("option", ["--show-completion", "--install-completion"])
def test_without_a_name_and_a_shell_the_message_asks_for_a_name(without_shell, option):
    done = run(option)
    assert done.exit_code == 2
    assert "eigenfail --show-completion bash" in done.stderr
    unknown = run(option, "cmd")
    assert unknown.exit_code == 2
    assert "'cmd'" in unknown.stderr
    assert "bash, zsh, fish" in unknown.stderr


# Leaves its parent, and runs the command as a daemon or cron would.
DAEMON = """
import os, subprocess, sys, time
parent = os.getpid()
if os.fork():
    os._exit(0)
os.setsid()
while os.getppid() == parent:
    time.sleep(0.01)
done = subprocess.run(sys.argv[2:], capture_output=True, text=True)
with open(sys.argv[1] + ".part", "w") as file:
    print(done.returncode, done.stdout, done.stderr, sep="\\n", file=file)
os.rename(sys.argv[1] + ".part", sys.argv[1])
"""


@pytest.mark.service
@pytest.mark.fault(
    "command without a shell among its parent processes",
    group="processes",
    outcome="`eigenfail --show-completion bash` obeys its word and prints the script for bash.",
)
def test_a_daemon_gets_the_script_of_the_shell_that_it_names(tmp_path):
    answer, program = tmp_path / "answer", Path(sys.executable).with_name("eigenfail")
    asked = (str(program), "--show-completion", "bash")
    command = [sys.executable, "-c", DAEMON, str(answer), *asked]
    subprocess.run(command, check=True)
    deadline = time.monotonic() + deadlines.PROCESS_S
    while not answer.exists():
        assert time.monotonic() < deadline, "the daemon does not answer"
        time.sleep(0.05)
    code, _, printed = answer.read_text().partition("\n")
    assert (code, "_EIGENFAIL_COMPLETE=complete_bash" in printed) == ("0", True), printed


def test_commands_complete(complete):
    assert complete("")[: len(COMMANDS)] == list(COMMANDS)
    assert complete("ca") == ["campaign"]
    assert {"list", "show", "create"} <= set(complete("campaign", ""))


def test_options_and_their_values_complete(complete):
    assert complete("campaign", "list", "--st") == ["--state"]
    assert complete("campaign", "list", "--state", "q") == ["queued"]


def test_campaigns_complete(complete, service, done, monkeypatch):
    monkeypatch.setattr(completion, "connect", lambda url: Client(url, service))
    assert complete("campaign", "show", "") == [str(done)]
    assert complete("campaign", "show", "9") == []


def test_plug_ins_complete(complete):
    assert complete("doctor", "--planner", "rul") == ["rulebook"]
    assert complete("doctor", "--scenario", "cut") == ["cut_in"]


def test_no_service_is_no_trouble(complete, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EIGENFAIL_URL", "http://127.0.0.1:1")
    assert complete("campaign", "show", "") == []
