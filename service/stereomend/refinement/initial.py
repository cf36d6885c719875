"""What starts the method: the upload, OpenCV's semi-global matcher, or zero."""

from __future__ import annotations

import math

import numpy as np

from stereomend.disparity import DisparityMap, FloatMap, Mask
from stereomend.errors import InvalidParameter, NoValidDisparity
from stereomend.opencv import cv2
from stereomend.refinement.backends import Backend
from stereomend.refinement.params import Initial, RefineParams
from stereomend.refinement.pyramid import Sparse, as_sparse
from stereomend.refinement.scene import Scene

_SEARCHED_SHARE = 0.3  # of the width; disparities of laparoscopes stay below
_BLOCK = 5  # px; the matcher's documentation suggests 3 to 11


def choose_initial(params: RefineParams, upload: DisparityMap | None) -> Initial:
    """Settle what starts the method (raises InvalidParameter where the parts contradict each other)."""
    initial = params.initial or ("sgbm" if upload is None else "upload")
    if initial == "upload" and upload is None:
        raise InvalidParameter('initial is "upload", but no disparity was sent')
    if initial == "zero" and "gdr" not in params.stages:
        raise InvalidParameter('initial is "zero" and stages lack "gdr": there is nothing to refine')
    return initial


def uploaded(upload: DisparityMap, mask: Mask | None = None) -> Sparse:
    """The upload's usable pixels, at input size (raises NoValidDisparity where there is none)."""
    sparse = as_sparse(upload, mask)
    if not sparse.valid.any():
        raise NoValidDisparity(_why_none(upload))
    return sparse


def _why_none(upload: DisparityMap) -> str:
    if not upload.valid.any():
        return "disparity has no finite value above 0"
    if as_sparse(upload).valid.any():
        return "disparity has no usable value where the mask shows the scene"
    smallest = float(upload.values[upload.valid].min())
    return (
        f"every disparity reaches beyond the image, the smallest is {smallest:g} px at a width of "
        f"{upload.shape[1]} px; is disparity_scale right?"
    )


def match_semiglobally(scene: Scene, backend: Backend) -> Sparse:
    """OpenCV's StereoSGBM at working size, (H, W) pixels (raises NoValidDisparity where nothing matches)."""
    width = scene.size[1]
    searched = 16 * max(1, math.ceil(width * _SEARCHED_SHARE / 16))
    values = _sgbm(scene, searched) if width > searched + _BLOCK else np.zeros(scene.size, np.float32)
    sparse = Sparse(backend.plane(values), scene.shown(values > 0))
    if not sparse.valid.any():
        raise NoValidDisparity(
            f"no disparity was sent and matching found none at {width} x {scene.size[0]} px"
        )
    return sparse


def _sgbm(scene: Scene, searched: int) -> FloatMap:
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=searched,
        blockSize=_BLOCK,
        P1=8 * _BLOCK**2,
        P2=32 * _BLOCK**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
    )
    left, right = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in (scene.left, scene.right))
    sixteenths = matcher.compute(left, right).astype(np.float32)
    return np.maximum(sixteenths / 16, 0)
