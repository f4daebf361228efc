"""No key and no password is to be read in what a process says, whoever it is that says it."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from eigenfail.values.access import redact
from eigenfail.wire.keys import WorkerKey

KEY = f"ef_7_{'a' * 43}"
WEBHOOK = f"whsec_{'+b/' * 14}=="
PASSWORD = "hunter2"
WORKER = WorkerKey(b"h" * 32, b"s" * 32).text()
URL = f"postgresql+psycopg://eigenfail:{PASSWORD}@db.example/eigenfail"
SECRETS = (KEY, PASSWORD, WORKER, WEBHOOK)

BEGIN = f"""
import logging, sys, threading
import structlog
from eigenfail import logs
KEY, URL, WORKER = "{KEY} {WEBHOOK}", "{URL}", "{WORKER}"
def fail(said):
    database, key, curve, local = URL, KEY, WORKER, "only-a-local"
    raise ValueError(said)
"""
CLI = "from eigenfail.cli.main import main; main()"
ALL = "f'{KEY} {URL} {WORKER}'"
SAYING = {
    "in a message": f"structlog.get_logger().warning({ALL})",
    "in a value": "structlog.get_logger().warning('trouble', key=KEY, database=URL, w=[WORKER])",
    "in locals": """
try:
    fail('nothing')
except ValueError:
    structlog.get_logger().exception('trouble')
""",
    "in an error": f"""
try:
    fail({ALL})
except ValueError:
    structlog.get_logger().exception('trouble')
""",
    "in others' message": f"logging.getLogger('uvicorn.error').error({ALL})",
    "in others' arguments": "logging.getLogger('x').error('%s %s %s', KEY, URL, WORKER)",
    "in others' error": f"""
try:
    fail({ALL})
except ValueError:
    logging.getLogger('asyncio').exception('trouble')
""",
    "in a line that cannot be made": "logging.getLogger('x').error('%d', KEY + URL + WORKER)",
    "in what nobody caught": f"fail({ALL})",
    "in what no thread caught": f"""
thread = threading.Thread(target=fail, args=({ALL},))
thread.start()
thread.join()
""",
    "in what nobody could catch": f"""
class Gone:
    def __del__(self):
        fail({ALL})
gone = Gone()
del gone
""",
}


def run(program, **variables):
    command = [sys.executable, "-c", program]
    environment = {**os.environ, **variables}
    return subprocess.run(command, capture_output=True, check=False, text=True, env=environment)


@pytest.mark.parametrize("form", ["text", "json"])
@pytest.mark.parametrize("where", SAYING)
def test_no_secret_is_said(where, form):
    program = f"{BEGIN}logs.configure('services')\n{SAYING[where]}"
    done = run(program, EIGENFAIL_LOG_FORMAT=form)
    assert done.stderr.strip()
    assert [secret for secret in SECRETS if secret in done.stderr + done.stdout] == []
    assert "only-a-local" not in done.stderr
    if form == "json":
        assert all(map(json.loads, done.stderr.splitlines()))


def test_what_nobody_caught_is_told_all_the_same_and_is_the_end():
    done = run(f"{BEGIN}logs.configure('services')\n{SAYING['in what nobody caught']}")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "ValueError: ef_7_…" in done.stderr


def test_the_command_line_tells_of_surprises_without_secrets():
    program = f"""{BEGIN}
from eigenfail.cli import main
main.app = lambda: fail({ALL})
main.main()
"""
    done = run(program)
    assert (done.returncode, "ValueError: ef_7_…" in done.stderr) == (1, True)
    assert [secret for secret in SECRETS if secret in done.stderr] == []


def test_a_command_that_fails_by_surprise_is_told_of_without_secrets():
    done = run(f"""{BEGIN}
from eigenfail.cli import doctor
from eigenfail.cli.main import main
doctor.list_versions = lambda: fail({ALL})
sys.argv = ["eigenfail", "doctor"]
main()
""")
    assert (done.returncode, "ValueError: ef_7_…" in done.stderr) == (1, True)
    assert [secret for secret in SECRETS if secret in done.stderr] == []


@pytest.mark.parametrize("program", ["eigenfail_api", "eigenfail_services", "eigenfail_workers"])
def test_a_command_line_that_is_wrong_is_told_of_without_secrets(program):
    command = [sys.executable, "-m", program, URL]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    assert (done.returncode, "usage: " in done.stderr) == (2, True)
    assert PASSWORD not in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("connect(password='hunter2 x', user='u')", "connect(password='…', user='u')"),
        ('password="hunter2"', 'password="…"'),
        ("{'password': 'hunter2'}", "{'password': '…'}"),
        (r'{"said": "{\"password\": \"hunter2 \\ x\"}"}', r'{"said": "{\"password\": \"…\"}"}'),
        (r'password="hun\"ter2 x" y', 'password="…" y'),
        ("password = hunter2", "password = …"),
        ("PGPASSWORD: hunter2", "PGPASSWORD: …"),
        ("password='hunter2", "password='…'"),
        ("f(password=hunter2):", "f(password=…):"),
        ('postgresql://u:hun"ter2@db/e', "postgresql://u:…@db/e"),
        ("postgresql+psycopg://u:hun'ter2/x@db/e", "postgresql+psycopg://u:…@db/e"),
        ('["redis://:hunter2@db"]', '["redis://:…@db"]'),
    ],
)
def test_passwords_are_hidden_however_they_are_written(text, left):
    assert redact(text) == left


@pytest.mark.parametrize(
    "words",
    [
        ("-m", "eigenfail_api", "--port", "0", "--database", URL + "?connect_timeout=1"),
        ("-m", "eigenfail_services", "--launcher", "none", "--database", URL),
        ("-c", CLI, "db", "upgrade", "--database", URL),
    ],
)
def test_a_database_that_is_not_there_is_told_of_without_its_password(words):
    done = subprocess.run([sys.executable, *words], capture_output=True, check=False, text=True)
    assert done.returncode
    assert PASSWORD not in done.stdout + done.stderr


@pytest.mark.parametrize(
    "text",
    [
        "http://127.0.0.1:8440/campaigns/3 of ada@example.org",
        '{"url":"http://127.0.0.1:8440/","mail":"ada@example.org"}',
        "def _key(ef_count): efw_", "tcp://services:8441",
        "def f(password=None):", "http://127.0.0.1:8440/x?y='a',b@c",
        '{"url":"http://127.0.0.1:8440","mail":"ada@example.org"}',
        "['http://127.0.0.1:8440', 'ada@example.org']",
    ],
)  # fmt: skip
def test_what_is_no_secret_stays(text):
    assert redact(text) == text


def test_every_program_has_its_logs_redacted():
    """Each module that is run as a process sets them up, or says at least what nobody caught."""
    from eigenfail.cli import main
    from eigenfail_api import __main__ as api
    from eigenfail_services import __main__ as services
    from eigenfail_services.campaigns import ray_process
    from eigenfail_services.hub import learner_process
    from eigenfail_workers import __main__ as workers
    from eigenfail_workers.worker import actor, child

    for module in (
        *(main, api, services, ray_process, learner_process),
        *(workers, actor, child),
    ):
        text = Path(module.__file__).read_text()
        assert re.search(r"logs\.configure\(|report_uncaught\(", text), module
