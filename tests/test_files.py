"""What is written is there whole or not at all, and nothing that stood there is lost."""

import pytest

from hil.configfile import write_rig_file
from hil.errors import ConfigError
from hil.files import whole_folder, write_whole


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that takes three bytes of a file."""

    def write(path, data):
        with path.open("wb") as stream:
            stream.write(data[:3])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", write)


def test_a_file_takes_the_place_of_the_one_before(tmp_path):
    for data in ("first µ", b"second"):
        write_whole(tmp_path / "x", data)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"second"]


def test_a_full_disk_leaves_what_stood_there(tmp_path, full_disk):
    (tmp_path / "x").write_text("mine")
    with pytest.raises(OSError, match="No space left"):
        write_whole(tmp_path / "x", "another")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["mine"]


def test_a_full_disk_leaves_no_rig_file_that_would_be_in_the_way(tmp_path, full_disk):
    with pytest.raises(ConfigError, match=r"x\.toml: cannot be written: No space left"):
        write_rig_file(tmp_path / "x.toml", "name = 'axis'")
    assert not list(tmp_path.iterdir())


def filled(folder, fault=None):
    with whole_folder(folder) as fresh:
        (fresh / "x").write_text("x")
        if fault is not None:
            raise fault


def test_a_folder_that_is_not_filled_is_not_there(tmp_path):
    for fault in (OSError(28, "No space left on device"), KeyboardInterrupt()):
        with pytest.raises(type(fault)):
            filled(tmp_path / "a" / "run", fault)
        assert not list((tmp_path / "a").iterdir())


def test_a_folder_takes_the_place_of_an_empty_one_and_of_no_other(tmp_path):
    killed = tmp_path / ".run.part" / "half"
    killed.mkdir(parents=True)
    (tmp_path / "run").mkdir()
    filled(tmp_path / "run")
    assert [p.name for p in tmp_path.rglob("*")] == ["run", "x"]
    with pytest.raises(FileExistsError):
        filled(tmp_path / "run")
    with pytest.raises(FileExistsError):
        filled(tmp_path / "run" / "x")
