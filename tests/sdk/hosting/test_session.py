"""`eigenfail.local()`: a service for a block or a notebook, and nothing left of it."""

import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

import eigenfail
from eigenfail.errors import InvalidValue, PortTaken, ServiceError, UnknownName
from eigenfail.hosting import session
from eigenfail.hosting.folder import Address
from eigenfail.hosting.processes import find_marked
from eigenfail.hosting.service import Launcher, register_planners


class Stub:
    """A service without processes."""

    address = Address("http://127.0.0.1:1", "tcp://127.0.0.1:2")
    trouble = None

    def check(self):
        if self.trouble:
            raise self.trouble


@pytest.fixture
def started(monkeypatch):
    """The plans of services that were started; None in the place of one that has ended."""
    plans = []

    @contextmanager
    def local_service(plan):
        plans.append(plan)
        assert plan.data.is_dir() or plan.data.name == "kept"
        yield Stub()
        plans[-1] = None

    monkeypatch.setattr(session, "local_service", local_service)
    return plans


def test_a_block_has_a_client_and_a_folder_that_is_gone_afterwards(started):
    with eigenfail.local(workers=3) as client:
        (plan,) = started
        assert client.url == Stub.address.url
        assert (plan.port, plan.workers, plan.launcher) == (0, 3, Launcher.LOCAL)
        assert plan.data.is_dir()
    assert started == [None]
    assert not plan.data.exists()


def test_a_folder_of_ones_own_is_kept(started, tmp_path):
    folder = tmp_path / "kept"
    folder.mkdir()
    with eigenfail.local(str(folder), port=8441, launcher="none"):
        (plan,) = started
        assert (plan.data, plan.port, plan.launcher) == (folder, 8441, Launcher.NONE)
    assert folder.is_dir()


def test_a_notebook_starts_and_stops_it(started):
    service = eigenfail.local()
    client = service.start()
    assert service.url == client.url
    service.check()
    with pytest.raises(ServiceError, match="is already running"):
        service.start()
    service.stop()
    service.stop()
    assert started == [None]
    with pytest.raises(ServiceError, match=r"Call start\(\)"):
        _ = service.url
    service.start()
    assert len(started) == 2
    service.stop()


def test_trouble_is_told(started, monkeypatch):
    with eigenfail.local() as client:
        assert client
    service = eigenfail.local()
    service.start()
    monkeypatch.setattr(Stub, "trouble", ServiceError("The controller process ended."))
    with pytest.raises(ServiceError, match="controller"):
        service.check()
    service.stop()


def test_an_error_in_the_block_ends_it_too(started):
    with pytest.raises(ZeroDivisionError), eigenfail.local():
        _ = 1 / 0
    assert started == [None]


def test_what_fails_to_start_leaves_no_folder(monkeypatch):
    folders = []

    def local_service(plan):
        folders.append(plan.data)
        raise PortTaken("Port 8440 is taken.")

    monkeypatch.setattr(session, "local_service", local_service)
    with pytest.raises(PortTaken):
        eigenfail.local().start()
    assert not folders[0].exists()


def test_what_is_wrong_is_refused_before_anything_starts(started):
    with pytest.raises(InvalidValue, match="below 0"):
        eigenfail.local(workers=-1)
    with pytest.raises(UnknownName, match="Did you mean 'ray'"):
        eigenfail.local(launcher="rayy")
    with pytest.raises(InvalidValue, match="a list does not give names"):
        eigenfail.local(planners=["my_module:MyPlanner"])
    with pytest.raises(InvalidValue, match="idm"):
        eigenfail.local(planners={"idm": "pathlib:Path"}).start()
    with pytest.raises(InvalidValue, match="cannot be loaded"):
        eigenfail.local(planners={"mine": "no_such_module:Planner"}).start()
    assert started == []


def test_planners_are_registered_for_this_service_alone(started, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with eigenfail.local(planners={"mine": "pathlib:Path"}):
        (plan,) = started
        plugins, here = plan.path
        assert here == Path.cwd() == tmp_path
        (listed,) = plugins.glob("*.dist-info/entry_points.txt")
        assert listed.read_text() == "[eigenfail.planners]\nmine = pathlib:Path\n"
    assert register_planners(tmp_path / "plugins", {}) == ()
    assert not (tmp_path / "plugins").exists()


def test_a_planner_is_found_where_this_process_finds_it(started, monkeypatch, tmp_path):
    package = tmp_path / "elsewhere" / "mine_of_two"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("class One: pass\n")
    (package / "deep.py").write_text("class Two: pass\n")
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    places = {"one": "mine_of_two:One", "two": "mine_of_two.deep:Two"}
    with eigenfail.local(planners=places):
        (plan,) = started
        assert plan.path[1:] == (Path.cwd(), tmp_path / "elsewhere")


def test_a_planner_of_a_notebooks_cell_is_refused(started, monkeypatch):
    monkeypatch.setattr(sys.modules["__main__"], "Mine", object, raising=False)
    with pytest.raises(InvalidValue, match=r"no service can import '__main__:Mine'.*file"):
        eigenfail.local(planners={"mine": "__main__:Mine"}).start()
    with pytest.raises(InvalidValue, match="not of the form module:Class"):
        eigenfail.local(planners={"mine": object}).start()
    assert started == []


def test_it_says_where_it_runs(started):
    service = eigenfail.local()
    assert repr(service) == "<Local: does not run>"
    with service as client:
        assert Stub.address.url in repr(service)
        assert repr(client) == f"Client('{Stub.address.url}')"


@pytest.mark.service
def test_a_real_one_works_in_any_thread_and_leaves_nothing(tmp_path):
    seen = []

    def work():
        with eigenfail.local(tmp_path / "data", launcher="none") as client:
            seen.extend((client.health(), [each.name for each in client.planners()]))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    healthy, planners = seen
    assert healthy
    assert "idm" in planners
    assert find_marked(str((tmp_path / "data").resolve())) == []
    assert (tmp_path / "data" / "eigenfail.db").exists()
