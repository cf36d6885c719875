"""Synthetic laparoscopic scenes with exact disparity, and disparities broken as networks break them."""

from stereomend.phantom.damage import DAMAGES, break_disparity, good_disparity
from stereomend.phantom.scene import Phantom, make_phantom

__all__ = ["DAMAGES", "Phantom", "break_disparity", "good_disparity", "make_phantom"]
