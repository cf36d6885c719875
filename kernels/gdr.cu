// Global disparity refinement on a GPU: every kernel of it in one module.
#include "gdr_evidence.cuh"
#include "gdr_iterate.cuh"
#include "gdr_linearise.cuh"
#include "gdr_pyramid.cuh"
#include "gdr_visible.cuh"
