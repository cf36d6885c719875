"""The stored form of a result, and what is rendered from it."""

import io
from dataclasses import replace

import numpy as np
import pytest

from stereomend.codec import MEDIA_TYPES, PREVIEW_TYPE, encode_result, encode_stored, render
from stereomend.errors import InternalError, InvalidParameter
from stereomend.refinement import refine

CALIBRATION = {"focal_px": 50.0, "baseline_mm": 5.0}
TYPES = sorted({*MEDIA_TYPES.values(), PREVIEW_TYPE})


@pytest.fixture(scope="module")
def result(scene):
    quick = {"gdr": {"warps": 1, "levels": 1}}
    return refine(scene.left, scene.right, scene.disparity, backend="reference", **CALIBRATION, **quick)


@pytest.mark.parametrize("media_type", TYPES)
@pytest.mark.parametrize("image", ["colour", "grey", "16 bits"])
def test_a_stored_result_is_rendered_as_it_would_have_been_encoded(result, scene, media_type, image):
    left = {"colour": scene.left, "grey": scene.left[..., 0], "16 bits": scene.left * np.uint16(257)}[image]
    assert render(encode_stored(result, left), media_type) == encode_result(result, media_type, left=left)


def test_a_zip_has_the_outputs_that_are_asked_for_and_never_the_image(result, scene):
    rendered = render(encode_stored(result, scene.left), "application/zip", ("provenance", "disparity"))
    with np.load(io.BytesIO(rendered)) as archive:
        assert set(archive.files) == {"meta", "disparity", "provenance"}


def test_the_image_is_kept_only_where_a_point_cloud_can_be_made(result, scene):
    meta = {name: value for name, value in result.meta.items() if name != "calibration"}
    plain = encode_stored(replace(result, depth_mm=None, meta=meta), scene.left)
    with np.load(io.BytesIO(plain)) as archive:
        assert "left" not in archive.files
    with pytest.raises(InvalidParameter):
        render(plain, "application/ply")


def test_outputs_that_are_not_there_are_refused_before_anything_is_stored(result, scene):
    with pytest.raises(InvalidParameter, match="depth_mm"):
        encode_stored(replace(result, depth_mm=None), scene.left, ("depth_mm",))


def test_what_unfolds_into_more_than_there_is_is_not_read(result, scene):
    bomb = io.BytesIO()
    np.savez_compressed(bomb, disparity=np.zeros((2000, 2000), np.float32))
    for stored in (bomb.getvalue(), b"", encode_stored(result, scene.left)[:-30], b"\x93NUMPY"):
        with pytest.raises(InternalError, match="cannot be read"):
            render(stored, "application/x-npy")
