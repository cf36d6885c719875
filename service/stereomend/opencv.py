"""The one place that imports OpenCV, so that its limit on decoded pixels is always set first."""

import os

os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))

import cv2  # noqa: E402

__all__ = ["cv2"]
