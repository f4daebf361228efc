"""The services process from its start to its end, without workers."""

import pytest

from eigenfail.errors import StoreUnavailable
from eigenfail_services import __main__ as module
from eigenfail_services import options


class Launcher:
    stopped = 0

    def start(self, hub: str, _key: object, _given_up: object) -> None:
        pass

    def stop(self) -> None:
        Launcher.stopped += 1


def test_workers_are_taken_down_although_the_store_is_away_at_the_end(
    tmp_path, monkeypatch, capsys
) -> None:
    def away(_supervisor) -> None:
        raise StoreUnavailable("The disk is full.")

    monkeypatch.setattr(module.signal, "signal", lambda *_: None)
    monkeypatch.setattr(module, "supervise", lambda *_: None)
    monkeypatch.setattr(module.Supervisor, "release", away)
    monkeypatch.setattr(options, "create_launcher", lambda _: Launcher())
    with pytest.raises(StoreUnavailable):
        module.serve(
            module.parse(["--database", f"sqlite:///{tmp_path}/e.db", "--launcher", "none"])
        )
    assert Launcher.stopped == 1
    assert '"ready": true' in capsys.readouterr().out
