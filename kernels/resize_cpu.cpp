// Changes of size as row loops that the compiler vectorises.
//
// Compiled once per instruction set, like gdr_cpu.cpp, and without contraction of products and sums: levels are then
// the same bits as by OpenCV, which matters to decisions that turn on the last one.
#include "area.hpp"
#include "merge.hpp"
#include "resize_sweeps.hpp"
#include "sparse.hpp"

namespace stereomend {

extern const ResizeSweeps RESIZE_SWEEPS = {shrink, merge, divide_row, sample_row, tell_row};

}  // namespace stereomend
