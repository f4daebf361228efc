"""The folder of a service."""

from eigenfail.hosting.folder import DataFolder


def test_a_folder_that_is_made_is_for_its_owner_alone(tmp_path) -> None:
    with DataFolder(tmp_path / "data").claimed():
        assert (tmp_path / "data").stat().st_mode & 0o777 == 0o700
