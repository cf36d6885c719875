// The median of 5 x 5 values by minima and maxima alone: the same steps whatever the values, so that they vectorise.
#pragma once

#include "pixel.cuh"

namespace stereomend {

PIXEL_FN void put_in_order(float& a, float& b) {
    const float low = smaller(a, b);
    b = larger(a, b);
    a = low;
}

// Five values in ascending order.
PIXEL_FN void sort5(float v[5]) {
    put_in_order(v[0], v[1]);
    put_in_order(v[3], v[4]);
    put_in_order(v[2], v[4]);
    put_in_order(v[2], v[3]);
    put_in_order(v[0], v[3]);
    put_in_order(v[0], v[2]);
    put_in_order(v[1], v[4]);
    put_in_order(v[1], v[3]);
    put_in_order(v[1], v[2]);
}

// The three in the middle of five values, in ascending order, in v[1] to v[3].
PIXEL_FN void sort_middle(float v[5]) {
    put_in_order(v[0], v[1]);
    put_in_order(v[2], v[3]);
    put_in_order(v[0], v[2]);
    put_in_order(v[1], v[3]);
    put_in_order(v[1], v[2]);
    // v[0] to v[3] are in order; v[4] pushes its way in.
    const float last = v[4];
    const float low = larger(v[0], last);
    v[4] = v[3];
    v[3] = larger(v[2], smaller(v[3], last));
    v[2] = larger(v[1], smaller(v[2], last));
    v[1] = smaller(v[1], low);
}

// The two or three largest of five values in ascending order at the end of v.
PIXEL_FN void sort_high(float v[5], int count) {
    put_in_order(v[0], v[1]);
    put_in_order(v[2], v[3]);
    const float lower = larger(v[0], v[2]);
    const float upper = smaller(v[1], v[3]);
    const float first = larger(v[1], v[3]);
    const float second = larger(lower, upper);
    const float third = smaller(lower, upper);
    const float last = v[4];
    v[4] = larger(first, last);
    v[3] = larger(second, smaller(first, last));
    if (count > 2) v[2] = larger(third, smaller(second, last));
}

// The two or three smallest at its beginning.
PIXEL_FN void sort_low(float v[5], int count) {
    put_in_order(v[0], v[1]);
    put_in_order(v[2], v[3]);
    const float lower = larger(v[0], v[2]);
    const float upper = smaller(v[1], v[3]);
    const float first = smaller(v[0], v[2]);
    const float second = smaller(lower, upper);
    const float third = larger(lower, upper);
    const float last = v[4];
    v[0] = smaller(first, last);
    v[1] = smaller(second, larger(first, last));
    if (count > 2) v[2] = smaller(third, larger(second, last));
}

// The median of 25 values of which each v[rank] holds five of one rank in their columns. Sorted by rank as well, 12
// of them cannot be it; of the three diagonals that remain, all of the middle one can, and the largest of the one
// below and the smallest of the one above.
PIXEL_FN float median25(float v[5][5]) {
    sort_high(v[0], 2);
    sort_high(v[1], 3);
    sort_middle(v[2]);
    sort_low(v[3], 3);
    sort_low(v[4], 2);
    float low = larger(larger(v[0][3], v[1][2]), larger(v[2][1], v[3][0]));
    float high = smaller(smaller(v[1][4], v[2][3]), smaller(v[3][2], v[4][1]));
    float middle[5] = {v[0][4], v[1][3], v[2][2], v[3][1], v[4][0]};
    sort_middle(middle);
    put_in_order(low, high);
    return smaller(middle[3], smaller(larger(middle[2], low), larger(middle[1], high)));
}

}  // namespace stereomend
