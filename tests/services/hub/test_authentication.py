"""The hub's door over real sockets: who has an allowed key gets in, all others get nothing."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import deadlines
import pytest
import zmq
from structlog.testing import capture_logs

from eigenfail.addresses import TRUST_VARIABLE
from eigenfail.errors import EigenfailError, InvalidValue, ServiceUnreachable, Unauthorized
from eigenfail.files import read_private
from eigenfail.wire.keys import WorkerKey, read_hub_key, read_worker_key
from eigenfail.wire.messages import PROTOCOL, Hello, Observed, Welcome, encode
from eigenfail_services.bounds import NO_BOUNDS
from eigenfail_services.hub import transport
from eigenfail_services.hub.keys import HubKeys, KeyFolder, derive_public_key, generate_secret
from eigenfail_services.hub.learner_link import LearnerLink, encrypt_caller
from eigenfail_services.hub.server import Hub
from eigenfail_services.store.store import open_store
from eigenfail_workers.worker import hub_connection
from eigenfail_workers.worker.hub_connection import HubConnection

PATIENCE_S = deadlines.PROCESS_S
SILENCE_MS = 500
GREETING_BYTES = 64
"""What every ZeroMQ says first, whoever it is that connects."""

Make = Callable[[str], WorkerKey]


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder(tmp_path / "hub-keys")


@pytest.fixture
def make(folder: KeyFolder, tmp_path: Path) -> Make:
    """Makes a key that is let in."""

    def made(name: str) -> WorkerKey:
        file = tmp_path / f"{name}.key"
        folder.create(name, file)
        return read_worker_key(read_private(file, ""), "")

    return made


@pytest.fixture
def key(make: Make) -> WorkerKey:
    return make("ours")


@pytest.fixture
def keys(key: WorkerKey, folder: KeyFolder) -> HubKeys:
    return HubKeys(folder)


@pytest.fixture
def hub(keys: HubKeys) -> Iterator[Hub]:
    with serving(keys) as running:
        yield running


@contextmanager
def serving(keys: HubKeys | None) -> Iterator[Hub]:
    hub = Hub(open_store("memory://"), "tcp://127.0.0.1:*", keys)
    hub.start()
    yield hub
    hub.stop()


def welcomed(hub: Hub, key: WorkerKey | None, name: str = "w") -> HubConnection:
    """A worker's link that the hub has welcomed."""
    link = HubConnection(hub.address, key)
    try:
        link.send(Hello(PROTOCOL, name, 1))
        wait_for(link, Welcome)
    except BaseException:
        link.close()
        raise
    return link


def wait_for(link: HubConnection, kind: type) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if any(isinstance(message, kind) for message in link.receive()):
            return
        link.socket.poll(50)
    raise AssertionError(f"no {kind.__name__}")


def wait_until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_so_are_workers_that_the_service_starts_itself(hub: Hub, keys: HubKeys) -> None:
    welcomed(hub, keys.create_own("own")).close()


def test_a_key_that_is_made_later_opens_at_once(hub: Hub, make: Make) -> None:
    welcomed(hub, make("later")).close()


def of_nobody(key: WorkerKey, folder: KeyFolder) -> WorkerKey:
    return WorkerKey(key.hub, generate_secret())


def revoked(key: WorkerKey, folder: KeyFolder) -> WorkerKey:
    folder.revoke("ours")
    return key


def of_another_hub(key: WorkerKey, folder: KeyFolder) -> WorkerKey:
    return WorkerKey(derive_public_key(generate_secret()), key.secret)


def none_at_all(key: WorkerKey, folder: KeyFolder) -> None:
    return None


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers end soon where every handshake is broken off."""
    monkeypatch.setattr(hub_connection, "GIVE_UP_S", 0.3)


REFUSED = {
    of_nobody: (Unauthorized, "rejects this worker's key"),
    revoked: (Unauthorized, "rejects this worker's key"),
    of_another_hub: (ServiceUnreachable, "Is the worker's key one of this hub's"),
    none_at_all: (EigenfailError, "--key-file"),
}


@pytest.mark.fault(
    "worker with a missing, wrong, revoked or foreign key",
    group="messages",
    outcome="It ends with one sentence; the hub reads nothing from it and serves the others.",
)
@pytest.mark.parametrize("wrong", REFUSED)
def test_whoever_has_not_ends_with_words_and_gets_nothing(
    hub: Hub, folder: KeyFolder, make: Make, impatient: None, wrong
) -> None:
    error, words = REFUSED[wrong]
    shown = wrong(make("ours"), folder)
    with capture_logs() as told:
        with pytest.raises(error, match=words) as refusal:
            welcomed(hub, shown)
        if shown is not None:  # who has none may have hung up before the hub looked
            wait_until(lambda: "worker refused" in {line["event"] for line in told})
    assert refusal.value.exit_code in {2, 3}
    assert hub.workers() == []
    with closing(welcomed(hub, make("another"), "another")):
        assert hub.workers() == ["another"]


def until_refused(link: HubConnection) -> None:
    """Speak as a worker does, which makes its connection anew when nobody answers."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        link.send(Hello(PROTOCOL, "w", 1))
        if not link.socket.poll(SILENCE_MS):
            link.reconnect()
        list(link.receive())
    raise AssertionError("it is let in again and again")


def taken_away(folder: KeyFolder, _clock: list[int], _tmp_path: Path) -> None:
    folder.revoke("ours")


def run_out(_folder: KeyFolder, clock: list[int], _tmp_path: Path) -> None:
    clock[0] += 90_000


def renewed(folder: KeyFolder, _clock: list[int], tmp_path: Path) -> None:
    folder.rotate("ours", tmp_path / "new.key")


@pytest.mark.fault(
    "worker key revoked, renewed or expired while connected",
    group="messages",
    outcome="Within two seconds the hub neither takes from nor sends to that worker, and "
    "leases its episodes to others. The worker connects again, is refused and ends.",
)
@pytest.mark.parametrize("ended", [taken_away, run_out, renewed])
def test_who_is_in_is_cut_off_when_the_key_ends(tmp_path: Path, ended) -> None:
    clock = [1_000_000]
    folder = KeyFolder(tmp_path / "hub-keys", lambda: clock[0])
    file = tmp_path / "ours.key"
    folder.create("ours", file, until_ms=clock[0] + 60_000)
    folder.create("others", tmp_path / "others.key")
    key = read_worker_key(read_private(file, ""), "")
    other = read_worker_key(read_private(tmp_path / "others.key", ""), "")
    with (
        serving(HubKeys(folder)) as hub,
        closing(welcomed(hub, other, "other")) as stays,
        closing(welcomed(hub, key)) as link,
        capture_logs() as told,
    ):
        assert set(hub.workers()) == {"w", "other"}
        ended(folder, clock, tmp_path)
        with pytest.raises(Unauthorized, match="rejects this worker's key"):
            until_refused(link)
        assert hub.workers() == ["other"]
        stays.send(Hello(PROTOCOL, "other", 1))
        wait_for(stays, Welcome)
    assert [line["event"] for line in told].count("worker disconnected") == 1


def test_a_key_that_is_let_in_again_opens_again(
    hub: Hub, key: WorkerKey, folder: KeyFolder
) -> None:
    file = folder.path / "workers" / "ours"
    line = file.read_text()
    with closing(welcomed(hub, key)) as link:
        folder.revoke("ours")
        with pytest.raises(Unauthorized, match="rejects this worker's key"):
            until_refused(link)
    assert hub.workers() == []
    file.write_text(line)
    with closing(welcomed(hub, key)):
        assert hub.workers() == ["w"]


def test_a_key_that_is_renewed_opens_with_the_old_one_for_a_while(
    hub: Hub, key: WorkerKey, folder: KeyFolder, tmp_path: Path
) -> None:
    in_an_hour_ms = round(1_000 * time.time()) + 3_600_000
    folder.rotate("ours", tmp_path / "new.key", old_until_ms=in_an_hour_ms)
    new = read_worker_key(read_private(tmp_path / "new.key", ""), "")
    with closing(welcomed(hub, key)), closing(welcomed(hub, new, "new")):
        assert set(hub.workers()) == {"w", "new"}


def test_a_hub_with_a_new_key_knows_its_workers_which_follow_it(
    key: WorkerKey, folder: KeyFolder, impatient: None
) -> None:
    made = folder.rotate_hub()
    with serving(HubKeys(folder)) as hub:
        with pytest.raises(ServiceUnreachable, match="one of this hub's"):
            welcomed(hub, key)
        welcomed(hub, key.following(read_hub_key(made.hub, ""))).close()


@pytest.mark.fault(
    "plain ZeroMQ or HTTP at a hub that requires keys",
    group="messages",
    outcome="It is refused before a message is read, and delays no worker.",
)
def test_plain_zeromq_hears_nothing_and_is_not_heard(hub: Hub, key: WorkerKey) -> None:
    with zmq.Context.instance().socket(zmq.DEALER) as stranger:
        stranger.setsockopt(zmq.LINGER, 0)
        stranger.connect(hub.address)
        stranger.send(encode(Hello(PROTOCOL, "stranger", 1)))
        assert not stranger.poll(SILENCE_MS)
        with closing(welcomed(hub, key)):
            assert hub.workers() == ["w"]


@pytest.mark.fault("plain ZeroMQ or HTTP at a hub that requires keys")
@pytest.mark.parametrize("data", [b"", b"GET / HTTP/1.1\r\nHost: h\r\n\r\n", b"\xff" * 5_000])
def test_foreign_bytes_hear_nothing_and_hold_up_nobody(hub: Hub, key: WorkerKey, data) -> None:
    port = int(hub.address.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as stranger:
        stranger.sendall(data)
        welcomed(hub, key).close()
        stranger.settimeout(0.2)
        assert len(all_heard(stranger)) <= GREETING_BYTES


def all_heard(stranger: socket.socket) -> bytes:
    """Until it falls silent or hangs up."""
    heard = b""
    with suppress(TimeoutError, ConnectionError):
        while more := stranger.recv(1_000):
            heard += more
    return heard


@pytest.mark.fault(
    "folder of hub keys unreadable, or its thread dead",
    group="messages",
    outcome="No new worker is admitted, and none is told that its key is wrong: workers try "
    "again every 10 s, and one that was never admitted ends after 30 s.",
)
def test_while_the_folder_cannot_be_read_nobody_is_let_in_and_nobody_refused(
    keys: HubKeys, key: WorkerKey, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker goes on knocking, and is let in once it can be looked up."""
    monkeypatch.setattr(transport, "HANDSHAKE_MS", 1_000)
    tries = []

    def broken(_folder: KeyFolder) -> None:
        tries.append(1)
        raise OSError(5, "Input/output error")

    with serving(keys) as hub, capture_logs() as told, monkeypatch.context() as patch:
        patch.setattr(KeyFolder, "read_all", broken)
        with closing(HubConnection(hub.address, key)) as link:
            link.send(Hello(PROTOCOL, "w", 1))
            wait_until(lambda: list(link.receive()) == [] and len(tries) > 1)
            assert hub.workers() == []
            patch.undo()
            wait_for(link, Welcome)
    reasons = [line["reason"] for line in told if line["event"] == "worker refused"]
    assert "the folder of keys cannot be read: Input/output error" in reasons


@pytest.mark.fault("folder of hub keys unreadable, or its thread dead")
def test_once_nobody_keeps_the_door_nobody_gets_in(
    keys: HubKeys, key: WorkerKey, impatient: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(_door: transport.ZapAuthenticator, *sockets: zmq.Socket) -> None:
        for each in sockets:
            each.close()

    monkeypatch.setattr(transport, "HANDSHAKE_MS", 200)
    monkeypatch.setattr(transport.ZapAuthenticator, "_serve", die)
    with transport.ZapAuthenticator(keys).open_router() as router:
        router.bind("tcp://127.0.0.1:*")
        link = HubConnection(router.getsockopt_string(zmq.LAST_ENDPOINT), key)
        with closing(link), pytest.raises(EigenfailError):
            wait_for(link, Welcome)
        assert not link.handshakes._was_accepted
    router.context.term()


def test_a_hub_that_is_closed_lets_go_of_its_door(keys: HubKeys) -> None:
    doors: set[threading.Thread] = set()
    for _ in range(3):
        before = {thread for thread in threading.enumerate() if thread.name == "zap"}
        with serving(keys):
            (mine,) = {thread for thread in threading.enumerate() if thread.name == "zap"} - before
        doors.add(mine)
    assert len(doors) == 3
    for thread in doors:
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def test_a_flood_of_refusals_is_few_lines_with_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(transport.time, "monotonic", lambda: now[0])
    refusals = transport.RefusalLog()
    with capture_logs() as told:
        for moment in range(100):
            now[0] = moment / 5
            refusals.add("why")
    assert [line["times"] for line in told] == [1, 50]


def secrets_of(*keys: bytes) -> set[str]:
    return {text for key in keys for text in (key.hex(), repr(key)[2:-1])}


def test_no_secret_is_logged_or_shown(hub: Hub, key: WorkerKey, keys: HubKeys, folder) -> None:
    with capture_logs() as told:
        welcomed(hub, key).close()
        folder.revoke("ours")
        with pytest.raises(EigenfailError) as refusal:
            welcomed(hub, key)
    said = f"{told} {refusal.value} {key} {key!r} {keys!r} {folder!r}"
    assert "worker authenticated" in said
    assert key.text() not in said
    assert not [secret for secret in secrets_of(key.secret, keys.secret) if secret in said]


def test_a_worker_shows_its_key_to_its_own_hub_alone(key: WorkerKey) -> None:
    with serving(None) as plain, pytest.raises(Unauthorized, match="no hub that takes keys"):
        welcomed(plain, key)
    assert plain.workers() == []


BEYOND = "tcp://0.0.0.0:8441"


def test_beyond_this_machine_there_are_keys_or_somebody_vouches(
    keys: HubKeys, folder: KeyFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(TRUST_VARIABLE, raising=False)
    with pytest.raises(InvalidValue, match="eigenfail worker key create"):
        transport.load_keys(BEYOND, None)
    assert transport.load_keys("tcp://127.0.0.1:*", None) is None
    assert isinstance(transport.load_keys(BEYOND, folder.path), HubKeys)
    assert isinstance(transport.load_keys("tcp://127.0.0.1:*", folder.path), HubKeys)
    monkeypatch.setenv(TRUST_VARIABLE, "1")
    assert transport.load_keys(BEYOND, None) is None
    with pytest.raises(InvalidValue, match="no hub key"):
        transport.load_keys(BEYOND, tmp_path / "empty")


@pytest.mark.parametrize("guessed", [None, "another"])
def test_nobody_else_speaks_with_a_learner(monkeypatch: pytest.MonkeyPatch, guessed) -> None:
    monkeypatch.setattr("eigenfail_services.hub.learner_link.sys.executable", "/bin/false")
    link = LearnerLink(NO_BOUNDS)
    with zmq.Context.instance().socket(zmq.PAIR) as stranger:
        if guessed:
            encrypt_caller(stranger, zmq.curve_keypair()[0].decode())
        stranger.setsockopt(zmq.LINGER, 0)
        stranger.connect(link.socket.getsockopt_string(zmq.LAST_ENDPOINT))
        link.send(Observed(()))
        assert not stranger.poll(SILENCE_MS)
        assert link.receive() is None
    link.stop()
