"""Where a process cannot be given a guard."""

import errno
import os

import pytest

from eigenfail_workers.worker.guard import leave_guard


def no_kernel_for_it(_pid: int) -> int:
    raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))


@pytest.mark.parametrize("of_python", [True, False])
def test_without_a_handle_on_itself_a_process_goes_on_and_says_so(
    monkeypatch, capsys, of_python
) -> None:
    monkeypatch.setattr(os, "pidfd_open", no_kernel_for_it)
    if of_python:
        monkeypatch.delattr(os, "pidfd_open")
    leave_guard()
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert "may outlive this process" in told.err
