import numpy as np
import pytest

from stereomend import DisparityMap, StereoPair
from stereomend.errors import ShapeMismatch, UnknownFormat


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4", np.int16, np.uint8])
def test_any_real_array_becomes_a_map(dtype):
    disparity = DisparityMap.from_array(np.array([[1, 0, 3]], dtype))
    assert disparity.values.dtype == np.float32
    assert disparity.values.tolist() == [[1, 0, 3]]
    assert disparity.valid.tolist() == [[True, False, True]]


def test_what_is_not_finite_or_not_positive_is_unknown():
    disparity = DisparityMap.from_array(np.array([[np.nan, np.inf, -np.inf, -1, 0, 1e39, 2]]))
    assert disparity.values.tolist() == [[0, 0, 0, 0, 0, 0, 2]]


def test_the_caller_s_array_stays_as_it_is():
    array = np.array([[-1.0, 2.0]], np.float32)
    DisparityMap.from_array(array)
    assert array.tolist() == [[-1, 2]]


@pytest.mark.parametrize(
    "array", [np.zeros((2, 2, 2)), np.zeros((0, 4)), np.array([["a"]]), np.zeros((2, 2), complex)]
)
def test_other_arrays_are_refused(array):
    with pytest.raises(UnknownFormat, match="expected numbers of shape"):
        DisparityMap.from_array(array)


def test_a_pair_has_two_images_of_one_size():
    image = np.zeros((4, 6), np.uint8)
    assert StereoPair(image, np.zeros((4, 6, 3), np.uint16)).shape == (4, 6)
    with pytest.raises(ShapeMismatch, match=r"right is 5 x 4.*left is 6 x 4"):
        StereoPair(image, image[:, :5])
    for wrong in (image.astype(float), np.zeros((4, 6, 4), np.uint8), np.zeros((0, 6), np.uint8)):
        with pytest.raises(UnknownFormat, match="left is"):
            StereoPair(wrong, image)
