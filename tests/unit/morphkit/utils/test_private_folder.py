import os
from pathlib import Path

import pytest

from morphkit.utils.private_folder import private_file, private_folder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")


def test_a_folder_is_made_for_this_user_only(tmp_path: Path) -> None:
    old = os.umask(0)
    try:
        with private_folder(tmp_path / "a" / "b") as folder:
            assert os.fstat(folder).st_mode & 0o777 == 0o700
    finally:
        os.umask(old)
    with private_folder(tmp_path / "a" / "b"):
        pass


@pytest.mark.parametrize("mode", [0o777, 0o755, 0o750, 0o1777, 0o701])
def test_folders_open_to_others_are_refused(tmp_path: Path, mode: int) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a").chmod(mode)
    with pytest.raises(PermissionError, match="belongs to another user, or others may enter"):
        private_folder(tmp_path / "a").__enter__()


def test_folders_of_others_links_and_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "private").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "private")
    (tmp_path / "file").touch()
    for name in ("link", "file"):
        with pytest.raises(OSError, match=r"Not a directory|Too many levels"):
            private_folder(tmp_path / name).__enter__()
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    with pytest.raises(PermissionError):
        private_folder(tmp_path / "private").__enter__()


def test_files_that_others_can_have_written_are_refused(tmp_path: Path) -> None:
    with private_folder(tmp_path / "private") as folder:
        file = tmp_path / "private" / "file"
        file.write_text("mine")
        with private_file(folder, "file") as descriptor:
            assert os.read(descriptor, 9) == b"mine"
        for mode in (0o666, 0o620):
            file.chmod(mode)
            with pytest.raises(PermissionError):
                private_file(folder, "file").__enter__()
        (tmp_path / "private" / "link").symlink_to(file)
        os.mkfifo(tmp_path / "private" / "pipe", 0o600)
        for name in ("link", "pipe", "missing", "."):
            with pytest.raises(OSError):  # noqa: PT011 - each for another reason
                private_file(folder, name).__enter__()
