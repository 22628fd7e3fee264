import os

import pytest

from homolog.errors import InputError
from homolog.io.atomic import atomic_write, replace_folder, write_text


def _write_half(path):
    path.write_text("half")
    raise ZeroDivisionError


def test_a_text_is_replaced_whole(tmp_path):
    write_text(tmp_path / "new" / "a.txt", "first\n")
    write_text(tmp_path / "new" / "a.txt", "Ä second\n")
    assert (tmp_path / "new" / "a.txt").read_text(encoding="utf-8") == "Ä second\n"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.txt"]


def test_a_write_that_breaks_off_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(ZeroDivisionError), atomic_write(path) as part:
        _write_half(part)
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["a.txt"]


def test_a_full_disk_is_an_input_error_that_names_the_file(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(InputError, match=r"a\.txt: can't be written: No space left"), atomic_write(path):
        raise OSError(28, "No space left on device")
    assert path.read_text() == "old"


def test_a_file_where_the_folder_should_be_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_text(tmp_path / "file" / "a.txt", "text")


def test_a_folder_appears_whole_and_one_that_holds_anything_is_not_touched(tmp_path):
    path = tmp_path / "a" / "series"
    for _ in range(2):  # the second time the folder is there, and empty
        with replace_folder(path) as part:
            (part / "1.txt").write_text("one")
            assert not path.exists() or not any(path.iterdir())
        assert [item.name for item in path.iterdir()] == ["1.txt"]
        with pytest.raises(InputError, match="already exists"), replace_folder(path):
            pass
        (path / "1.txt").unlink()
    with pytest.raises(ZeroDivisionError), replace_folder(path) as part:
        _write_half(part / "half.txt")
    assert [item.name for item in path.parent.iterdir()] == ["series"]


def test_folders_of_killed_processes_are_removed_and_those_of_others_are_not(tmp_path):
    names = [".part-999999999-series", f".part-{os.getppid()}-series", ".part-999999999-other", ".part-x"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "half.txt").write_text("half")
    with replace_folder(tmp_path / "series"):
        pass
    assert {item.name for item in tmp_path.iterdir()} == {"series", *names[1:]}
