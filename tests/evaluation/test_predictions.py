import numpy as np
import pytest

from stereomend.errors import InvalidParameter, UnknownFormat
from stereomend.evaluation.predictions import find_methods


def write(*paths):
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")


def test_a_frame_lies_in_folders_or_has_underscores(tmp_path):
    paths = tmp_path / "raft/a/1.png", tmp_path / "raft/a_2.pfm", tmp_path / "raft/3.npy"
    write(*paths, tmp_path / "notes.txt")
    (raft,) = find_methods(tmp_path, ["a/1", "a/2", "3"])
    assert raft.name == "raft"
    assert raft.files == dict(zip(["a/1", "a/2", "3"], paths, strict=True))


def test_every_folder_is_a_method_in_the_order_of_names(tmp_path):
    write(tmp_path / "b/1.tiff", tmp_path / "a/1.tif")
    assert [method.name for method in find_methods(tmp_path, ["1"])] == ["a", "b"]


def test_a_dot_in_a_name_is_no_ending(tmp_path):
    write(tmp_path / "m/scene-1.5.png")
    assert find_methods(tmp_path, ["scene-1.5"])[0].files["scene-1.5"].name == "scene-1.5.png"


def test_a_missing_map_is_named_with_what_is_there(tmp_path):
    write(tmp_path / "m/1.png")
    with pytest.raises(UnknownFormat, match=r"m/2 is missing; expected .*\.png.*; .*m holds 1\.png"):
        find_methods(tmp_path, ["1", "2"])


def test_maps_that_lie_loose_are_refused(tmp_path):
    np.save(tmp_path / "1.npy", np.ones((2, 2)))
    with pytest.raises(UnknownFormat, match=r"holds 1\.npy; expected one folder per method"):
        find_methods(tmp_path, ["1"])
    with pytest.raises(UnknownFormat, match="nowhere does not exist"):
        find_methods(tmp_path / "nowhere", ["1"])


def test_two_frames_must_not_share_a_flat_name(tmp_path):
    with pytest.raises(InvalidParameter, match="2 frames are named a_b_c"):
        find_methods(tmp_path, ["a/b_c", "d", "a_b/c"])
