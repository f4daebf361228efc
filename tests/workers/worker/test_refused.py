"""A worker that a hub of another release refuses: what its log says, and that it asks on."""

import pytest

from eigenfail.versions import versions
from eigenfail.wire.messages import PROTOCOL, Heartbeat, Hello, Refusal, Welcome

pytestmark = pytest.mark.service

REASON = (
    f"The worker speaks protocol {PROTOCOL} (eigenfail 0.1.0), the hub speaks 9 (eigenfail 0.9.0): "
    "install the same eigenfail on both."
)


def test_the_reason_is_said_once_and_it_joins_when_the_hub_is_another(
    hub, start_worker, eventually, tmp_path
) -> None:
    start_worker("--name", "w")
    for _ in range(3):
        hello = hub.hear(Hello)
        assert hello.versions["eigenfail"] == versions()["eigenfail"]
        hub.say(Refusal(REASON))
    hub.hear(Hello)
    hub.say(Welcome(heartbeat_s=0.1))
    hub.hear(Heartbeat)
    eventually(lambda: "welcomed" in (tmp_path / "said").read_text())
    said = (tmp_path / "said").read_text()
    assert said.count(REASON) == 1
    (line,) = [line for line in said.splitlines() if REASON in line]
    assert "warning" in line
