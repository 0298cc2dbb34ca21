"""Files: whole or not at all, nothing of a stranger's touched, errors that say what to do."""

import json
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from shadowjax import io


def test_write_replaces_the_whole_file_and_leaves_no_temporary(tmp_path):
    target = tmp_path / "deep" / "file.txt"
    io.write_text(target, "a long first version")
    io.write_text(target, "short é")
    assert target.read_text(encoding="utf-8") == "short é"
    assert [path.name for path in target.parent.iterdir()] == ["file.txt"]


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    target = io.write_text(tmp_path / "file.txt", "old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(io.os, "replace", refuse)
    with pytest.raises(ValueError, match=r"cannot write .*file\.txt: no space left on device"):
        io.write_text(target, "new")
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_a_written_file_has_the_mode_of_a_plain_new_file(tmp_path):
    plain = tmp_path / "plain"
    plain.touch()
    assert io.write_text(tmp_path / "ours", "x").stat().st_mode == plain.stat().st_mode


def test_output_folder_keeps_what_it_holds(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert io.output_folder(tmp_path) == tmp_path
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_file_is_no_folder_and_a_folder_no_file(tmp_path):
    file = io.write_text(tmp_path / "file", "x")
    with pytest.raises(ValueError, match="is a file; give a folder"):
        io.output_folder(file)
    with pytest.raises(ValueError, match="cannot make the folder"):
        io.output_folder(file / "below")
    with pytest.raises(ValueError, match="is a folder; give the name of a file"):
        io.write_text(tmp_path, "x")


def test_json_round_trip_and_no_nan(tmp_path):
    path = io.write_json(tmp_path / "a.json", {"φ": [1, 2.5, None]})
    assert json.loads(path.read_text(encoding="utf-8")) == {"φ": [1, 2.5, None]}
    with pytest.raises(ValueError, match="JSON"):
        io.write_json(tmp_path / "b.json", float("nan"))
    assert not (tmp_path / "b.json").exists()


@pytest.mark.parametrize("shape", [(2, 3), (2, 3, 3), (2, 3, 4)])
def test_png_holds_the_pixels(shape):
    values = np.linspace(-0.2, 1.2, int(np.prod(shape))).reshape(shape)
    read = np.asarray(Image.open(BytesIO(io.png_bytes(values))))
    np.testing.assert_array_equal(read, np.round(255 * np.clip(values, 0, 1)).astype(np.uint8))
    assert io.png_bytes(values) == io.png_bytes(values)


@pytest.mark.parametrize("bad", [np.zeros((0, 3)), np.zeros(4), np.zeros((2, 2, 2)), np.full((2, 2), np.nan)])
def test_what_is_no_picture_is_refused(bad):
    with pytest.raises(ValueError, match="a picture"):
        io.png_bytes(bad)


def test_pictures_end_in_png(tmp_path):
    with pytest.raises(ValueError, match=r"ends in \.png"):
        io.write_png(tmp_path / "a.jpg", np.zeros((2, 2)))


def test_toml_errors_name_file_and_line(tmp_path):
    good = io.write_text(tmp_path / "good.toml", "near = 1.0\n[quick]\nnear = 2\n")
    assert io.read_toml(good) == {"near": 1.0, "quick": {"near": 2}}
    bad = io.write_text(tmp_path / "bad.toml", "near = 1\nfar = = 2\n")
    with pytest.raises(ValueError, match=r"bad\.toml is not valid TOML: .*line 2"):
        io.read_toml(bad)
    with pytest.raises(ValueError, match="no such configuration file"):
        io.read_toml(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="is a folder"):
        io.read_toml(tmp_path)
    latin = io.write_bytes(tmp_path / "latin.toml", b'name = "\xe9"')
    with pytest.raises(ValueError, match=r"cannot read .*latin\.toml"):
        io.read_toml(latin)


def test_lines_of_a_missing_file_are_none(tmp_path):
    assert io.read_lines(tmp_path / "none") == []
