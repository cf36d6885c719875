"""Every image and disparity format, in and out, with limits that hold before a pixel is decoded."""

from stereomend.codec.images import decode_image, decode_mask, image_size
from stereomend.codec.maps import decode_disparity
from stereomend.codec.preview import Span, colourise, preview_picture
from stereomend.codec.results import (
    MEDIA_TYPES,
    OUTPUTS,
    PLY_TYPE,
    PREVIEW_TYPE,
    check_calibrated,
    encode_map,
    encode_result,
    holds_confidences,
    media_type_for,
)
from stereomend.codec.stored import STORED_TYPE, encode_stored, render

__all__ = [
    "MEDIA_TYPES",
    "OUTPUTS",
    "PLY_TYPE",
    "PREVIEW_TYPE",
    "STORED_TYPE",
    "Span",
    "check_calibrated",
    "colourise",
    "decode_disparity",
    "decode_image",
    "decode_mask",
    "encode_map",
    "encode_result",
    "encode_stored",
    "holds_confidences",
    "image_size",
    "media_type_for",
    "preview_picture",
    "render",
]
