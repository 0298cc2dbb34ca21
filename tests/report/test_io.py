"""Files: whole or not at all, nothing of a stranger's touched, errors that say what to do."""

import errno
import json
import os
import stat
import threading
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
    with pytest.raises(ValueError, match="no regular file"):
        io.read_toml(tmp_path)
    latin = io.write_bytes(tmp_path / "latin.toml", b'name = "\xe9"')
    with pytest.raises(ValueError, match=r"cannot read .*latin\.toml"):
        io.read_toml(latin)


def test_lines_of_a_missing_file_are_none(tmp_path):
    assert io.read_lines(tmp_path / "none") == []


def test_toml_files_are_small_and_flat(tmp_path):
    large = io.write_text(tmp_path / "large.toml", "# " + "x" * 2**20)
    with pytest.raises(ValueError, match="larger than"):
        io.read_toml(large)
    deep = io.write_text(tmp_path / "deep.toml", "a = " + "[" * 9000)
    with pytest.raises(ValueError, match=r"deep\.toml"):
        io.read_toml(deep)


posix = pytest.mark.skipif(os.name != "posix", reason="needs the modes, links and devices of POSIX")


@posix
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o666, 0o755])
def test_a_file_that_is_replaced_keeps_its_mode(mode, tmp_path):
    target = io.write_text(tmp_path / "file", "old")
    target.chmod(mode)
    io.write_text(target, "new")
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == mode


@posix
@pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only root gives files away")
def test_a_file_that_is_replaced_keeps_its_owner(tmp_path):
    target = io.write_text(tmp_path / "file", "old")
    os.chown(target, 12345, 23456)
    target.chmod(0o640)
    io.write_text(target, "new")
    seen = target.stat()
    assert (seen.st_uid, seen.st_gid, stat.S_IMODE(seen.st_mode)) == (12345, 23456, 0o640)


@posix
def test_where_the_owner_cannot_be_kept_the_file_is_written_over(tmp_path, monkeypatch):
    target = io.write_text(tmp_path / "file", "a longer old version")
    inode, real = target.stat().st_ino, os.stat

    def anothers(path, **given):
        seen = real(path, **given)
        return os.stat_result((*seen[:4], 54321, *seen[5:])) if str(path) == str(target) else seen

    def refused(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(io.os, "stat", anothers)
    monkeypatch.setattr(io.os, "chown", refused)
    io.write_text(target, "new")
    assert target.read_text() == "new"
    assert real(target).st_ino == inode
    assert os.listdir(tmp_path) == ["file"]


@posix
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    target, new = io.write_text(folder / "file", "old"), folder / "new"
    for link, real in ((tmp_path / "link", target), (tmp_path / "dangling", new)):
        link.symlink_to(real)
        chain = tmp_path / f"{link.name} of a link"
        chain.symlink_to(link.name)
        for name in (link, chain):
            io.write_text(name, f"by {name.name}")
            assert name.is_symlink()
            assert real.read_text() == f"by {name.name}"
    assert sorted(os.listdir(folder)) == ["file", "new"]
    circle = tmp_path / "circle"
    circle.symlink_to(circle)
    with pytest.raises(ValueError, match=r"cannot write .*circle"):
        io.write_text(circle, "x")


@posix
def test_of_several_names_the_given_one_gets_the_new_content(tmp_path):
    one = io.write_text(tmp_path / "one", "old")
    os.link(one, tmp_path / "two")
    io.write_text(one, "new")
    assert [(tmp_path / name).read_text() for name in ("one", "two")] == ["new", "old"]


@posix
def test_pipes_and_devices_are_written_to_and_stay(tmp_path):
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    content = bytes(range(256)) * 1000  # more than a pipe holds at once
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    io.write_bytes(pipe, content)
    reader.join(20)
    assert got == [content]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    io.write_bytes(os.devnull, content)
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    assert os.listdir(tmp_path) == ["pipe"]


@posix
def test_names_of_open_files_are_written_where_these_stand(tmp_path):
    """As with `command > file`: what was written before stays, and nothing takes the file's place."""
    link = tmp_path / "link"
    with open(tmp_path / "file", "wb", buffering=0) as stream:
        stream.write(b"before, ")
        link.symlink_to(f"/dev/fd/{stream.fileno()}")
        io.write_bytes(f"/dev/fd/{stream.fileno()}", b"ours")
        io.write_bytes(link, b", once more")
        stream.write(b", after")
    assert (tmp_path / "file").read_bytes() == b"before, ours, once more, after"
    assert io.is_standard_output("-")
    assert io.is_standard_output("/dev/stdout")
    assert io.is_standard_output("/proc/self/fd/1")
    assert not io.is_standard_output(tmp_path / "file")
    with pytest.raises(ValueError, match="bad file descriptor"):
        io.write_bytes("/dev/fd/987654", b"x")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_disk_is_a_complaint(tmp_path):
    (tmp_path / "link").symlink_to("/dev/full")
    for name in ("/dev/full", tmp_path / "link"):
        with pytest.raises(ValueError, match="no space left on device"):
            io.write_text(name, "x")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


@posix
def test_a_folder_that_takes_no_new_names_lets_its_files_be_written(tmp_path, monkeypatch):
    target = io.write_text(tmp_path / "file", "old")
    (tmp_path / "file").chmod(0o600)
    real = os.open

    def locked(path, flags, *mode):
        if flags & os.O_EXCL:
            raise PermissionError(errno.EACCES, "Permission denied", path)
        return real(path, flags, *mode)

    monkeypatch.setattr(io.os, "open", locked)
    for content in ("longer than before", "new", ""):
        io.write_text(target, content)
        assert target.read_text() == content
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    with pytest.raises(ValueError, match=r"cannot write .*other: permission denied"):
        io.write_text(tmp_path / "other", "x")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    io.write_text(target, "kept")
    monkeypatch.setattr(io.os, "posix_fallocate", full)
    with pytest.raises(ValueError, match="no space left"):
        io.write_text(target, "much longer than it was")
    assert target.read_text() == "kept"


def test_files_that_belong_together_are_written_together(tmp_path):
    first, second = io.write_text(tmp_path / "first", "old"), tmp_path / "first" / "below a file"
    with pytest.raises(ValueError, match="first"):
        io.write_files({first: b"new", second: b"new"})
    assert first.read_text() == "old"
    io.write_files({first: b"new", tmp_path / "second": b"new"})
    assert sorted(os.listdir(tmp_path)) == ["first", "second"]


@pytest.mark.parametrize(
    ("name", "message"),
    [("x" * 300, "too long"), ("a/" * 2500 + "x", "cannot make the folder|too long"), ("", "is a folder")],
)
def test_names_that_cannot_be(name, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for complain in (io.check_output, lambda path: io.write_text(path, "x")):
        with pytest.raises(ValueError, match=message):
            complain(name)


@posix
def test_what_is_read_only_is_not_replaced(tmp_path, monkeypatch):
    target = io.write_text(tmp_path / "file", "old")
    real = os.access
    monkeypatch.setattr(io.os, "access", lambda path, mode: str(path) != str(target) and real(path, mode))
    with pytest.raises(ValueError, match="is read-only"):
        io.check_output(target)
    with pytest.raises(ValueError, match="is read-only"):
        io.write_text(target, "new")
    assert target.read_text() == "old"


def test_json_escapes_what_steers_a_screen():
    names = ["\x1b[31mred", "a\nb", "\x9b0m\x7f", "\u202eright to left", "\udcff", "\U000e0041", "φ ² Ж 汉"]
    shown = io.json_text(names)
    assert all(sign.isprintable() or sign == "\n" for sign in shown)
    assert json.loads(shown) == names
    assert "φ ² Ж 汉" in shown
    assert io.json_text(names, ascii_only=True).isascii()
