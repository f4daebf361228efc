"""What the command says while it waits."""

from eigenfail import progress


def test_the_step_that_may_take_long_is_announced(eigenfail, done, tmp_path, monkeypatch):
    begun = []

    class Recorded(progress.WaitingLines):
        def __init__(self, step):
            super().__init__(step)
            begun.append(step)

    monkeypatch.setattr(progress, "WaitingLines", Recorded)
    assert eigenfail("report", done, "-o", tmp_path / "report").exit_code == 0
    assert "Writing the report" in begun
