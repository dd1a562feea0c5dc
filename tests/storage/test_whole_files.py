"""A file is wholly there or not there: whatever goes wrong, the old content stays and nothing is left beside it."""

from __future__ import annotations

import errno
import os
import signal
from pathlib import Path

import h5py
import pytest

from barchan.errors import InputError
from barchan.storage import TEMPORARY_MARK, remove_partial_files, replacing, write_bytes, write_text


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_new_content_replaces_the_old_and_nothing_else_remains(tmp_path: Path) -> None:
    write_bytes(tmp_path / "kept", b"old")
    write_text(tmp_path / "kept", "new, \N{GREEK SMALL LETTER MU}")
    assert contents(tmp_path) == {"kept": b"new, \xce\xbc"}


def test_a_failing_writer_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    write_bytes(tmp_path / "kept", b"old")

    def write_half() -> None:
        with replacing(tmp_path / "kept") as temporary:
            temporary.write_bytes(b"half of the ne")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert contents(tmp_path) == {"kept": b"old"}


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_a_full_or_broken_disk_leaves_the_old_file(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: int) -> None:
        raise OSError(code, os.strerror(code))

    write_bytes(tmp_path / "kept", b"old")
    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(InputError, match=os.strerror(code)):
        write_bytes(tmp_path / "kept", b"new")
    assert contents(tmp_path) == {"kept": b"old"}


@pytest.mark.parametrize("place", ["absent/below", "file/below"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=rf"{place} = not writable") as caught:
        write_bytes(tmp_path / place, b"x")
    assert TEMPORARY_MARK not in str(caught.value)
    assert contents(tmp_path) == {"file": b""}


def test_the_system_s_refusal_is_told_without_the_temporary_name(tmp_path: Path) -> None:
    def create_where_no_file_can_be() -> None:
        with replacing(tmp_path / "kept.h5") as temporary:
            temporary.mkdir()
            h5py.File(temporary, "w")

    try:
        with pytest.raises(InputError, match=r"kept\.h5 = not writable") as caught:
            create_where_no_file_can_be()
        assert TEMPORARY_MARK not in str(caught.value)
    finally:
        for folder in tmp_path.iterdir():
            folder.rmdir()


def test_a_folder_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    with pytest.raises(InputError, match="a folder: must be a file name"):
        write_bytes(tmp_path / "kept", b"x")
    assert (tmp_path / "kept").is_dir()


def test_two_processes_writing_the_same_file_do_not_mix(tmp_path: Path) -> None:
    with replacing(tmp_path / "kept") as temporary:
        temporary.write_bytes(b"parent")
        child = os.fork()
        if child == 0:
            write_bytes(tmp_path / "kept", b"child")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        assert (tmp_path / "kept").read_bytes() == b"child"
    assert contents(tmp_path) == {"kept": b"parent"}


def test_what_a_killed_process_leaves_is_recognised_and_removed(tmp_path: Path) -> None:
    write_bytes(tmp_path / "kept", b"old")
    child = os.fork()
    if child == 0:
        with replacing(tmp_path / "kept") as temporary:
            temporary.write_bytes(b"half of the ne")
            os.kill(os.getpid(), signal.SIGKILL)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(contents(tmp_path)) == 2
    assert contents(tmp_path)["kept"] == b"old"
    remove_partial_files(tmp_path)
    assert contents(tmp_path) == {"kept": b"old"}
