"""The services on PostgreSQL, beside the same campaign in one process with no service at all."""

import hashlib
import json
import subprocess
import sys
import time

import deadlines
import numpy as np
import pytest
from accepted import accept_spec

from eigenfail import plugins
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import learner_seed
from eigenfail.values.learning import LearnerContext
from eigenfail_services.campaigns.rounds import Rounds, run_in_process
from eigenfail_services.store.store import open_store

pytestmark = pytest.mark.service

SPEC = CampaignSpec(name="postgres", method="monte_carlo", planner="idm", episodes=120, seed=21)


def digest_in_one_process() -> str:
    method = plugins.load(plugins.METHODS, SPEC.method)
    nothing = np.zeros((0, 100, 2), np.float32)
    context = LearnerContext(learner_seed(SPEC.seed), SPEC.episodes, 100, nothing)
    rounds = Rounds(method(context, method.Settings()), SPEC.seed, SPEC.episodes)
    engine = plugins.load(plugins.ENGINES, "default")(SPEC.setup())
    lines = (f"{r.index} {r.digest()}\n" for r in run_in_process(rounds, engine))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def test_a_campaign_on_postgres_has_the_digest_of_the_bare_loop(postgres_url: str) -> None:
    store = open_store(postgres_url)
    campaign = store.campaigns.create(accept_spec(SPEC)).id
    services = subprocess.Popen(
        [sys.executable, "-m", "eigenfail_services", "--database", postgres_url,
         "--launcher", "none"],
        stdout=subprocess.PIPE,
    )  # fmt: skip
    assert services.stdout is not None
    hub = json.loads(services.stdout.readline())["hub"]
    worker = subprocess.Popen([sys.executable, "-m", "eigenfail_workers", "--connect", hub])
    try:
        deadline = time.monotonic() + deadlines.PROCESS_S
        while store.campaigns.get(campaign).state is not CampaignState.DONE:
            assert time.monotonic() < deadline, store.campaigns.get(campaign)
            time.sleep(0.1)
        assert store.campaigns.get(campaign).digest == digest_in_one_process()
    finally:
        for process in (services, worker):
            process.terminate()
        assert [process.wait(deadlines.PROCESS_S) for process in (services, worker)] == [0, 0]
        services.stdout.close()
        store.close()


def test_a_wrong_password_is_said_without_the_password(postgres_url: str) -> None:
    wrong = "postgresql://nobody:s3cret@127.0.0.1:1/eigenfail"
    done = subprocess.run(
        [sys.executable, "-m", "eigenfail_services", "--database", wrong, "--launcher", "none"],
        capture_output=True, text=True, timeout=deadlines.PROCESS_S, check=False,
    )  # fmt: skip
    assert done.returncode == 3
    assert "s3cret" not in done.stderr + done.stdout
    assert "not available" in done.stderr
