"""The one place that imports OpenCV, so that its limit on decoded pixels is always set first."""

import os

os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))
# What OpenCV says of damaged files is said by our own errors.
os.environ.setdefault("OPENCV_LOG_LEVEL", "FATAL")

import cv2

__all__ = ["cv2"]
